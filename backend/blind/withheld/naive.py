"""Two naive ways to diagnose the same studies, to see what a real one is worth.

Most frequent cause: always the same answer.  Derivative regression: joint angles from the markers, rates and
accelerations by Savitzky and Golay (1964), then the one term that explains most of what the drawing misses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.signal import savgol_filter
from scipy.stats import f as fisher

from backend.blind.withheld.case import Case
from backend.blind.withheld.causes import KINDS, Rig
from backend.blind.withheld.detectability import SMALL, WITHOUT_SLOPE, Rival, rivals_of
from backend.blind.withheld.laws import Laws, as_drawn, changed
from backend.blind.withheld.plane import Tree, points, turned
from backend.blind.withheld.plant import Plant

NOT_FORCES = ("late_release", "release_velocity")
SIGNIFICANT = 0.01
LARGEST = 2 / SMALL  # of a step along a direction: twice the largest size that is drawn
ORDER = 5  # of the polynomial: a cubic flattens the accelerations of a lively rig by more than friction takes
SMOOTHED_S = 0.1  # of the filter's window
UNSTRETCHED = 1e3  # weight of a metre of open loop beside a metre of a marker


def most_frequent(labels: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The commonest kind of the whole check and its commonest place, said of every study."""
    kinds = Counter(effect["kind"] for label in labels for effect in label["effects"])
    if not kinds:
        return answer([], 1.0)
    kind, count = kinds.most_common(1)[0]
    on = Counter(tuple(e["on"]) for label in labels for e in label["effects"] if e["kind"] == kind).most_common(1)[0][0]
    where = next(e["places"][0] for lb in labels for e in lb["effects"] if (e["kind"], tuple(e["on"])) == (kind, on))
    share = count / len(labels)
    effect = {"kind": kind, "on": list(on), "parameters": {}}
    return answer([(effect, where, share)], 1.0 - share, verdict="identified")


def regression(case: Case) -> dict[str, Any]:
    """The single term that best explains the accelerations that are missing; none where it is insignificant."""
    moved = _motion(case)
    if moved is None:
        return answer([], 1.0)
    state, measured = moved
    drawn = as_drawn(case.linkage)
    ideal = _accelerations(case, drawn, state)
    missing = measured.ravel() - ideal
    terms, columns = [], []
    for rival in _dynamic(case):
        for way in rival.directions:
            terms.append(rival)
            columns.append(_accelerations(case, changed(drawn, way), state) - ideal)
    S = np.array(columns)
    keep = (S**2).sum(1) > 0
    S, terms = S[keep], [t for t, k in zip(terms, keep, strict=True) if k]
    amplitude = (S @ missing) / (S**2).sum(1)
    # No size beyond all that is drawn: without a bound, what hardly matters explains everything.
    most = np.array([LARGEST * KINDS[t.kind].high / KINDS[t.kind].low for t in terms])
    amplitude = np.clip(amplitude, [-m if t.signed else 0.0 for m, t in zip(most, terms, strict=True)], most)
    left = ((missing - amplitude[:, None] * S) ** 2).sum(1)
    whole = float(missing @ missing)
    # Neighbouring samples share the filter's window, so one in a window counts.
    free_samples = max(3.0, len(missing) / max(1.0, SMOOTHED_S * _rate(case)))
    best = int(np.argmin(left))
    gain = (whole - left[best]) / max(left[best] / (free_samples - 1), 1e-300)
    p = min(1.0, len(terms) * float(fisher.sf(gain, 1, free_samples - 1)))
    if p > SIGNIFICANT:
        return answer([], 1.0)
    evidence = -0.5 * free_samples * np.log(left / left[best])
    weight = np.exp(evidence) / np.exp(evidence).sum()
    order = np.argsort(-weight)[:8]
    told = [
        ({"kind": terms[i].kind, "on": list(terms[i].on), "parameters": {}}, terms[i].places[0], float(weight[i]))
        for i in order
    ]
    return answer(told, 0.0, verdict="identified" if weight[best] > 0.5 else "ambiguous")


def answer(told: Sequence[tuple[dict[str, Any], str, float]], none: float, verdict: str = "none") -> dict[str, Any]:
    """gap.json's content in brief: causes as (effect, place, probability), likeliest first."""
    places: dict[str, float] = {}
    for _, where, p in told:
        places[where] = places.get(where, 0.0) + p
    return {
        "schema_version": "1.0",
        "verdict": verdict,
        "where": {"locations": [{"at": at, "probability": p} for at, p in places.items()]},
        "causes": [{"effects": [effect], "probability": p} for effect, _, p in told],
        "probability_none": none,
        "probability_unknown": 0.0,
        "shrink": None,
    }


def _dynamic(case: Case) -> list[Rival]:
    """Every known cause that changes the forces."""
    none = np.zeros((len(case.linkage.pins), 2))
    rig = Rig(case.linkage, none, none)
    skipped = [n for n, k in KINDS.items() if k.at in ("camera", "marker") or n in NOT_FORCES or n in WITHOUT_SLOPE]
    return rivals_of(rig, [], skipped)


def _rate(case: Case) -> float:
    return 1.0 / float(np.median(np.diff(case.record.elapsed_s)))


def _motion(case: Case) -> tuple[np.ndarray, np.ndarray] | None:
    """State (rows, 2 n) and the movers' accelerations (rows, movers) of the fit experiments' frames after the release.

    None where a window does not fit.
    """
    window = max(9, 2 * round(SMOOTHED_S * _rate(case) / 2) + 1)
    q = _angles(case)
    after = case.record.since_release_s > 0
    if after.sum() <= 2 * window:
        return None
    h = 1.0 / _rate(case)
    moved = [np.asarray(savgol_filter(q, window, ORDER, deriv=d, delta=h, axis=1)) for d in range(3)]
    q, v, a = (m[:, after][:, window:-window].reshape(-1, m.shape[-1]) for m in moved)
    return np.concatenate([q, v], 1), a @ Tree(case.linkage).turned[list(case.linkage.movers)].T


def _accelerations(case: Case, laws: Laws, state: np.ndarray) -> np.ndarray:
    """What the movers' accelerations would be by laws (one row) at measured states, flat."""
    plant = Plant(case.linkage, laws.repeated(len(state)))
    movers = plant.tree.turned[list(case.linkage.movers)]
    return (plant.slope(0.0, state)[:, plant.n :] @ movers.T).ravel()


def _angles(case: Case) -> np.ndarray:
    """Tree coordinates (experiments, times, n) that bring the drawn markers nearest to the seen ones in each frame."""
    linkage, seen = case.linkage, case.places[: case.fit]
    count = len(seen)
    laws = as_drawn(linkage, count)
    plant = Plant(linkage, laws)
    tree, marks = plant.tree, linkage.markers
    inside = np.broadcast_to(np.array([p for _, _, p in marks]), (count, len(marks)))
    spots = points(tree, [b for _, b, _ in marks], inside, laws)
    q = np.zeros((count, tree.n))
    path = []
    for t in range(seen.shape[1]):
        found = np.isfinite(seen[:, t])
        for _ in range(30 if t == 0 else 3):
            now = turned(tree, q, 0 * q)
            p, J, _ = now.motion(spots)
            phi, Jc, _ = now.motion(plant.loops)
            miss = np.where(found, seen[:, t] - p, 0.0)
            # A wild point pulls no harder than one 3% of the rig away.
            pull = found / np.maximum(1.0, np.abs(miss) / (0.03 * linkage.size)) ** 0.5 if t else found * 1.0
            A = np.concatenate([J * pull[..., None], UNSTRETCHED * Jc], 1)
            r = np.concatenate([miss * pull, -UNSTRETCHED * phi], 1)
            A, r = np.concatenate([np.real(A), np.imag(A)], 1), np.concatenate([np.real(r), np.imag(r)], 1)
            H = A.transpose(0, 2, 1) @ A + 1e-9 * np.eye(tree.n)
            step = np.linalg.solve(H, (A.transpose(0, 2, 1) @ r[..., None]))[..., 0]
            q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(1, keepdims=True), 1e-12))
        path.append(q)
    return np.array(path).swapaxes(0, 1)
