"""Print the figures of docs/tracking.md: `python -m tests.observe.figures` (two minutes on one core)."""

import re
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from backend.blind.camera import Bed, Camera
from backend.blind.render import Look
from backend.observe.measure import track_video
from tests.observe.scenes import eight, errors_m, film, swaps

SPOTS = {"a": (-0.29, -0.15), "b": (0.29, -0.15), "c": (0.29, 0.15), "d": (-0.29, 0.15), "e": (0.0, 0.16)}
TILTED = {"tilt_deg": (1.6, -1.1, 0.7), "k1": -0.03}
LENS = {"lens": {"focal_px": 1600, "k1": -0.03}}


def raised(t):
    return {name: p + np.array([0, 0, 0.012]) for name, p in eight(t).items()}


def many(t):
    return {
        f"j{k}": np.c_[
            -0.28 + 0.08 * (k % 8) + 0.01 * np.sin(2 * np.pi * (2 + 0.1 * k) * t + k),
            -0.12 + 0.075 * (k // 8) + 0.02 * np.sin(2 * np.pi * (1 + 0.07 * k) * t + 2 * k),
            0 * t,
        ]
        for k in range(32)
    }


def filmed(folder, motion, camera=None, rate=240.0, look=None, frames=240):
    t = np.arange(frames) / rate
    names = list(motion(t[:1]))
    start = time.process_time()
    clip = film(
        folder / "clip.mp4",
        t,
        motion,
        list(pairwise(names)),
        camera or Camera(),
        Bed(SPOTS),
        look,
    )
    return clip, frames / (time.process_time() - start)


def row(name, clip, bed=None, preview=False):
    start = time.process_time()
    result = track_video(
        clip.path, clip.mechanism, {**clip.bed, **(bed or {})}, out_dir=clip.path.parent, preview=preview
    )
    rate = len(result.tracks.frame.unique()) / (time.process_time() - start)
    error = errors_m(clip, result.tracks)
    away = 1e3 * np.hypot(*error.transpose(2, 0, 1))
    nees = np.nanmean((error**2).sum(2).ravel() / 2 / result.tracks.sigma_m.to_numpy() ** 2)
    print(
        f"| {name} | {np.nanmedian(away):.3f} / {np.nanpercentile(away, 95):.3f} / {np.nanmax(away):.3f} "
        f"| {swaps(clip, result.tracks)} | {nees:.2f} | {rate:.0f} |",
        flush=True,
    )
    return result


def main():
    print("| scene | error, median / p95 / max mm | swaps | NEES | frames per CPU second |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip, rate = filmed(folder, eight)
        row("8 dots, 720p", clip)
        row("the same, with preview", clip, preview=True)
        print(f"(filming it: {rate:.0f} frames per CPU second)")
        row("8 dots, 60 frames a second", filmed(folder, eight, rate=60.0, frames=120)[0])
        row("8 dots, noise of 6 codes, crf 28", filmed(folder, eight, look=Look(noise_codes=6, crf=28))[0])
        row("8 dots, shutter 4 ms", filmed(folder, eight, look=Look(shutter_s=4e-3))[0])
        row("32 dots, 1080p, 0.33 mm per pixel", filmed(folder, many, Camera(2400, 0.8, 1920, 1080), frames=120)[0])
        clip, _ = filmed(folder, raised, Camera(**TILTED))
        row("dots 12 mm up, lens tilted and bent: height unknown", clip, {"marker_height_m": None})
        row("the same, camera_height_m given", clip, {"marker_height_m": 0.012, "camera_height_m": 0.8})
        row("the same, lens given, height ignored", clip, LENS)
        row("the same, lens and height given", clip, {"marker_height_m": 0.012, **LENS})
        row("the same, lens given, height 1 mm wrong", clip, {"marker_height_m": 0.011, **LENS})
        filmed(folder, many, Camera(2400, 0.8, 1920, 1080), frames=240)
        alone = subprocess.run([sys.executable, "-m", "tests.observe.figures", name], capture_output=True, check=True)
        print(alone.stdout.decode().strip())


def track_alone(folder):
    """Track a clip in a process that renders nothing, and print the memory it took."""
    from tests.observe.scenes import drawing

    mechanism = drawing({name: p[0] for name, p in many(np.zeros(1)).items()})
    track_video(folder / "clip.mp4", mechanism, folder / "clip.bed.json", out_dir=folder)
    # The resource module would count the parent's memory too: a forked child inherits its high-water mark.
    peak = int(re.findall(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[0]) / 1024
    print(f"peak memory, 32 dots, 1080p, preview written: {peak:.0f} MB")


if __name__ == "__main__":
    track_alone(Path(sys.argv[1])) if len(sys.argv) > 1 else main()
