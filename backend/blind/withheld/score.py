"""Scores of a whole check: each a number with a 95% interval, how many cases it rests on, and its target."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel

from backend.blind.withheld.interval import bootstrap, wilson

ALPHA = 0.05


class Score(BaseModel):
    """A score: its value (None of no cases), 95% interval, the cases behind it, and what was aimed at."""

    name: str
    value: float | None
    low: float | None
    high: float | None
    cases: int
    target: str
    met: bool | None


class Scores(BaseModel):
    """All scores of one way to diagnose, by name, and of the naive ways on the same studies."""

    seed: int
    cases: int
    sha256: str
    version: str
    scores: dict[str, Score]
    baselines: dict[str, dict[str, Score]]

    def table(self) -> str:
        """The scores as text, beside the naive baselines."""
        others = list(self.baselines)
        head = ["score", "cases", "value", "95%", "target", "", *others]
        rows = [head]
        for name, score in self.scores.items():
            mark = {True: "met", False: "missed", None: ""}[score.met]
            beside = [_shown(self.baselines[other][name].value) for other in others]
            span = "" if score.low is None else f"{_shown(score.low)}-{_shown(score.high)}"
            rows.append([name, str(score.cases), _shown(score.value), span, score.target, mark, *beside])
        widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
        return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def _shown(value: float | None) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.3f}"


Facts = Sequence[Mapping[str, Any]]


def scores(facts: Facts, alpha: float = ALPHA) -> dict[str, Score]:
    """Every score from the facts of all cases (verdict.judged).

    alpha: the rate of false alarms that the diagnosis promises.
    """
    none = [f for f in facts if f["stratum"] == "none"]
    clear = [f for f in facts if f["bin"] == ">100"]
    of: Callable[[Facts, str], Facts] = lambda group, stratum: [f for f in group if f["stratum"] == stratum]  # noqa: E731
    single, pair, left, never = (of(clear, s) for s in ("single", "pair", "left_out", "never"))
    faint = [f for f in facts if f["bin"] == "9-100" and f["stratum"] == "single"]
    unseen = [f for f in facts if f["bin"] == "<9" and f["stratum"] == "single"]
    two_sigma = 2 * np.sqrt(alpha * (1 - alpha) / max(len(none), 1))
    made = [
        _share("false alarms", [f["verdict"] != "none" for f in none], alpha + two_sigma, below=True),
        _share("cause first", [f["top1"] for f in single], 0.92),
        _share("cause among two", [f["top2"] for f in single], 0.97),
        _share("place first", [f["place"] for f in single], 0.92),
        _share("outside: unknown", [f["verdict"] == "unknown" for f in never], 0.92),
        _share("outside: sure and wrong", [f["sure_and_wrong"] for f in never], 0.03, below=True),
        _share("left out: not sure and wrong", [not f["sure_and_wrong"] for f in left], 0.92),
        _share("pair: both", [f["both"] for f in pair], 0.70),
        _share("pair: one and no wrong", [f["part"] for f in pair], 0.90),
        _mean("Brier", [(f["top"] - f["top1"]) ** 2 for f in [*none, *clear]], 0.10),
        # Where the truth bears several names that data cannot tell apart, a fair answer shares its belief among them.
        _mean("Brier, all true names", [(f["right"] - 1.0) ** 2 for f in [*none, *clear]], 0.10),
        _coverage(clear),
        _median("held-out gap explained", [f["explained"] for f in single if f["explained"] is not None], 0.95),
        _share("faint: in the reported set", [f["reported"] for f in faint], 0.90),
        _share("no answer", [f["verdict"] == "failed" for f in facts], 0.0, below=True),
        _share("too small to see: none", [f["verdict"] == "none" for f in unseen], None),
    ]
    return {score.name: score for score in made}


def _share(name: str, hits: Sequence[bool], target: float | None, below: bool = False) -> Score:
    low, high = wilson(sum(hits), len(hits))
    value = sum(hits) / len(hits) if hits else None
    met = None if value is None or target is None else value <= target if below else value >= target
    words = "" if target is None else f"{'<=' if below else '>='} {target:.3g}"
    return Score(name=name, value=value, low=low, high=high, cases=len(hits), target=words, met=met)


def _mean(name: str, values: Sequence[float], target: float) -> Score:
    low, high = bootstrap(values, np.mean)  # type: ignore[arg-type]
    value = float(np.mean(values)) if values else None
    words = f"<= {target:.2f}"
    met = None if value is None else value <= target
    return Score(name=name, value=value, low=_real(low), high=_real(high), cases=len(values), target=words, met=met)


def _median(name: str, values: Sequence[float], target: float) -> Score:
    low, high = bootstrap(values, np.median)  # type: ignore[arg-type]
    value = float(np.median(values)) if values else None
    met = None if value is None else value >= target
    words = f">= {target:.2f}"
    return Score(name=name, value=value, low=_real(low), high=_real(high), cases=len(values), target=words, met=met)


def _coverage(facts: Facts) -> Score:
    """Of 90% intervals: some 85 to 95 of a hundred should hold the truth."""
    hits = [held for f in facts for held in f["covered"]]
    score = _share("90% intervals hold", hits, None)
    met = None if score.value is None else 0.85 <= score.value <= 0.95
    return score.model_copy(update={"target": "0.85-0.95", "met": met})


def _real(value: float) -> float | None:
    return value if np.isfinite(value) else None
