"""Samples to begin with: mechanisms of this repository, with their meshes where CadQuery can draw them."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

from backend.mechanism.read import read_mechanism
from backend.report.evidence import Motion
from backend.report.skeleton import best_view, skeleton_of
from backend.service.mechanisms import DRAWING, store_mechanism
from backend.service.page.running import linktwin, place
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.service import Service
from backend.service.studies import STUDY, store_study

SAMPLES = Path(__file__).parents[3] / "samples"


@dataclass(frozen=True)
class Sample:
    """One folder of samples: its name, what it is in a line, whether runs were measured on it."""

    name: str
    words: str
    measured: int

    @property
    def title(self) -> str:
        """As it is called on the page."""
        known = {"fourbar": "Four-bar", "slider_crank": "Slider-crank"}
        return known.get(self.name, self.name.replace("_", " ").capitalize())


WORDS = {
    "pendulum": "one bar on one pin",
    "double_pendulum": "two bars, two freedoms",
    "fourbar": "crank, coupler, rocker; one loop",
    "slider_crank": "a crank that drives a block on a rail",
    "scissor": "ten cells, ten loops, one freedom",
    "bennett": "four skew axes that still move",
}


def samples() -> list[Sample]:
    """Every sample there is; those that were measured first."""
    found = []
    for path in SAMPLES.glob(f"*/{DRAWING}"):
        study = path.parent / "measured" / STUDY
        runs = len(json.loads(study.read_text(encoding="utf-8"))["experiments"]) if study.exists() else 0
        found.append(Sample(path.parent.name, WORDS.get(path.parent.name, ""), runs))
    order = list(WORDS)
    return sorted(found, key=lambda s: (-s.measured, order.index(s.name) if s.name in order else len(order), s.name))


def outline(name: str) -> str:
    """A line drawing of a sample, as SVG."""
    mechanism = read_mechanism(SAMPLES / name / DRAWING)
    return outline_of(mechanism)


def outline_of(mechanism, width: int = 250, height: int = 132) -> str:
    """A line drawing of a mechanism as it was drawn, as SVG."""
    import numpy as np

    bodies = mechanism.bodies
    still = Motion(
        np.zeros(1),
        {b.id: np.array([b.pose.position_m]) for b in bodies},
        {b.id: np.array([b.pose.quaternion_wxyz]) for b in bodies},
    )
    skeleton = skeleton_of(mechanism)
    placed = skeleton.placed(still)
    flat = best_view(placed)
    seen = {id: flat.seen(points[0]) for id, points in placed.items()}
    held = flat.seen(skeleton.held)
    cloud = np.concatenate([*seen.values(), held]) if seen or len(held) else np.zeros((1, 2))
    low, high = cloud.min(0), cloud.max(0)
    scale = min((width - 60) / max(high[0] - low[0], 1e-9), (height - 44) / max(high[1] - low[1], 1e-9))
    middle = (low + high) / 2

    def at(p) -> str:
        return f"{width / 2 + (p[0] - middle[0]) * scale:.1f} {height / 2 - (p[1] - middle[1]) * scale:.1f}"

    parts = []
    for points in seen.values():
        along = points[np.argsort(points @ np.linalg.svd(points - points.mean(0))[2][0])] if len(points) > 1 else points
        parts.append(f'<path class="bar" d="M{"L".join(at(p) for p in along)}"/>')
    for points in seen.values():
        parts += [f'<circle class="pin" r="2.6" cx="{at(p).split()[0]}" cy="{at(p).split()[1]}"/>' for p in points]
    parts += [f'<circle class="held" r="4.2" cx="{at(p).split()[0]}" cy="{at(p).split()[1]}"/>' for p in held]
    return f'<svg class="outline" viewBox="0 0 {width} {height}" aria-hidden="true">{"".join(parts)}</svg>'


async def store_sample(service: Service, owner: str, name: str) -> Thing:
    """Store a sample as the owner's: with its measured runs as a study, else as a mechanism."""
    if name not in {sample.name for sample in samples()}:
        raise Problem("not-found", f"There is no sample {name[:80]!r}.")
    folder = SAMPLES / name
    files = {DRAWING: folder / DRAWING, **await _meshes(service, name)}
    study = folder / "measured" / STUDY
    if not study.exists():
        return store_mechanism(service, owner, files)
    told = json.loads(study.read_text(encoding="utf-8"))
    files |= {one["tracks"]: study.parent / one["tracks"] for one in told["experiments"]}
    with tempfile.TemporaryDirectory(dir=service.settings.scratch) as scratch:
        path = Path(scratch) / STUDY
        path.write_text(json.dumps({**told, "mechanism": DRAWING}), encoding="utf-8")
        return store_study(service, owner, {**files, STUDY: path})


async def _meshes(service: Service, name: str) -> dict[str, Path]:
    """The sample's meshes by their uri, drawn by CadQuery the first time; none where it is not installed."""
    there = SAMPLES / name
    if not any((there / "meshes").glob("*.stl")):
        there = place(service, f"sample-{name}")
        if not any((there / "meshes").glob("*.stl")):
            try:
                await linktwin(service, "export", str(SAMPLES / name / "design.py"), f"--out={there}")
            except Problem:
                return {}
    return {f"meshes/{path.name}": path for path in (there / "meshes").glob("*.stl")}
