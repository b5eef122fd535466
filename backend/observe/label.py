"""Which dot is which: the drawing names the dots of the first picture.

A mechanism that moves in the bed's plane is put together on the dots, in whatever pose it stands (assembly.py).  Any
other is taken as drawn: its markers are projected into the picture and matched one to one with the dots that were
found; where the drawing as a whole sits elsewhere (bed marks taken from another origin, a rig that was turned), it is
first moved, turned and scaled onto the dots.  What stays doubtful is refused, not guessed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from backend.observe.tracking_error import TrackingError

Points = Float[np.ndarray, "n 2"]
Way = tuple[float, tuple[int, ...]]  # a misfit, and each marker's dot
CLEAR = 0.5  # a dot is a marker's own when it is less than half as far as any other dot
RIVAL = 2.0  # another arrangement that fits less than twice as badly makes the picture ambiguous
CLOSE = 0.25  # of the largest misfit that is allowed: two ways that both fit better than this are alike
LOOSE = 2.0  # times as far off as usual, by which dots near their drawn places speak against an arrangement elsewhere
SCALES = (0.5, 2.0)
TRIED = 24


class Assembling(Protocol):
    """All ways in which a mechanism can be put together on dots, some of them known; loose: less exactly than usual."""

    def __call__(self, dots_px: Points, held: Int[np.ndarray, "m"], loose: float = 1.0) -> list[Way]:
        """Best first."""
        ...


def drawn_positions(mechanism: Any) -> dict[str, Float[np.ndarray, "3"]]:
    """World position [m] of every marker at the drawn pose: p_WM = p_WB + R_WB @ p_BM."""
    poses = {body.id: body.pose for body in mechanism.bodies}
    return {
        m.id: np.asarray(poses[m.body].position_m, float)
        + rotation(poses[m.body].quaternion_wxyz) @ np.asarray(m.position_m, float)
        for m in mechanism.markers
    }


def rotation(quaternion_wxyz: Sequence[float]) -> Float[np.ndarray, "3 3"]:
    """The matrix of a unit quaternion [w, x, y, z]."""
    w, v = quaternion_wxyz[0], np.asarray(quaternion_wxyz[1:], float)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def label_dots(
    expected_px: Mapping[str, Float[np.ndarray, "2"]],
    dots_px: Points,
    reach_px: float,
    clicks: Mapping[str, Sequence[float]] | None = None,
    assembling: Assembling | None = None,
) -> dict[str, int]:
    """The index of each marker's dot.

    expected_px: where the drawing puts each marker.  reach_px: how far a click may lie from its dot.  assembling: all
    ways in which the mechanism can be put together on dots, some of them known, as in assembly.py.
    Raises TrackingError, with counts and names, when dots are too few or the answer is doubtful.
    """
    names, dots = list(expected_px), np.asarray(dots_px, float)
    if not len(dots):
        raise TrackingError(
            f"{len(names)} markers are drawn, and no target lies clear of the edge of the first picture. Begin where "
            "all are farther inside (--from SECONDS)."
        )
    fixed = _clicked(clicks or {}, names, dots, reach_px)
    expected = np.array([expected_px[n] for n in names], float).reshape(-1, 2)
    if len(dots) < len(names):
        near = _cost(expected, dots)
        rows, columns = linear_sum_assignment(near)
        order = sorted(zip(near[rows, columns], rows, strict=True))
        lonely = sorted(set(range(len(names))) - {int(r) for _, r in order})
        raise TrackingError(
            f"{len(names)} markers are drawn but {len(dots)} dots are seen in the first picture; without a dot: "
            f"{', '.join(names[k] for k in lonely)}. Start the clip with every dot in view, or leave markers "
            "that carry no dot out of the drawing."
        )
    if len(fixed) == len(names):
        return fixed
    held = np.array([fixed.get(n, -1) for n in names])
    as_drawn, *elsewhere = _placings(expected, dots, held)
    index = _assign(as_drawn, dots, held)
    unclear = _doubtful(as_drawn, dots, index, held)
    if assembling and (ways := assembling(dots, held)):
        worst, drawn_way = RIVAL * ways[0][0] + CLOSE, tuple(index.tolist())
        likely = [dot for misfit, dot in ways if misfit <= worst]
        if len(likely) > 1 and not unclear and any(misfit <= worst for misfit, _ in assembling(dots, index)):
            likely = [drawn_way]
        if len(likely) == 1 and not unclear and likely[0] != drawn_way and assembling(dots, index, LOOSE):
            likely.append(drawn_way)  # stickers a little farther off than is allowed, and a stranger that fits
        if len(likely) == 1:
            return dict(zip(names, likely[0], strict=True))
        unclear = [k for k in range(len(names)) if len({dot[k] for dot in likely}) > 1]
        elsewhere = []
    elif not unclear:
        return dict(zip(names, index.tolist(), strict=True))
    sound: list[tuple[float, tuple[int, ...]]] = []
    for moved in elsewhere:
        fit = _similar(moved, dots[_assign(moved, dots, held)])
        index = _assign(fit, dots, held)
        if not _doubtful(fit, dots, index, held):
            sound.append((float(np.sqrt(((fit - dots[index]) ** 2).sum(1).mean())), tuple(index.tolist())))
    sound.sort()
    if sound:
        rivals = [rms for rms, index in sound if index != sound[0][1]]
        if not rivals or rivals[0] > RIVAL * sound[0][0] + 1.0:
            return dict(zip(names, sound[0][1], strict=True))
    raise TrackingError(
        f"{len(names)} markers are drawn and {len(dots)} dots are seen, but it is doubtful which dots are "
        f"{', '.join(names[k] for k in unclear)}. Click one or more of these dots, or start the clip at the drawn pose."
    )


def check_clicked(clicks: Iterable[str], markers: Sequence[str]) -> None:
    """Refuse clicks on what is not drawn.  Raises TrackingError."""
    if unknown := sorted(set(clicks) - set(markers)):
        raise TrackingError(f"Clicks name unknown markers {', '.join(unknown)}; the drawing has {', '.join(markers)}.")


def _clicked(clicks: Mapping, names: list[str], dots: Points, reach_px: float) -> dict[str, int]:
    check_clicked(clicks, names)
    found: dict[str, int] = {}
    for name, at in clicks.items():
        away = np.hypot(*(dots - np.asarray(at, float)).T)
        k = int(away.argmin())
        if away[k] > reach_px:
            raise TrackingError(
                f"The click for {name} at ({at[0]:.0f}, {at[1]:.0f}) is {away[k]:.0f} px from the nearest dot; "
                f"click within {reach_px:.0f} px of its centre, in the first picture."
            )
        if k in found.values():
            other = next(n for n, i in found.items() if i == k)
            raise TrackingError(f"The clicks for {name} and {other} fall on the same dot; click each on its own.")
        found[name] = k
    return found


def _cost(a: Points, b: Points) -> Float[np.ndarray, "a b"]:
    return np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))


def _assign(expected: Points, dots: Points, held: Int[np.ndarray, "m"]) -> Int[np.ndarray, "m"]:
    cost = _cost(expected, dots)
    for row, column in enumerate(held):
        if column >= 0:
            cost[:, column], cost[row, column] = 1e9, 0.0
    return linear_sum_assignment(cost)[1]


def _doubtful(expected: Points, dots: Points, index: np.ndarray, held: np.ndarray) -> list[int]:
    cost = _cost(expected, dots)
    own = cost[np.arange(len(index)), index]
    cost[np.arange(len(index)), index] = np.inf
    other = cost.min(1) if cost.shape[1] > 1 else np.full(len(index), np.inf)
    return np.flatnonzero((own > CLEAR * other) & (held < 0)).tolist()


def _similar(source: Points, target: Points) -> Points:
    """Source moved, turned and scaled onto target by least squares (complex numbers: w = a z + b)."""
    z, w = source @ [1, 1j], target @ [1, 1j]
    dz = z - z.mean()
    a = np.vdot(dz, w - w.mean()) / max(np.vdot(dz, dz).real, 1e-12)
    moved = a * dz + w.mean()
    return _flat(moved)


def _flat(z: np.ndarray) -> Points:
    return np.stack([np.real(z), np.imag(z)], 1)


def _placings(expected: Points, dots: Points, held: np.ndarray) -> list[Points]:
    """The drawing where it was drawn, or where the clicks put it, then its most promising other places."""
    z, w, known = expected @ [1, 1j], dots @ [1, 1j], np.flatnonzero(held >= 0)
    if len(known) >= 2 and np.abs(z[known] - z[known[0]]).max() > 0:
        dz = z[known] - z[known].mean()
        a = np.vdot(dz, w[held[known]] - w[held[known]].mean()) / np.vdot(dz, dz).real
        b = w[held[known]].mean() - a * z[known].mean()
        return [_flat(a * z + b)]
    shift = (w[held[known]] - z[known]).mean() if len(known) else 0
    placed = [_flat(z + shift)]
    if len(z) < 3:
        return placed
    p, q = np.unravel_index(_cost(expected, expected).argmax(), (len(z), len(z)))
    if z[p] == z[q]:
        return placed
    i, j = (k.ravel() for k in np.meshgrid(np.arange(len(w)), np.arange(len(w)), indexing="ij"))
    a = (w[j] - w[i]) / (z[q] - z[p])
    plausible = (np.abs(a) > SCALES[0]) & (np.abs(a) < SCALES[1])
    i, a = i[plausible], a[plausible]
    moved = a[:, None] * (z - z[p]) + w[i][:, None]
    misfit = np.array([np.abs(m[:, None] - w).min(1).sum() for m in moved])
    best = moved[np.argsort(misfit)[:TRIED]]
    return placed + [_flat(m) for m in best]
