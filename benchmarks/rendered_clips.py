"""What tracking is worth, end to end: ten rendered clips with truth, measured in several ways.

`python -m benchmarks.rendered_clips [WORDS] [--ways kit,plain,paper]`: clips whose name holds one of the words, or all.
Rendering takes a minute or two a clip and is done once (out/rendered_clips); measuring takes seconds.

Errors are distances on the bed at each point's own time, at 0.5 mm a pixel, of points called observed.  A swap is a
point nearer to another marker's place than to its own.  NEES is the mean squared error per coordinate over
sigma_m² + calibration_sd_m²: 1 where both are honest.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backend.observe.bed import read_bed
from backend.observe.measure import track_video
from backend.observe.without_board import calibrate_from_clip
from benchmarks.filming import paper
from benchmarks.filming.clips import CLIPS, FOLDER, Clip, bed, board_photos
from benchmarks.filming.renderer import FIRST_TARGET_TAG

RULER_M = 4e-4  # by which a ruler misread the dots' height; half a millimetre is what the bed file says of it


def score(clip: Clip, tracks: pd.DataFrame) -> dict[str, float]:
    """Median, 95% and largest error [mm], swaps, NEES, share of points observed."""
    names = clip.filmed.markers
    order = tracks.marker.map({n: k for k, n in enumerate(names)}).to_numpy()
    truth = clip.filmed.at(tracks.time_s.to_numpy())[..., :2]
    off = truth - tracks[["x_m", "y_m"]].to_numpy()[:, None]
    away = np.hypot(off[..., 0], off[..., 1])
    placed = np.isfinite(away[:, 0])
    own = away[np.arange(len(order)), order]
    seen = placed & (tracks.status.eq("observed").to_numpy() if "status" in tracks else True)
    sigma = tracks.sigma_m.to_numpy() if "sigma_m" in tracks else np.full(len(tracks), np.nan)
    sigma = np.hypot(sigma, tracks.attrs.get("shared_m", 0.0))
    mm = 1e3 * own[seen]
    return {
        "median": float(np.median(mm)),
        "p95": float(np.percentile(mm, 95)),
        "max": float(mm.max()),
        "swaps": int((away[placed].argmin(1) != order[placed]).sum()),
        "nees": float(np.mean(own[seen] ** 2 / 2 / sigma[seen] ** 2)),
        "seen": float(seen.mean()),
    }


def tracked(clip: Clip, folder: Path, coast_s: float = 0.0, **known: Any) -> pd.DataFrame:
    """Our tracks of a clip."""

    tagged = clip.scene.target == "tag"
    targets = {m: FIRST_TARGET_TAG + k for k, m in enumerate(clip.filmed.markers)} if tagged else None
    given = {key: value for key, value in (bed(clip) | known).items() if value is not None}
    path = clip.made(folder)
    with tempfile.TemporaryDirectory() as out:
        begun = time.process_time()
        result = track_video(
            path, clip.filmed.mechanism, given,
            out_dir=out, targets=targets, coast_s=coast_s, preview=False,
        )  # fmt: skip
    result.tracks.attrs["shared_m"] = result.summary["calibration_sd_m"]
    result.tracks.attrs["readout"] = result.summary.get("readout")
    result.tracks.attrs["cpu_ms"] = 1e3 * (time.process_time() - begun) / result.summary["frames"]
    return result.tracks


def with_kit(clip: Clip, folder: Path, coast_s: float = 0.0) -> pd.DataFrame:
    """Ringed dots, or tags; bed tags; the lens from the board."""
    return tracked(clip, folder, coast_s, camera=calibrated(folder))


def dated_by_itself(clip: Clip, folder: Path) -> pd.DataFrame:
    """As with the kit, but the bed file does not know the rolling shutter's readout: the clip tells it."""
    return tracked(clip, folder, camera=calibrated(folder), readout_s=None)


def plain_dots(clip: Clip, folder: Path) -> pd.DataFrame:
    """Bare dots; bed tags; the lens from the board."""
    return tracked(clip.plain(), folder, camera=calibrated(folder))


def as_in_the_paper(clip: Clip, folder: Path) -> pd.DataFrame:
    """Colour mask and homography, on the kit's dots."""
    return paper.measure(clip, clip.made(folder))


def without_board(clip: Clip, folder: Path) -> pd.DataFrame:
    """The kit's dots and bed tags; lens and pose from the clip itself, from bars, tags and a ruler held to the dots."""
    given = {key: value for key, value in bed(clip).items() if key != "marker_height_sd_m"}
    given["marker_height_m"] += RULER_M
    with tempfile.TemporaryDirectory() as out:
        camera = calibrate_from_clip(clip.made(folder), clip.filmed.mechanism, read_bed(given), out_dir=out)
    return tracked(clip, folder, camera=camera, marker_height_m=None)


def calibrated(folder: Path) -> dict:
    """The camera as `linktwin calibrate` finds it from photos of the board."""
    from backend.observe.calibrate_camera import calibrate_camera
    from backend.observe.camera import write_camera

    path = folder / "camera.json"
    if not path.exists():
        write_camera(calibrate_camera([str(p) for p in board_photos(folder)]), path)
    return json.loads(path.read_text())


WAYS: dict[str, Callable[[Clip, Path], pd.DataFrame]] = {
    "kit": with_kit,
    "readout found": dated_by_itself,
    "without board": without_board,
    "plain": plain_dots,
    "paper": as_in_the_paper,
}


def row(clip: Clip, way: str, folder: Path = FOLDER) -> str:
    """One line of the table."""
    if clip.scene.target == "tag" and way not in ("kit", "readout found"):
        return f"| {clip.name} | {way} | has no dots | | | | | |"
    tracks = WAYS[way](clip, folder)
    s, readout = score(clip, tracks), tracks.attrs.get("readout")
    seen = f"{1e3 * readout['seen_s']:.2f} ± {1e3 * readout['sd_s']:.2f}" if readout else ""
    errors = f"{s['median']:.3f} / {s['p95']:.3f} / {s['max']:.2f}"
    nees = "" if np.isnan(s["nees"]) else f"{s['nees']:.2f}"
    cost = f"{tracks.attrs['cpu_ms']:.1f}" if "cpu_ms" in tracks.attrs else ""
    return f"| {clip.name} | {way} | {errors} | {s['swaps']} | {nees} | {100 * s['seen']:.1f} | {seen} | {cost} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--ways", default=",".join(WAYS))
    given = parser.parse_args()
    heads = ("clip", "way", "median / 95% / max, mm", "swaps", "NEES", "observed, %", "readout, ms", "CPU ms a frame")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for clip in CLIPS:
        if not given.words or any(w in clip.name for w in given.words):
            for way in given.ways.split(","):
                print(row(clip, way), flush=True)


if __name__ == "__main__":
    main()
