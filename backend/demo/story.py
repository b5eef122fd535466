"""From drawing to prediction in one go: what `linktwin demo` runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from backend.demo.reality import FRAMES_PER_S, HELD_S, LOAD_N, TRUTH, filmed, real_motion, with_load_and_pivots
from backend.fit.fit_study import fit_study
from backend.fit.result import FitResult
from backend.mechanism.read import read_mechanism, read_study, write_mechanism, write_study
from backend.mechanism.study import ExperimentFile, Release, Study, StudyFile
from backend.observe.measure import track_video
from backend.observe.stills import stills
from backend.report.demo_page import write_demo_page
from backend.report.evidence import DemoEvidence
from backend.report.fit_summary import fit_evidence
from cad_export import export_script

FREE = tuple(TRUTH)
STEP_S = 1.0 / 3840.0  # a step a frame would err by 0.12 mm of motion, ten times what tracking does; this by 0.4 µm
LOADS_N = {"swing": 0.0, "loaded": LOAD_N}
STILLS = (0.0, 0.25, 0.5)  # parts of the clip


class Advance(Protocol):
    """Tell how far the story is: a part of the whole, from 0 to 1, and what is being done."""

    def __call__(self, part: float, words: str = "") -> None: ...  # noqa: D102


@dataclass
class Clock:
    """What was done, and how long it took [s]."""

    steps: list[tuple[str, float]] = field(default_factory=list)

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Note the time of a step."""
        began = time.perf_counter()
        yield
        self.steps.append((what, time.perf_counter() - began))


def run_demo(script: Path, out: Path, advance: Advance) -> tuple[Path, FitResult]:
    """Draw, film, track, fit and predict; returns the page and the fit. Everything it rests on stays in `out`."""
    clock = Clock()
    advance(0.0, "drawing the linkage in CadQuery")
    with clock.timed("drawing"):
        path = export_script(script, out / "drawing")
        drawn = with_load_and_pivots(read_mechanism(path))
        write_mechanism(drawn, path)
    advance(0.05, "moving the real one in Exudyn, with friction the drawing lacks")
    with clock.timed("the real motion, by Exudyn,"):
        real = {name: real_motion(drawn, load) for name, load in LOADS_N.items()}
    everywhere = {f"{name}.{marker}": p for name, (_, places) in real.items() for marker, p in places.items()}
    for i, (name, (times_s, places)) in enumerate(real.items()):
        begin, share = 0.15 + 0.2 * i, 0.1
        clip = out / f"{name}.mp4"
        with clock.timed(f"filming {name}"):
            bed = filmed(clip, times_s, places, everywhere, _part(advance, begin, share, f"filming {name}"))
        with clock.timed(f"tracking {name}"):
            track_video(
                clip, drawn, bed, out_dir=out / name, progress=_part(advance, begin + share, share, f"tracking {name}")
            )
    with clock.timed("fitting"):
        study = _study(out, path)
        result = fit_study(study, FREE, step_s=STEP_S, progress=lambda part, words: advance(0.55 + 0.35 * part, words))
    result.write(out)
    advance(0.9, "simulating the unseen load")
    with clock.timed("predicting"):
        evidence = fit_evidence(study, result, truth=TRUTH)
    page = write_demo_page(
        DemoEvidence(
            fit=evidence,
            reality=_reality(),
            frames=len(real["swing"][0]),
            frames_per_s=FRAMES_PER_S,
            stills=stills(out / "swing.mp4", STILLS),
            prediction=tuple(c for c in evidence.channels if c.use == "held_out"),
            unseen=f"A line pulled the coupler down with {LOAD_N} N, which the fit never saw.",
            steps=tuple(clock.steps),
            files=tuple(str(p.relative_to(out)) for p in _files(out)),
        ),
        out / "demo.html",
    )
    advance(1.0, "done")
    return page, result


def _study(out: Path, mechanism: Path) -> Study:
    """Both clips as experiments: the swing may be fitted, the loaded one only predicted."""
    experiments = tuple(
        ExperimentFile(
            id=name,
            use="held_out" if load else "fit",
            tracks=f"{name}/tracks.csv",
            video=f"{name}.mp4",
            release=Release(time_s=HELD_S),
            overrides={"load": {"force_n": load}} if load else {},
        )
        for name, load in LOADS_N.items()
    )
    path = out / "study.json"
    write_study(StudyFile(mechanism=str(mechanism.relative_to(out)), experiments=experiments), path)
    return read_study(path)


def _reality() -> str:
    return (
        "The real linkage was moved by Exudyn, an engine that shares nothing with the one that fits. Its crank bearing "
        "A rubs with a constant torque and its rocker bearing D with one that grows with speed. The drawing knows "
        "neither. Both were fitted to the tracks of the first clip alone."
    )


def _part(advance: Advance, begin: float, share: float, words: str):
    """Progress of one step as part of the whole."""
    return lambda done, total: advance(begin + share * done / max(total, 1), words)


def _files(out: Path) -> list[Path]:
    kept = [p for pattern in ("*.json", "*.mp4", "*/tracks.csv", "drawing/mechanism.json") for p in out.glob(pattern)]
    return sorted(p for p in kept if not p.name.endswith(".truth.json"))
