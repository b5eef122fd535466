"""How long a rolling shutter takes from a picture's first row to its last, told by the motion itself.

Bars keep their lengths.  Read row by row, the ends of a bar that moves along itself are caught at different times, and
the bar seems longer or shorter: 3.5 ms are a millimetre for a bar of a third of the picture at 1 m/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.observe.bars import Bar
from backend.observe.bed import Bed

LONGEST_S = 0.05  # no camera takes longer
CLEAR = 5.0  # deviations from zero, or from what the bed file says
WORTH_S = 2e-4  # 0.1 mm at 1 m/s and half a picture apart
BLOCKS = 16  # of the clip: errors of one block may all be alike, those of two are not
ROUNDS, HUBER = 6, 1.5  # of reweighting, and where it begins [robust sd]
FEWEST = 24  # pictures of a bar


@dataclass(frozen=True)
class Readout:
    """Time from the first row to the last [s], and its deviation."""

    seconds: float
    sd_s: float


def dated(bed: Bed, found: Readout | None) -> tuple[Bed, list[str]]:
    """The bed with the readout to date points by, and what is to be said of it: the file's own, else what was found."""
    if found is None:
        return bed, []
    told = f"{1e3 * found.seconds:.2f} ± {1e3 * found.sd_s:.2f} ms"
    if "readout_s" in bed.model_fields_set:
        if abs(found.seconds - bed.readout_s) < max(CLEAR * found.sd_s, WORTH_S):
            return bed, []
        return bed, [
            f"readout_s is given as {1e3 * bed.readout_s:.2f} ms, but bars keep their lengths with {told}. Leave it "
            "out of the bed file to have points dated by that, or check bed marks and lens."
        ]
    if not max(CLEAR * found.sd_s, WORTH_S) < found.seconds < LONGEST_S:
        return bed, []
    return bed.model_copy(update={"readout_s": found.seconds}), [
        f"The camera reads a picture's rows one after another: bars keep their lengths with a readout_s of {told}. "
        "Points are dated by it; write it into the bed file for other clips at this setting."
    ]


def readout_of(
    time_s: Float[np.ndarray, " frame"],
    at_m: Float[np.ndarray, "frame marker 2"],
    row: Float[np.ndarray, "frame marker"],
    bars: Sequence[Bar],
) -> Readout | None:
    """The readout that keeps bars at one length each; None where too little moves, or is seen, to tell.

    at_m: places on the bed, each picture as of one time; NaN where not seen.  row: 0 first, 1 last.

    The length itself is free for every bar, and so is what a lens or a height a little wrong does to it: a change with
    the bar's place and, twice, with its direction.
    """
    if len(time_s) < FEWEST:
        return None
    near, far = _speed(time_s, at_m, 1), _speed(time_s, at_m, 2)
    bend = np.gradient(near, time_s, axis=0)
    near[~np.isfinite(bend)] = np.nan
    late = row[..., None] - 0.5  # against the middle row, where what bends a path matters least
    block = (np.arange(len(time_s)) * BLOCKS) // len(time_s)
    told = [made for bar in bars if (made := _stretched(bar, at_m, near * late, far * late)) is not None]
    if not told:
        return None
    seconds, score, spread = 0.0, np.zeros(BLOCKS), 1.0
    for _ in range(ROUNDS):
        level = at_m - seconds * late * near + 0.5 * (seconds * late) ** 2 * bend
        left = [s.left(np.hypot(*(level[s.known, s.bar.a] - level[s.known, s.bar.b]).T)) for s in told]
        spread = max(1.4826 * float(np.median(np.abs(np.concatenate(left)))), 1e-9)
        score, power, noise = np.zeros(BLOCKS), 0.0, 0.0
        for s, off in zip(told, left, strict=True):
            weight = np.minimum(1.0, HUBER * spread / np.maximum(np.abs(off), 1e-15)) / spread**2
            np.add.at(score, block[s.known], weight * s.far * off)
            power, noise = power + np.sum(weight * s.far * s.near), noise + np.sum(weight * s.far**2)
        if not power > 0:
            return None
        seconds += float(score.sum()) / power
    # Sixteen blocks tell their own scatter badly: never less than independent noise gives.
    return Readout(float(seconds), float(np.sqrt(max(np.sum(score**2) * BLOCKS / (BLOCKS - 1), noise)) / power))


@dataclass(frozen=True)
class _Stretched:
    """How a bar's length changes with the readout, by nearer and by wider speeds; `other`: what else may change it."""

    bar: Bar
    known: np.ndarray
    near: np.ndarray
    far: np.ndarray
    other: np.ndarray

    def left(self, length_m: np.ndarray) -> np.ndarray:
        return length_m - self.other @ (self.other.T @ length_m)


def _stretched(bar: Bar, at_m: np.ndarray, near: np.ndarray, far: np.ndarray) -> _Stretched | None:
    apart, middle = at_m[:, bar.a] - at_m[:, bar.b], (at_m[:, bar.a] + at_m[:, bar.b]) / 2
    along = [np.sum(apart * (v[:, bar.a] - v[:, bar.b]), 1) / np.hypot(*apart.T) for v in (near, far)]
    known = np.flatnonzero(np.isfinite(along).all(0))
    if known.size < FEWEST:
        return None
    turn = 2 * np.arctan2(apart[known, 1], apart[known, 0])
    other = _span(np.c_[np.ones(known.size), middle[known], np.cos(turn), np.sin(turn)])
    by_near, by_far = (v[known] - other @ (other.T @ v[known]) for v in along)
    return _Stretched(bar, known, by_near, by_far, other)


def _speed(time_s: np.ndarray, at_m: np.ndarray, step: int) -> np.ndarray:
    """Central differences over so many pictures each way; NaN at the ends.

    Speeds carry noise, which alone would make the readout too small.  Those of other pictures have other noise: the
    wider differences serve as instruments for the nearer ones (Reiersøl 1945).
    """
    made = np.full(at_m.shape, np.nan)
    span = time_s[2 * step :] - time_s[: -2 * step]
    made[step:-step] = (at_m[2 * step :] - at_m[: -2 * step]) / span[:, None, None]
    return made


def _span(columns: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n r"]:
    U, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0).clip(1e-300), full_matrices=False)
    return U[:, s > 1e-6 * s[0]]


def error_of_readout_m(
    time_s: Float[np.ndarray, " frame"], at_m: Float[np.ndarray, "frame marker 2"], row: np.ndarray, sd_s: float
) -> float:
    """Deviation per axis [m], over all points, of dating them by a readout that is known to so much."""
    moved = _speed(time_s, at_m, 1) * row[..., None]
    return sd_s * float(np.sqrt(np.nanmean(moved**2)))
