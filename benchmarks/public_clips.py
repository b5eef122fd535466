"""Track clips that others filmed and published; print what came out.

    python -m benchmarks.public_clips FOLDER [name ...]

FOLDER holds clones of the repositories, as owner/name: none of them is ours to hand on.  Drawings are by hand, from
what the sources say and from the pictures; lengths that nobody states count 1 mm a pixel.
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.observe.measure import track_video
from backend.observe.video import WHOLE, Part

ACROSS = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]  # a pin's axis is across the upright plane
UPRIGHT = {"origin_m": [0, 0, 0], "x_axis": [1, 0, 0], "y_axis": [0, 0, 1]}


def drawing(found: "Found") -> Mechanism:
    """Links and their pins as the first picture shows them; what stands in `ground` and two links share is a pin."""
    m_per_px, (u0, v0) = found.stick[0] / found.stick[1], found.origin_px
    at = {k: np.array([(u - u0) * m_per_px, 0.0, (v0 - v) * m_per_px]) for k, (u, v) in found.at_px.items()}
    origin = {"ground": np.zeros(3)} | {name: at[pins[0]] for name, pins in found.links.items()}
    owner = dict.fromkeys(found.ground, "ground")
    bodies: list[dict[str, Any]] = [{"id": "ground", "fixed": True}]
    joints: list[dict[str, Any]] = []

    def frame(body: str, pin: str) -> dict[str, Any]:
        return {"position_m": (at[pin] - origin[body]).tolist(), "quaternion_wxyz": ACROSS}

    for name, pins in found.links.items():
        middle = np.mean([at[pin] - origin[name] for pin in pins], axis=0).tolist()
        inertial = {"mass_kg": 0.02, "center_of_mass_m": middle, "inertia_kg_m2": {"xx": 1e-5, "yy": 1e-5, "zz": 1e-5}}
        pose = {"position_m": origin[name].tolist(), "quaternion_wxyz": [1, 0, 0, 0]}
        bodies.append({"id": name, "pose": pose, "inertial": inertial})
        for pin in pins:
            if pin in owner:
                joint = {"id": f"{pin}_{name}", "type": "revolute", "body_a": owner[pin], "body_b": name}
                joints.append({**joint, "frame_a": frame(owner[pin], pin), "frame_b": frame(name, pin)})
            owner.setdefault(pin, name)
    markers = [
        {"id": pin, "body": owner[pin], "position_m": (at[pin] - origin[owner[pin]]).tolist()}
        for pin in at
        if pin not in found.unseen
    ]
    return parse_mechanism(
        {"schema_version": "1.0", "name": "found", "bodies": bodies, "joints": joints, "markers": markers}
    )


@dataclass(frozen=True)
class Found:
    """A clip, what is drawn of it, and how it is tracked.

    at_px: pins and points in its first picture.  links: which of them each body carries.  ground: those that stand.
    unseen: those without a marker.  stick: a length [m] and the pixels that it spans.  origin_px: the world's origin.
    target: what carries every marker; None: a coloured dot.  clicked: whether the points are given as clicks.
    """

    path: str
    at_px: dict[str, tuple[float, float]]
    links: dict[str, tuple[str, ...]]
    ground: tuple[str, ...] = ("pivot",)
    unseen: tuple[str, ...] = ("pivot",)
    stick: tuple[float, float] = (1.0, 1000.0)
    origin_px: tuple[float, float] = (0.0, 0.0)
    target: str | None = None
    clicked: bool = False
    part: Part = WHOLE
    judged: tuple[Callable[[pd.DataFrame], str], ...] = ()
    tracker_csv: str = ""  # the same clip as others tracked it


def main(folder: Path, names: list[str]) -> None:
    """One row a clip."""
    print("| clip | frames | observed, outlier, occluded, % | what can be judged |\n|---|---|---|---|")
    for name in names or list(CLIPS):
        found = CLIPS[name]
        drawn, (length_m, length_px) = drawing(found), found.stick
        stick = {"a_px": (0, 0), "b_px": (length_px, 0), "length_m": length_m, "origin_px": found.origin_px}
        markers = [m.id for m in drawn.markers]
        with tempfile.TemporaryDirectory() as out:
            tracks = track_video(
                folder / found.path, drawn, {"plane": UPRIGHT, "stick": stick}, out_dir=out, preview=False,
                part=found.part,
                targets=dict.fromkeys(markers, found.target) if found.target else None,
                clicks={m: found.at_px[m] for m in markers} if found.clicked else None,
            ).tracks  # fmt: skip
        share = [f"{100 * tracks.status.eq(s).mean():.1f}" for s in ("observed", "outlier", "occluded")]
        told = "; ".join(judge(tracks) for judge in found.judged)
        if found.tracker_csv:
            told += "; " + beside(tracks, pd.read_csv(folder / found.tracker_csv, sep=";", encoding="utf-8-sig"))
        print(f"| {name} | {tracks.frame.nunique()} | {', '.join(share)} | {told} |", flush=True)


def swing(guess_s: float) -> Callable[[pd.DataFrame], str]:
    """Period and decay of a damped sine through x of all points that were seen."""

    def judge(tracks: pd.DataFrame) -> str:
        seen = tracks[tracks.x_m.notna()]
        t, x = seen.time_s.to_numpy(), seen.x_m.to_numpy()

        def off(p: np.ndarray) -> np.ndarray:
            return p[0] + np.exp(-p[1] * t) * (p[2] * np.cos(p[3] * t) + p[4] * np.sin(p[3] * t)) - x

        fit = least_squares(off, [x.mean(), 0.0, np.ptp(x) / 2, 2 * np.pi / guess_s, 0.01])
        _, decay, a, w, b = fit.x
        return (
            f"period {2 * np.pi / w:.4f} s, decay {decay:.4f} /s, amplitude {1e3 * np.hypot(a, b):.0f} mm, "
            f"sine missed by {1e3 * np.sqrt(np.mean(fit.fun**2)):.1f} mm rms"
        )

    return judge


def passes(tracks: pd.DataFrame) -> str:
    """Times between passes of the picture's middle in one direction."""
    seen = tracks[tracks.x_m.notna()]
    t, x = seen.time_s.to_numpy(), seen.x_m.to_numpy()
    times: dict[bool, list[float]] = {True: [], False: []}
    for (t0, x0), (t1, x1) in pairwise(zip(t, x, strict=True)):
        if t1 - t0 < 0.06 and x0 * x1 < 0:
            times[bool(x1 > x0)].append(t0 - x0 * (t1 - t0) / (x1 - x0))
    periods = np.concatenate([np.diff(v) for v in times.values()])
    return f"{len(periods)} periods, {periods.min():.3f} to {periods.max():.3f} s"


def lengths(*pairs: str) -> Callable[[pd.DataFrame], str]:
    """Scatter of distances [px] that cannot change, where both ends are observed."""

    def judge(tracks: pd.DataFrame) -> str:
        px = tracks[tracks.status == "observed"].pivot(index="frame", columns="marker", values=["x_px", "y_px"])
        told = []
        for pair in pairs:
            p, q = pair.split("-")
            apart = np.hypot(*(np.asarray(px[c][p] - px[c][q], float) for c in ("x_px", "y_px")))
            told.append(f"{pair} {np.nanmean(apart):.1f} ± {np.nanstd(apart):.2f}")
        return f"lengths, px: {', '.join(told)}"

    return judge


def round_its_pin(tracks: pd.DataFrame) -> str:
    """Turns of a point about another, and what is left of its distance [px] after the ellipse that a lean makes."""
    px = tracks[tracks.status == "observed"].pivot(index="frame", columns="marker", values=["x_px", "y_px"]).dropna()
    du, dv = (np.asarray(px[c]["rim"] - px[c]["middle"], float) for c in ("x_px", "y_px"))
    turn, r = np.unwrap(np.arctan2(-dv, du)), np.hypot(du, dv)
    basis = np.stack([np.ones_like(turn), *(f(k * turn) for k in (1, 2) for f in (np.cos, np.sin))], 1)
    rest = r - basis @ np.linalg.lstsq(basis, r, rcond=None)[0]
    return f"{np.ptp(turn) / 2 / np.pi:.2f} turns, rim's distance ± {r.std():.2f} px, {rest.std():.3f} after an ellipse"


def straight(tracks: pd.DataFrame) -> str:
    """Scatter across the line on which a block slides [mm], of what was observed."""
    seen = np.asarray(tracks.loc[tracks.status == "observed", ["x_m", "z_m"]], float)
    return f"{1e3 * np.linalg.svd(seen - seen.mean(0))[1][1] / np.sqrt(len(seen)):.2f} px rms off its line"


def beside(tracks: pd.DataFrame, published: pd.DataFrame) -> str:
    """Distances [px] from points that others had from Tracker, at twice the size, from the pivot, y upwards."""
    told = []
    for name, seen in tracks[tracks.status == "observed"].groupby("marker"):
        rows = published.iloc[seen.frame.to_numpy()]
        there = np.array(PIVOT) + np.asarray(rows[[f"x_{name}", f"y_{name}"]], float) / 2 * [1, -1]
        off = np.hypot(*(np.asarray(seen[["x_px", "y_px"]], float) - there).T)
        told.append(f"{name} {np.median(off):.2f} / {np.quantile(off, 0.95):.2f} / {off.max():.2f}")
    return f"from Tracker's, median / 95% / max, px: {', '.join(told)}"


PHYSTRACK = "umartechboy/PhysTrack/SampleVideos"
PRINTED = "hucik14/hucik14.github.io/assets/gifs"
HUNG = {"string": ("pivot", "ball")}
SNAP = {"A": (147.5, 155.0), "B": (119.0, 141.0), "C": (183.0, 134.0), "D": (239.0, 140.0)}
FOURBAR = {"short": ("B", "C"), "long": ("A", "D"), "coupler": ("C", "D")}
ARMS = {
    "a": (60.0, 258.0), "b": (320.0, 254.0), "c": (140.0, 134.0), "d": (113.0, 104.0), "e": (182.0, 56.0),
    "f": (290.0, 188.0),
}  # fmt: skip
PIVOT = (941.75, 466.75)  # of the double pendulum, 443 px of the whole picture above its upper dot, at half size
CLIPS = {
    "bauble": Found(
        "juangomez177/Pendulum_Oscillatory_Motion/pendulum.mp4",
        {"pivot": (322.8, -826.5), "ball": (525.0, 242.5)}, HUNG,
        stick=(1.0, 640.0), origin_px=(322.8, -826.5), judged=(swing(2.6),),
    ),
    "rope": Found(
        "bartekpacia/pendulum/film2_vga.mp4", {"pivot": (264.6, -458.6), "ball": (218.0, 125.0)}, HUNG,
        stick=(0.062, 58.0), origin_px=(264.6, -458.6), target="patch", clicked=True, part=Part(0.5),
        judged=(swing(1.6),),
    ),
    "short rope": Found(
        "bartekpacia/pendulum/film1_fhd.mp4", {"pivot": (980.0, -1600.0), "ball": (752.0, 448.0)}, HUNG,
        stick=(0.062, 200.0), origin_px=(980.0, -1600.0), target="patch", clicked=True, judged=(swing(1.0),),
    ),
    "museum": Found(
        "arantxax/pendulumtracker/20190829_150227.mp4", {"pivot": (320.0, -550.0), "ball": (519.0, 294.0)}, HUNG,
        stick=(0.004, 1.0), origin_px=(320.0, -550.0), target="patch", clicked=True, part=Part(0.27), judged=(passes,),
    ),
    "disc": Found(
        f"{PHYSTRACK}/RotationOnAFixedPivot/R1.MP4", {"middle": (198.5, 110.0), "rim": (202.5, 34.5)},
        {"disc": ("middle", "rim")}, ("middle",), (), origin_px=(198.5, 110.0), target="texture", clicked=True,
        part=Part(filmed_per_s=240), judged=(round_its_pin,),
    ),
    "slope": Found(
        f"{PHYSTRACK}/SlidingFriction/R1.MP4", {"block": (298.0, 60.0)}, {"block": ("block",)}, (), (),
        origin_px=(298.0, 60.0), target="patch", clicked=True, part=Part(to_s=12.6), judged=(straight,),
    ),
    "double pendulum": Found(
        "zedbros/DoublePendule_Physique/media/gifs/base_filtered_pendulum.gif",
        {"pivot": PIVOT, "m1": (935.5, 246.4), "m2": (920.6, 87.4)}, {"upper": ("pivot", "m1"), "lower": ("m1", "m2")},
        stick=(0.09174, 221.5), origin_px=PIVOT, target="dark", part=Part(filmed_per_s=100), judged=(lengths("m1-m2"),),
        tracker_csv="rdtjulien/PendulePhysic/src/data.csv",
    ),
    "snap": Found(
        f"{PRINTED}/snap.gif", SNAP, FOURBAR, ("A", "B"), (), origin_px=SNAP["A"], target="texture",
        judged=(lengths("A-B", "B-C", "A-D", "C-D"),),
    ),
    "snap, pressed slowly": Found(
        f"{PRINTED}/snap.gif", SNAP, FOURBAR, ("A", "B"), (), origin_px=SNAP["A"], target="texture", part=Part(9.7),
        judged=(lengths("A-B", "B-C", "A-D", "C-D"),),
    ),
    "three arms": Found(
        f"{PRINTED}/m3rpr.gif", ARMS,
        {"ac": ("a", "c"), "bf": ("b", "f"), "de": ("d", "e"), "platform": ("e", "c", "f")},
        ("a", "b", "d"), ("a",), origin_px=ARMS["b"], target="texture", judged=(lengths("b-d", "c-e", "c-f", "e-f"),),
    ),
}  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
