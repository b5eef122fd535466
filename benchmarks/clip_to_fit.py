"""From a film to the play of its pins: ten cells, every pin loose, filmed, tracked, fitted; the paper's way beside it.

python -m benchmarks.clip_to_fit [WAYS] [--play MM] [--picture FILE]

The scissor of benchmarks/filming/loose.py is held for twelve frames, let go between two frames, and opened by its
spring for 0.2 s; MuJoCo moves it.  Film: 240 frames a second, 0.5 mm a pixel, bent lens, tilt, rolling shutter, H.264
(docs/video.md).  Ways: `noise`, the true places at each point's own time with 0.03 mm of noise, what the fit is worth
without a camera; `kit`, ringed dots, bed tags, lens from the board, fitted in pixels through the camera; `metres`, the
same as places on the bed; `plain`, bare dots; `paper`, colour mask and homography on the kit's dots.  Every way is then
fitted alike: play and viscous friction from half and three times their truth, and how much later than the last still
frame the latch opened.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import av
import jax
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from backend.fit.fit_study import fit_study
from backend.fit.result import FitResult
from backend.mechanism.read import read_study, write_mechanism, write_study
from backend.mechanism.study import ExperimentFile, Release, StudyFile
from backend.observe.measure import track_video
from benchmarks.filming import paper
from benchmarks.filming.clips import FOLDER, Clip, bed
from benchmarks.filming.linkages import Filmed
from benchmarks.filming.loose import drawn, loose_scissor
from benchmarks.filming.scene import Scene
from benchmarks.rendered_clips import calibrated, score

OUT = Path("out") / "clip_to_fit"
DAMPING, MOTION_S, STILL, DELAY_S = 3e-4, 0.2, 12, 2.6e-3
NOISE_M, PAPER_M, STEP_S = 3e-5, 3e-3, 2.5e-4
FREE = (
    "clearance:play.radial_m",
    "viscous_friction:drag.damping_n_m_s_per_rad",
    "late_release:world.delay_s",
)


@dataclass(frozen=True)
class LooseClip(Clip):
    """The film of a scissor whose pins have this play."""

    play_m: float = 1e-3

    @cached_property
    def filmed(self) -> Filmed:
        """Held, then let go."""
        kept = FOLDER / f"motion_loose_{1e6 * self.play_m:.0f}um.npz"
        return loose_scissor(self.play_m, DAMPING, self.release_s + DELAY_S, MOTION_S + 0.03, kept)

    @property
    def release_s(self) -> float:
        """The last frame in which it is still: what a person would say of the film."""
        return STILL / self.scene.rate


def film(play_m: float) -> LooseClip:
    """The clip, to be rendered where it is not there yet."""
    frames = STILL + round(MOTION_S * Scene().rate)
    return LooseClip(f"loose {1e3 * play_m:g} mm", "loose scissor", Scene(seed=21), frames, play_m=play_m)


def places(tracks: pd.DataFrame) -> pd.DataFrame:
    """Metres alone."""
    return tracks.filter(items=["time_s", "marker", "x_m", "y_m", "z_m", "sigma_m"])


def truth(clip: LooseClip, folder: Path) -> pd.DataFrame:
    """Where the markers were when their rows were read, with noise."""
    rng, names = np.random.default_rng(5), clip.filmed.markers
    with np.load(clip.made().with_suffix(".npz")) as file:
        seen_s, world = file["seen_s"], file["world_m"]
    xy = (world[..., :2] + NOISE_M * rng.standard_normal((*seen_s.shape, 2))).reshape(-1, 2)
    whose = names * len(seen_s)
    columns = {"x_m": xy[:, 0], "y_m": xy[:, 1], "z_m": np.nan, "sigma_m": NOISE_M}
    return pd.DataFrame({"time_s": seen_s.ravel(), "marker": whose, **columns})


def tracked(clip: Clip, folder: Path) -> pd.DataFrame:
    """As `linktwin track` measures it with the kit; camera.json stays in the folder."""
    given = bed(clip) | {"camera": calibrated(FOLDER)}
    result = track_video(clip.made(), clip.filmed.mechanism, given, out_dir=folder, preview=False)
    result.tracks.attrs["shared_m"] = result.summary["calibration_sd_m"]
    return result.tracks


def in_metres(clip: LooseClip, folder: Path) -> pd.DataFrame:
    """The kit's tracks without their pixels and without their camera."""
    with tempfile.TemporaryDirectory() as other:
        return places(tracked(clip, Path(other)))


def bare(clip: LooseClip, folder: Path) -> pd.DataFrame:
    """Dots without rings, fitted in pixels."""
    return tracked(clip.plain(), folder)


def as_in_the_paper(clip: LooseClip, folder: Path) -> pd.DataFrame:
    """Colour mask and homography; every point is said to be as good as these are."""
    return paper.measure(clip, clip.made()).assign(z_m=np.nan, sigma_m=PAPER_M)


WAYS: dict[str, Callable[[LooseClip, Path], pd.DataFrame]] = {
    "noise": truth,
    "kit": tracked,
    "metres": in_metres,
    "plain": bare,
    "paper": as_in_the_paper,
}


def folder_of(clip: LooseClip, way: str) -> Path:
    """Where a way's study and fit.json are."""
    return OUT / f"{way}_{1e6 * clip.play_m:.0f}um"


def fitted(clip: LooseClip, way: str) -> tuple[pd.DataFrame, FitResult]:
    """Tracks in one way, and the fit to them: a study that `linktwin fit` reads as well."""
    folder = folder_of(clip, way)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    tracks = WAYS[way](clip, folder)
    tracks.to_csv(folder / "tracks.csv", index=False, float_format="%.10g")
    write_mechanism(drawn(0.5 * clip.play_m, 3.0 * DAMPING)[0], folder / "mechanism.json")
    seen_by = "camera.json" if (folder / "camera.json").exists() else None
    run = ExperimentFile(id=way, tracks="tracks.csv", camera=seen_by, release=Release(time_s=clip.release_s))
    write_study(StudyFile(mechanism="mechanism.json", experiments=(run,)), folder / "study.json")
    result = fit_study(read_study(folder / "study.json"), FREE, profiles=False, step_s=STEP_S)
    result.write(folder)
    return tracks, result


def line(clip: LooseClip, way: str) -> str:
    """A row of the table."""
    begin = time.perf_counter()
    tracks, result = fitted(clip, way)
    s, truths = score(clip, tracks), (clip.play_m, DAMPING, DELAY_S)
    found = [result.values[name] for name in FREE]
    off = [100 * (value / true - 1) for value, true in zip(found, truths, strict=True)]
    sd = 100 * result.uncertainty.sd[:2] / truths[:2]
    cells = (
        way, f"{s['median']:.3f} / {s['p95']:.3f}", s["swaps"], f"{1e3 * found[0]:.4f}", f"{off[0]:+.2f} ({sd[0]:.2f})",
        f"{off[1]:+.1f} ({sd[1]:.1f})", f"{1e3 * found[2]:.2f}", f"{result.spread:.1f}",
        f"{time.perf_counter() - begin:.0f}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def picture(clip: LooseClip, frame: int, path: Path) -> None:
    """One frame as the kit's tracks see it, and the play that every way has found, from what is in OUT."""
    with av.open(str(clip.made())) as container:
        shown = next(p for k, p in enumerate(container.decode(video=0)) if k == frame).to_ndarray(format="rgb24")
    figure, (film_axes, axes) = plt.subplots(1, 2, figsize=(11, 3.4), width_ratios=(2, 1), layout="constrained")
    tracks = pd.read_csv(folder_of(clip, "kit") / "tracks.csv")
    points = tracks[tracks.frame == frame]
    film_axes.imshow(shown)
    film_axes.plot(points.x_px, points.y_px, "o", mfc="none", mec="lime", ms=9)
    film_axes.set(
        xticks=[],
        yticks=[],
        title=f"{1e3 * (frame / clip.scene.rate - clip.release_s):.0f} ms after the last still frame",
    )
    done = [way for way in WAYS if (folder_of(clip, way) / "fit.json").exists()]
    for k, way in enumerate(done):
        found = json.loads((folder_of(clip, way) / "fit.json").read_text())["parameters"][0]
        axes.errorbar(1e3 * found["value"], -k, xerr=1e3 * 1.96 * found["sd"], fmt="o", capsize=4)
    axes.axvline(1e3 * clip.play_m, color="k", lw=0.8)
    axes.axvspan(0.95e3 * clip.play_m, 1.05e3 * clip.play_m, color="k", alpha=0.08)
    axes.set(yticks=[-k for k in range(len(done))], yticklabels=done, xlabel="play found, mm", title="truth and 5%")
    figure.savefig(path, dpi=100)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ways", nargs="*", choices=[[], *WAYS], default=[])
    parser.add_argument("--play", type=float, default=1.0, help="mm")
    parser.add_argument("--picture", type=Path, help="draw what was found instead, into this file")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    clip = film(1e-3 * asked.play)
    if asked.picture:
        if not (folder_of(clip, "kit") / "fit.json").exists():
            parser.error("the kit's fit is not there to draw: run `python -m benchmarks.clip_to_fit kit` first")
        picture(clip, frame=45, path=asked.picture)
        return
    print(
        f"play {asked.play:g} mm, friction {DAMPING:g} N m s/rad, latch {1e3 * DELAY_S:g} ms after the last still frame"
        "\n"
        "| way | tracks: median / 95%, mm | swaps | play found, mm | play off (sd), % | friction off (sd), % "
        "| latch, ms | misfit, sigmas | s |\n|---|---|---|---|---|---|---|---|---|"
    )
    for way in asked.ways or WAYS:
        print(line(clip, way), flush=True)


if __name__ == "__main__":
    main()
