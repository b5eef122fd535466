"""The withheld-effect check from end to end: draw, seal, diagnose, reveal, score."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from backend.blind.withheld.case import ALL, Limits, draw_case
from backend.blind.withheld.mechanisms import DEVELOPED, UNSEEN
from backend.blind.withheld.naive import most_frequent, regression
from backend.blind.withheld.score import ALPHA, Facts, Scores, scores
from backend.blind.withheld.seal import SEAL, generator_version, is_sealed, revealed, seal
from backend.blind.withheld.verdict import judged, unanswered
from backend.blind.withheld.write import write_case

DEVELOPMENT = range(10_000)
TEST = range(1_000_000, 2_000_000)
DRAWING = 0.08  # of the whole: what making the cases takes beside diagnosing them
BASELINES = ("most frequent", "derivatives")
DRAWN, ANSWERS, NAIVE, SCORES = "drawn.jsonl", "answers.jsonl", "naive.jsonl", "scores.json"

Diagnose = Callable[[Path, frozenset[str]], dict[str, Any]]
Progress = Callable[[float, str], None]


class Cancelled(Exception):
    """The caller wanted no more; what is done is kept, and the next run goes on from there."""


def run_blind(
    seed: int,
    n: int,
    out: Path,
    diagnose: Diagnose,
    *,
    test: bool = False,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    resume: bool = True,
    workers: int = 1,
    limits: Limits = ALL,
    alpha: float = ALPHA,
) -> Scores:
    """Draw n studies, seal what is amiss with them, diagnose each, and score the answers.

    diagnose: (study.json, kinds removed from the library) -> gap.json's content.  test: seeds of TEST, which hold
    mechanisms that development never sees; without it seeds of DEVELOPMENT.  progress(share, words);
    cancelled() is asked after each case.  workers: processes that draw and diagnose (diagnose must then pickle).
    alpha: the rate of false alarms that the diagnosis promises.
    Under `out`: studies/, seal.json before the first answer, labels.json, answers.jsonl as answers come, scores.json.
    Raises ValueError for a seed out of its range or a folder of another check, Cancelled.
    """
    check_seed(seed, test)
    check_limits(limits, test)
    if n < 1:
        raise ValueError(f"n is {n}; ask for at least 1 case")
    tell = progress or (lambda share, words: None)
    halt = cancelled or (lambda: False)
    out.mkdir(parents=True, exist_ok=True)
    if not resume:
        for name in (SEAL, DRAWN, ANSWERS, NAIVE, SCORES):
            (out / name).unlink(missing_ok=True)
    if not is_sealed(out, seed, n, limits):
        (out / ANSWERS).unlink(missing_ok=True)
        _draw(seed, n, out, test, limits, tell, halt, workers)
    sha = json.loads((out / SEAL).read_text())["sha256"]
    tell(DRAWING, f"sealed {n} cases: {sha}")
    labels = json.loads((out / "labels.json").read_text())["labels"]
    _answer(labels, out, diagnose, tell, halt, workers)
    result = scored(out, alpha)
    tell(1.0, f"scored {n} cases")
    return result


def check_seed(seed: int, test: bool) -> None:
    """ValueError where a development run asks for a test seed, or a test run for a development seed."""
    allowed = TEST if test else DEVELOPMENT
    if seed not in allowed:
        kept = "test seeds need test=True (--test)" if seed in TEST else "use one of the range"
        raise ValueError(
            f"seed {seed} is outside {allowed.start} to {allowed.stop - 1}, the seeds of "
            f"{'tests' if test else 'development'}; {kept}"
        )


def scored(out: Path, alpha: float = ALPHA) -> Scores:
    """Scores of the answers in a folder, once its labels are found to be those that were sealed; writes scores.json.

    Raises ValueError where a label was changed.
    """
    sealed = json.loads((out / SEAL).read_text())
    facts, *naive = facts_of(out)
    result = Scores(
        seed=sealed["seed"],
        cases=len(facts),
        sha256=sealed["sha256"],
        version=sealed["version"],
        scores=scores(facts, alpha),
        baselines={name: scores(found) for name, found in zip(BASELINES, naive, strict=True)},
    )
    (out / SCORES).write_text(result.model_dump_json(indent=1))
    (out / "cases.jsonl").write_text("".join(json.dumps(f) + "\n" for f in facts))
    return result


def facts_of(out: Path) -> tuple[Facts, ...]:
    """What is so of each answered case of a folder: of the diagnosis, then of each of BASELINES.

    Raises ValueError where a label is not the one that was sealed.
    """
    labels = revealed(out)
    answers = {entry["case"]: entry["gap"] for entry in _lines(out / ANSWERS)}
    naive = {entry["case"]: entry["gap"] for entry in _lines(out / NAIVE)}
    common = most_frequent(labels)
    given = (answers, dict.fromkeys(answers, common), {i: naive[i] for i in answers if i in naive})
    return tuple([{"case": i, **judged(labels[i], gap)} for i, gap in sorted(gaps.items())] for gaps in given)


def check_limits(limits: Limits, test: bool) -> None:
    """ValueError where a name is no mechanism's, or that of one that development must not see."""
    allowed = [*DEVELOPED, *(UNSEEN if test else ())]
    if strange := [name for name in limits.mechanisms if name not in allowed]:
        raise ValueError(f"there is no mechanism {strange[0]!r} to draw; choose among {', '.join(allowed)}")


def _draw(
    seed: int,
    n: int,
    out: Path,
    test: bool,
    limits: Limits,
    tell: Progress,
    halt: Callable[[], bool],
    workers: int,
) -> None:
    """Write all studies and the regression's answers, then seal the labels; a run that was stopped goes on."""
    stamp = {"seed": seed, "version": generator_version(), **limits.stamp}
    drawn = {e["case"]: e for e in _lines(out / DRAWN) if stamp.items() <= e.items() and e["case"] < n}
    jobs = [(seed, i, str(_folder(out, i)), test, limits) for i in range(n) if i not in drawn]
    with (out / DRAWN).open("a") as file:
        for i, label, gap in _all(_drawn, jobs, workers):
            drawn[i] = {"case": i, "label": label, "gap": gap, **stamp}
            file.write(json.dumps(drawn[i]) + "\n")
            file.flush()
            tell(DRAWING * len(drawn) / n, f"drew case {len(drawn)} of {n}")
            if halt() and len(drawn) < n:
                raise Cancelled(f"stopped with {len(drawn)} of {n} cases drawn; run again to go on")
    (out / NAIVE).write_text("".join(json.dumps({"case": i, "gap": drawn[i]["gap"]}) + "\n" for i in range(n)))
    seal([drawn[i]["label"] for i in range(n)], out, seed, limits)
    (out / DRAWN).unlink()


def _drawn(job: tuple[int, int, str, bool, Limits]) -> tuple[int, dict[str, Any], dict[str, Any]]:
    seed, i, folder, unseen, limits = job
    case = draw_case(seed, i, unseen=unseen, limits=limits)
    write_case(case, Path(folder))
    return i, case.label, regression(case)


def _answer(
    labels: list[dict[str, Any]],
    out: Path,
    diagnose: Diagnose,
    tell: Progress,
    halt: Callable[[], bool],
    workers: int,
) -> None:
    """Diagnose what is not yet answered; each answer is on disk before the next begins."""
    done = {entry["case"] for entry in _lines(out / ANSWERS)}
    jobs = [
        (diagnose, i, str(_folder(out, i) / "study.json"), frozenset(label["without"]))
        for i, label in enumerate(labels)
        if i not in done
    ]
    started, count = time.perf_counter(), 0
    with (out / ANSWERS).open("a") as file:
        if halt():
            raise Cancelled(f"stopped with {len(done)} of {len(labels)} answers; run again to go on")
        for i, gap, took in _all(_diagnosed, jobs, workers):
            file.write(json.dumps({"case": i, "gap": gap, "seconds": round(took, 2)}) + "\n")
            file.flush()
            count += 1
            left = (time.perf_counter() - started) / count * (len(jobs) - count)
            share = (len(done) + count) / len(labels)
            tell(DRAWING + (1 - DRAWING) * share, f"diagnosed {len(done) + count} of {len(labels)}, {left:.0f} s left")
            if halt() and count < len(jobs):
                raise Cancelled(f"stopped with {len(done) + count} of {len(labels)} answers; run again to go on")


def _diagnosed(job: tuple[Diagnose, int, str, frozenset[str]]) -> tuple[int, dict[str, Any], float]:
    diagnose, i, study, without = job
    started = time.perf_counter()
    try:
        gap = diagnose(Path(study), without)
    except Exception as error:  # one study without an answer must not take the others' with it
        gap = unanswered(f"{type(error).__name__}: {error}")
    return i, gap, time.perf_counter() - started


def _all(work: Callable[[Any], Any], jobs: list[Any], workers: int) -> Iterator[Any]:
    """Results as they come, here or in other processes."""
    if workers <= 1:
        yield from map(work, jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            yield from (done.result() for done in as_completed([pool.submit(work, job) for job in jobs]))
        finally:
            pool.shutdown(cancel_futures=True)


def _folder(out: Path, i: int) -> Path:
    return out / "studies" / f"{i:04d}"


def _lines(path: Path) -> list[dict[str, Any]]:
    """Entries of a table of lines; one cut short by a crash is left out."""
    entries = []
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            entries.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return entries


__all__ = ["DEVELOPMENT", "TEST", "Cancelled", "Limits", "facts_of", "generator_version", "run_blind", "scored"]
