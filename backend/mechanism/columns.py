"""Coordinates in one another's columns: seen where the drawing's joints let nothing move, or as in a mirror."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.constraints import drawn
from backend.mechanism.loops import connectivity
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.mobility import joint_axes, plane_normal
from backend.mechanism.seen import Series, instants, reach_m, seen
from backend.mechanism.tracks import PLACES

if TYPE_CHECKING:
    import pandas as pd

ALONG = 0.999  # cosine of the angle to one of the world's axes, up to which a plane counts as lying across it
MOVES, MOVES_ALONE = 0.5, 0.05  # along the joints' axes, of what moves across them; where one of two was not measured
LEAST = 0.01  # of what the parts measure together: less may be noise, or a camera that leans
ASIDE = 0.05  # of the same, between markers: more than what a plate in front of a bar is drawn too near
SMOOTH = 0.1  # of the variance: what samples differ by from one to the next, where a motion and no noise is seen
MIRRORED = 5.0  # times as near to the drawing's mirror image as to the drawing


def column_findings(tracks: pd.DataFrame, mechanism: Mechanism) -> Iterator[str]:
    """Warnings that name the columns and what was seen in them."""
    series, reach = seen(tracks, mechanism), reach_m(mechanism)
    if series and reach and not connectivity(mechanism).floating:
        axis = plane_axis(mechanism)
        sentence = None if axis is None else _moves_along(series, axis, reach)
        sentence = sentence or _in_a_mirror(series, mechanism, axis, reach)
        if sentence:
            yield sentence


def plane_axis(mechanism: Mechanism) -> int | None:
    """Along which coordinate (0, 1, 2) of W nothing moves, as it is that of all joints' axes; None where none is."""
    joints = list(mechanism.joints)
    if any(joint.type == "cylindrical" for joint in joints):
        return None
    normal = plane_normal(joints, joint_axes(mechanism, joints, drawn(mechanism)))
    # A row of slides has no axis of its own: any normal to them would do.
    if normal is None or all(joint.type in ("prismatic", "fixed") for joint in joints):
        return None
    axis = int(np.argmax(np.abs(normal)))
    return axis if abs(normal[axis]) > ALONG else None


def _moves_along(series: list[Series], axis: int, reach: float) -> str | None:
    sizes = np.array([_motion(series, at) for at in range(3)])
    first, second = (at for at in range(3) if at != axis)
    less, more = (first, second) if sizes[first] < sizes[second] else (second, first)
    column, other = PLACES[axis], PLACES[less]
    least = (MOVES if sizes[less] else MOVES_ALONE) * sizes[more]
    if sizes[axis] > max(least, LEAST * reach):
        fault = f"move by {1e3 * sizes[axis]:.3g} mm (rms) in {column}"
    elif not any(one.measured[less] for one in series) and (off := _misplaced(series, axis)) > ASIDE * reach:
        fault = f"stand {1e3 * off:.3g} mm (rms) to both sides of where they are drawn in {column}"
    else:
        return None
    beside = f"they move by {1e3 * sizes[less]:.3g} mm in {other}" if sizes[less] else f"{other} shows nothing"
    return (
        f"its markers {fault}, along the axes of all joints, where the drawing lets nothing move, and {beside}; check "
        f"that {column} and {other} are not in each other's place"
    )


def _misplaced(series: list[Series], axis: int) -> float:
    """How far the markers stand from where they are drawn along a coordinate, but for what they share (rms) [m]."""
    off = [float(np.nanmedian(one.places_m[:, axis])) - one.drawn_m[axis] for one in series if one.measured[axis]]
    return float(np.std(off)) if off else 0.0


def _motion(series: list[Series], axis: int) -> float:
    """How far the markers move along a coordinate, as rms of them all [m]; 0 where none was measured."""
    squares = []
    for one in series:
        x = one.places_m[:, axis][np.isfinite(one.places_m[:, axis])]
        if one.body and one.measured[axis] and x.size > 2:
            variance = float(np.var(x))
            smooth = 0.5 * float(np.mean(np.diff(x) ** 2)) < SMOOTH * variance
            squares.append(variance if smooth else 0.0)
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def _in_a_mirror(series: list[Series], mechanism: Mechanism, axis: int | None, reach: float) -> str | None:
    """Whether bodies are seen as their mirror images: so two columns in each other's place, or a wrong sign, show."""
    across = [at for at in range(3) if at != axis]
    whole = [one for one in series if one.measured[across].all()]
    as_drawn = as_mirrored = count = 0.0
    names: list[str] = []
    for points in _bodies(whole, mechanism, axis, reach).values():
        moving = [one for one in points if one.time_s.size]
        if len(points) <= len(across) or not (when := instants(moving)).size:
            continue
        there = np.array([_held(one, when)[:, across] for one in points]).swapaxes(0, 1)
        direct, mirrored = _misfits(np.array([one.drawn_m[across] for one in points]), there)
        if mirrored < direct:
            names += [one.marker for one in moving if one.marker not in names]
        as_drawn, as_mirrored, count = as_drawn + direct, as_mirrored + mirrored, count + there.shape[0] * len(points)
    off = np.sqrt(as_drawn / count) if count else 0.0
    if off < LEAST * reach or as_mirrored * MIRRORED**2 > as_drawn:
        return None
    columns = " and ".join(PLACES[at] for at in across) if axis is not None else "x_m, y_m and z_m"
    return (
        f"markers {', '.join(names[:6])} are seen as in a mirror: {1e3 * off:.3g} mm (rms) from the bodies as drawn, "
        f"and {1e3 * np.sqrt(as_mirrored / count):.3g} mm from their mirror images; check that {columns} are not in "
        "each other's place, and their signs"
    )


def _bodies(series: list[Series], mechanism: Mechanism, axis: int | None, reach: float) -> dict[str, list[Series]]:
    """Moving body -> what is seen of it: its markers, its pivots on the ground, and markers that sit on its pins."""
    fixed = {body.id for body in mechanism.bodies if body.fixed}
    found: dict[str, list[Series]] = {}
    for one in series:
        found.setdefault(one.body, []).append(one)
    for joint in mechanism.joints:
        if joint.type not in ("revolute", "spherical", "universal"):
            continue
        sides = ["" if body in fixed else body for body in (joint.body_a, joint.body_b)]
        p_WJ = mechanism.body(joint.body_a).pose.place(joint.frame_a.position_m)
        for here, there in (sides, sides[::-1]):
            if there == "":
                found.setdefault(here, []).append(Series(joint.id, here, p_WJ, np.zeros(0), p_WJ[None]))
            for one in series:
                if one.body == there and there and _at(one.drawn_m, p_WJ, axis) < 1e-3 * reach:
                    found.setdefault(here, []).append(one)
    return {body: points for body, points in found.items() if body}


def _at(point: np.ndarray, pin: np.ndarray, axis: int | None) -> float:
    apart = point - pin
    return float(np.linalg.norm(apart if axis is None else np.delete(apart, axis)))


def _held(one: Series, when: np.ndarray) -> np.ndarray:
    """Its places at some instants; those of a pivot on the ground are where it is drawn."""
    return one.at(when) if one.time_s.size else np.broadcast_to(one.places_m, (when.size, 3))


def _misfits(shape: np.ndarray, there: np.ndarray) -> tuple[float, float]:
    """Summed squares of what remains between points as drawn (n, d) and as seen (k, n, d) when the drawing is moved to
    where it fits best, and when its mirror image is (Kabsch 1976) [m²].
    """
    P, Q = shape - shape.mean(axis=0), there - there.mean(axis=1, keepdims=True)
    crossed = np.einsum("ni,knj->kij", P, Q)
    sizes = np.linalg.svd(crossed, compute_uv=False)
    sign = np.where(np.linalg.det(crossed) < 0.0, -1.0, 1.0)
    sum_of_squares = np.sum(P**2) + np.sum(Q**2, axis=(1, 2))
    rest, last = np.sum(sizes[:, :-1], axis=1), sign * sizes[:, -1]
    direct, mirrored = (np.maximum(sum_of_squares - 2.0 * (rest + side * last), 0.0) for side in (1.0, -1.0))
    return float(np.sum(direct)), float(np.sum(mirrored))
