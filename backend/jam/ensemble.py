"""From tolerances to risk: how likely a drawing jams where its values scatter, and which of them drive that."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from backend.jam.batch import CHUNK, Verdicts
from backend.jam.chunks import SCHEDULER, Job, answers, content_of
from backend.jam.distribution import Varied, varied
from backend.jam.follow import Progress
from backend.jam.kept import KeptChunks
from backend.jam.run import steps_of
from backend.jam.sensitivity import FEWEST, Design, Indices, design, indices
from backend.mechanism.apart import set_apart
from backend.mechanism.ensemble_report import EnsembleReport, Share, ShownSamples, Throughput, VariedParameter
from backend.mechanism.mechanism import Mechanism

MOST_SAMPLES = 10_000_000  # whose table of a hundred parameters still fits into memory
MOST_SHOWN = 2000  # dots that a picture can part
MUCH_CUT = 0.02  # of a distribution: beyond, what was asked for is not what was sampled
MOST_NAMED = 3  # parameters in the sentence
MUCH_LOST = 0.01  # of the samples


@dataclass(frozen=True)
class Ensemble:
    """A report, every sample in SI (`design.values`, columns as in `report.parameters`) and what came of each."""

    report: EnsembleReport
    design: Design
    verdicts: Verdicts

    def write(self, path: Path) -> Path:
        """Every sample as a row of a CSV table: values in SI, independent, jammed, lost, onset_s; returns its path."""
        table = pd.DataFrame(self.design.values, columns=[p.name for p in self.report.parameters])
        seen = self.verdicts
        outcome = {
            "independent": self.design.independent,
            "jammed": seen.jammed,
            "lost": seen.lost,
            "onset_s": seen.onset_s,
        }
        table.assign(**outcome).to_csv(path, index=False)
        return path


def ensemble(
    mechanism: Mechanism,
    specs: Sequence[str],
    samples: int = 10_000,
    duration_s: float = 1.0,
    step_s: float = 1e-3,
    *,
    seed: int = 0,
    chunk: int = CHUNK,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Ensemble:
    """Jam probability of a drawing let go from rest, its values scattered as the specs say (`distribution.py`).

    n (d + 2) of the samples give the Sobol' indices of d parameters, n the largest power of two that fits.  One
    process, or the workers of the scheduler that DASK_SCHEDULER_ADDRESS names.  checkpoint: where finished chunks are
    kept, to be removed once what came of them is safe.  resume: go on from those that lie there.  Raises ValueError
    with the remedy.
    """
    steps_of(duration_s, step_s)
    if not 1 <= samples <= MOST_SAMPLES:
        raise ValueError(f"{samples} samples were asked for; ask for 1 to {MOST_SAMPLES}")
    mechanism = set_apart(mechanism)
    several, _ = varied(mechanism, specs)
    table = design([one.distribution for one in several], samples, seed)
    document = json.dumps(mechanism.model_dump(mode="json", exclude_none=True))
    job = Job(document, tuple(specs), duration_s, step_s, chunk)
    kept = KeptChunks.of(checkpoint, content_of(job, table.values), resume=resume) if checkpoint else None
    seen, speed = _answered(job, table, kept, progress)
    if seen.lost[table.independent].all():
        raise ValueError(
            f"every one of {samples} samples was lost: look at one with `linktwin jam` or `simulate` first"
        )
    return Ensemble(_report(mechanism.name, several, table, seen, speed, seed, duration_s, step_s), table, seen)


def _answered(
    job: Job, table: Design, kept: KeptChunks | None, progress: Progress | None
) -> tuple[Verdicts, Throughput]:
    """Verdicts of all samples, put where their chunk's number says; throughput of those that were not kept."""
    count = len(table.values)
    jammed, rests, lost = (np.zeros(count, dtype=bool) for _ in range(3))
    onset, answered, begun = np.full(count, np.nan), np.zeros(count, dtype=int), time.perf_counter()
    first, others, chunks = 0.0, 0, 0

    def put(place: slice, seen: Verdicts) -> None:
        jammed[place], rests[place], onset[place], lost[place] = seen.jammed, seen.rests, seen.onset_s, seen.lost
        answered[place] += 1

    done = dict(kept.ends) if kept else {}
    for start, seen in done.items():
        put(slice(start, start + len(seen.jammed)), seen)
    for place, seen in answers(job, table.values, done):
        put(place, seen)
        if kept:
            kept.note(place.start, seen)
        chunks += 1
        if chunks == 1:
            first = time.perf_counter() - begun
        else:
            others += len(seen.jammed)
        if progress:
            progress(int(answered.sum()), count)
    if (answered != 1).any():
        raise RuntimeError(f"{int((answered != 1).sum())} samples were not answered exactly once")
    wall = time.perf_counter() - begun
    processes = f"workers of {os.environ[SCHEDULER]}" if os.environ.get(SCHEDULER) else "one process"
    rate = others / (wall - first) if others else None
    return Verdicts(jammed, rests, onset, lost), Throughput(
        wall_s=wall, first_chunk_s=first, samples_per_s=rate, chunk=job.chunk, chunks=chunks, processes=processes
    )


def _report(
    name: str,
    several: tuple[Varied, ...],
    table: Design,
    seen: Verdicts,
    speed: Throughput,
    seed: int,
    duration_s: float,
    step_s: float,
) -> EnsembleReport:
    alone = table.independent
    counted = alone & ~seen.lost
    jammed, known, missing = int(seen.jammed[counted].sum()), int(counted.sum()), int((alone & seen.lost).sum())
    low, high = stats.binomtest(jammed, known).proportion_ci(method="wilson")
    found = indices(table, seen.jammed, seen.lost)
    since = seen.onset_s[counted & seen.jammed]
    parameters = tuple(_parameter(k, one, found) for k, one in enumerate(several))
    shown = np.flatnonzero(alone)
    # Evenly from all that is independent: the scrambled net comes first, the rest after.
    shown = shown[np.unique(np.linspace(0, len(shown) - 1, min(MOST_SHOWN, len(shown))).round().astype(int))]
    return EnsembleReport(
        mechanism=name,
        sentence=_sentence(jammed / known, (low, high), known, parameters),
        warnings=tuple(_warnings(table, several, seen, found)),
        samples=len(table.values),
        independent=known,
        jammed=jammed,
        lost=int(seen.lost.sum()),
        probability=jammed / known,
        probability_ci95=(float(low), float(high)),
        probability_range=(jammed / (known + missing), (jammed + missing) / (known + missing)),
        onset_s=tuple(map(float, np.quantile(since, [0.05, 0.5, 0.95]))) if since.size else None,  # type: ignore[arg-type]
        parameters=parameters,
        index_rows=found.rows if found else 0,
        seed=seed,
        duration_s=duration_s,
        step_s=step_s,
        shown=ShownSamples(
            values=tuple(tuple(map(float, column)) for column in table.values[shown].T),
            jammed=tuple(map(bool, seen.jammed[shown])),
            lost=tuple(map(bool, seen.lost[shown])),
        ),
        throughput=speed,
    )


def _parameter(k: int, one: Varied, found: Indices | None) -> VariedParameter:
    def share(value: np.ndarray, ci95: np.ndarray) -> Share:
        return Share(value=float(value[k]), ci95=(float(ci95[k, 0]), float(ci95[k, 1])))

    return VariedParameter(
        name=one.parameter.name,
        unit=one.parameter.unit,
        distribution=one.written,
        within=one.distribution.within,
        first_order=share(found.first, found.first_ci95) if found else None,
        total=share(found.total, found.total_ci95) if found else None,
    )


def _sentence(probability: float, ci95: tuple[float, float], known: int, parameters: Sequence[VariedParameter]) -> str:
    said = f"It jams in {_percent(probability)} of cases (95%: {_percent(ci95[0])} to {_percent(ci95[1])})"
    ranked = sorted((p for p in parameters if p.total), key=lambda p: -p.total.value if p.total else 0.0)
    if not ranked:
        return f"{said}, from {known} samples."
    share = ranked[0].total.value if ranked[0].total else 0.0
    # Those whose interval reaches the greatest share may be the strongest as well.
    alike = [p.name for p in ranked if p.total and p.total.ci95[1] >= share][:MOST_NAMED]
    if len(alike) == 1:
        return f"{said}; {alike[0]} has most to do with it (total share {share:.2f})."
    return f"{said}; most to do with it have {' and '.join(alike)}, which the samples do not tell apart."


def _percent(share: float) -> str:
    """A share as a percentage with two digits of what is smaller, it or its rest: 0.034%, 12%, 99.7%."""
    rest = min(share, 1.0 - share)
    places = 0 if rest >= 0.1 else 1 if rest >= 0.01 or rest == 0.0 else 3
    return f"{100 * share:.{places}f}%"


def _warnings(table: Design, several: Sequence[Varied], seen: Verdicts, found: Indices | None) -> list[str]:
    samples, d = table.values.shape
    said = []
    if lost := int(seen.lost.sum()):
        much = "; the probability may be off by as much" if lost > MUCH_LOST * samples else ""
        said.append(
            f"{lost} of {samples} samples were lost: their loops could not be closed or a step could not be solved. "
            f"They count neither as jammed nor as free{much}."
        )
    if table.rows == 0:
        said.append(f"{samples} samples are too few for shares of {d} parameters: ask for {FEWEST * (d + 2)} or more.")
    elif found is None:
        said.append("All samples of the index matrices came out alike: there is no variance to share out.")
    for one in several:
        if (cut := 1.0 - one.distribution.within) > MUCH_CUT:
            p = one.parameter
            said.append(
                f"{_percent(cut)} of {one.written} is outside what {p.name} may be "
                f"({p.lower:g} to {p.upper:g} {p.unit}) and was never drawn."
            )
    return said
