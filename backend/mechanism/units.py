"""Tables in another unit than the contract's: places in centimetres, times in milliseconds, noise in millimetres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from backend.mechanism.columns import plane_axis
from backend.mechanism.constraints import size_m
from backend.mechanism.effect import kind_named
from backend.mechanism.loops import connectivity
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.ratios import times
from backend.mechanism.seen import Series, pairs, reach_m, recorded, seen
from backend.mechanism.study import Experiment

if TYPE_CHECKING:
    import pandas as pd

FAR = 100.0  # times all that the parts measure together: no mechanism reaches so far, and millimetres are a thousand
WIDE = 5.0  # times the same, for a box around all that hangs on pins: its diagonal cannot be above 2 √3 of them
SCALED = 10.0  # between drawn and seen: no drawing and no camera is off by so much
ALIKE = 1.3  # by which pairs seen in one unit may differ in it
RESIZED, AGREED = 1.2, 1.08  # seen over drawn, or the reverse, beyond any camera's error; and by which pairs may differ
LEAST = 0.02  # of what the parts measure together: a pair that is closer tells no scale
LENGTHS = {"mm": 1000.0, "cm": 100.0, "inches": 1.0 / 0.0254}
SELDOM_S = 1.0  # between samples: cameras and encoders that record a motion are quicker
SLOW = 100.0  # times as long as a mechanism takes to fall by its own length: a swing of minutes on a table
FEW = 10  # still frames that do not yet tell how far they scatter
STRONG = 50.0  # times weight times size: at so many g a mechanism would fly apart; motors of linkages give one or two
G_M_PER_S2 = 9.81
WIDER = 100.0  # noise as stated over what still frames show: who is cautious states three times as much
BLIND = 0.02  # of what the parts measure together: who states so much noise sees no motion


def far_tracks(tracks: pd.DataFrame, mechanism: Mechanism) -> Iterator[str]:
    """A sentence where markers are seen so far from each other, or from where they are drawn, that their places can be
    in no metres.
    """
    series, reach = seen(tracks, mechanism), reach_m(mechanism)
    if series and reach:
        for look in (_other_unit, _far_off, _over_wide):
            if sentence := look(series, mechanism, reach):
                yield sentence
                return


def _other_unit(series: list[Series], mechanism: Mechanism, reach: float) -> str | None:
    """Distances on one body are in the drawing's proportions, and many times as large."""
    told = [pair for pair in pairs(series) if pair.drawn_m > 1e-3 * reach]
    ratios = np.array([pair.seen_m / pair.drawn_m for pair in told])
    scale = float(np.median(ratios)) if told else 0.0
    if scale < SCALED or not np.all((ratios < ALIKE * scale) & (ratios * ALIKE > scale)):
        return None
    far = max(told, key=lambda pair: pair.seen_m)
    if far.seen_m < reach:  # names that were mixed up stay within the mechanism
        return None
    unit = next((name for name, size in LENGTHS.items() if abs(scale / size - 1.0) < 0.1), None)
    remedy = f"these in {unit}: divide x_m, y_m and z_m by {LENGTHS[unit]:.4g}" if unit else "correct their unit"
    others = f", as are all {len(told)} such pairs" if len(told) > 1 else ""
    return (
        f'markers "{far.one.marker}" and "{far.other.marker}" are seen {far.seen_m:.4g} m apart, and drawn '
        f"{far.drawn_m:.4g} m apart on one body: {scale:.0f} times as far{others}; places are in m, {remedy}"
    )


def _far_off(series: list[Series], mechanism: Mechanism, reach: float) -> str | None:
    away = [float(np.median(np.sqrt(np.nansum((one.places_m - one.drawn_m) ** 2, axis=1)))) for one in series]
    if (most := max(away)) <= FAR * reach:
        return None
    return (
        f'marker "{series[away.index(most)].marker}" is seen {most:.4g} m from where it is drawn (the median), '
        f"{times(most / reach)} times what all parts measure together, {reach:.3g} m; places are in m (1 mm is 0.001), "
        "in the drawing's world frame"
    )


def _over_wide(series: list[Series], mechanism: Mechanism, reach: float) -> str | None:
    """What pins hold to the ground reaches no farther than its parts; what slides, or flies, may go anywhere."""
    pins = ("revolute", "fixed", "spherical", "universal")
    if connectivity(mechanism).floating or any(joint.type not in pins for joint in mechanism.joints):
        return None
    sides = []
    for column in np.transpose([_ends(one) for one in series], (2, 0, 1)):
        known = column[np.isfinite(column)]
        sides.append(float(np.ptp(known)) if known.size else 0.0)
    width = float(np.linalg.norm(sides))
    if width <= WIDE * reach:
        return None
    return (
        f"its markers are seen over {width:.4g} m, {times(width / reach)} times what all parts measure together, "
        f"{reach:.3g} m, and pins hold them; places are in m (1 mm is 0.001, 1 cm 0.01)"
    )


def _ends(one: Series) -> np.ndarray:
    """Between which places a marker stays, but for a twentieth of its samples on each side (2, 3) [m]."""
    ends = np.full((2, 3), np.nan)
    for axis, x in enumerate(one.places_m.T):
        if np.isfinite(x).any():
            ends[:, axis] = np.quantile(x[np.isfinite(x)], [0.05, 0.95])
    return ends


def unit_findings(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Warnings where times are likely in ms, the noise of tracks in mm, and places in another scale."""
    yield from _resized(experiment, mechanism)
    yield from _slow(experiment, mechanism)
    yield from _wide_noise(experiment, mechanism)
    yield from _strong_torques(experiment, mechanism)


def _resized(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Distances on bodies are all drawn in one other scale, which is no unit's: a reference of another length."""
    if experiment.tracks is None:
        return
    reach, axis = reach_m(mechanism), plane_axis(mechanism)
    told = [
        pair for pair in pairs(seen(experiment.tracks, mechanism)) if pair.drawn_m > LEAST * reach and pair.whole(axis)
    ]
    ratios = np.array([pair.seen_m / pair.drawn_m for pair in told])
    if len(told) < 2 or np.min(ratios) <= 0.0:
        return
    scale = float(np.median(ratios))
    if max(scale, 1.0 / scale) > RESIZED and np.all((ratios < AGREED * scale) & (ratios * AGREED > scale)):
        far = max(told, key=lambda pair: pair.drawn_m)
        yield (
            f'markers "{far.one.marker}" and "{far.other.marker}" are seen {1e3 * far.seen_m:.4g} mm apart, and drawn '
            f"{1e3 * far.drawn_m:.4g} mm apart on one body: {scale:.3g} times as far, as are all {len(told)} such "
            "pairs; check the length that the tracks were scaled with, and the drawing's size"
        )


def _slow(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Times in which nothing that gravity moves could take so long; or of which the release was not made one.

    A record that shows a motion has its samples close to each other beside it: only the drawing tells what is slow.
    """
    widest = max(recorded(experiment, mechanism), key=lambda found: float(np.std(found[2])), default=None)
    if widest is None:
        return
    where, time, x, _ = widest
    interval, release = float(np.median(np.diff(time))), experiment.release.time_s
    if interval < SELDOM_S:
        return
    remedy = "times are in s: divide time_s by 1000 where they are ms, and release.time_s where it is one of them"
    if interval == 1.0 and np.all(time == np.round(time)):
        remedy = "times are in s: where time_s counts frames, divide it by the frames per second"
    rate = float(np.sqrt(np.mean((np.diff(x) / np.diff(time)) ** 2)))
    takes, falls = float(np.std(x)) / rate if rate else 0.0, _falls_in_s(mechanism)
    if falls and takes > SLOW * falls:
        yield (
            f"{where} is sampled every {interval:.4g} s and moves in the course of {takes:.3g} s, "
            f"{times(takes / falls)} times as long as a mechanism so large takes to fall; {remedy}"
        )
    elif experiment.release.at_rest and 0.0 < release - time[0] < interval:
        yield (
            f"{where} is sampled every {interval:.4g} s, and release.time_s, {release:g} s, comes before its second "
            f"sample: {remedy}"
        )


def _falls_in_s(mechanism: Mechanism) -> float | None:
    """sqrt(length / gravity); None where gravity may not be what moves it: across its plane, on slides alone, or where
    a path is prescribed.
    """
    gravity = np.abs(np.array(mechanism.gravity_m_per_s2))
    size, axis = float(np.linalg.norm(gravity)), plane_axis(mechanism)
    led = any(effect.kind == "prescribed_motion" for effect in mechanism.effects)
    turns = any(joint.type not in ("prismatic", "fixed") for joint in mechanism.joints)
    if led or not turns or not size or (axis is not None and gravity[axis] > 0.9 * size):
        return None
    return float(np.sqrt(reach_m(mechanism) / size))


def _wide_noise(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """The first marker whose still frames belie what noise is stated: others will be like it."""
    tracks = experiment.tracks
    if tracks is None or not experiment.release.at_rest:
        return
    reach, release = reach_m(mechanism), experiment.release.time_s
    names, sigmas = tracks["marker"].to_numpy(str), tracks["sigma_m"].to_numpy(float)
    stills = tracks["time_s"].to_numpy(float) < release
    for one in seen(tracks, mechanism):
        stated = sigmas[stills & (names == one.marker)]
        still = one.places_m[one.time_s < release]
        if len(still) < FEW or not np.isfinite(stated).any():
            continue
        sigma = float(np.nanmedian(stated))
        scatter = max((float(np.std(x[np.isfinite(x)])) for x in still.T if np.isfinite(x).any()), default=0.0)
        if sigma > max(WIDER * scatter, BLIND * reach):
            yield (
                f'marker "{one.marker}" has sigma_m {sigma:.3g} m, and its {len(still)} still frames scatter by '
                f"{scatter:.2g} m; where the former is in mm, divide it by 1000, or leave it empty to have it estimated"
            )
            return


def _strong_torques(experiment: Experiment, mechanism: Mechanism) -> Iterator[str]:
    """Recorded torques that no mechanism of such masses could bear for long. A force may well be as large: a press."""
    if experiment.inputs is None:
        return
    size = size_m(mechanism)
    mass = sum(body.moving_inertial().mass_kg for body in mechanism.moving_bodies())
    for effect in mechanism.effects:  # what a gear makes of a motor's rotor is moved, too
        turned = effect.parameters.get("kg_m2")
        mass += turned / size**2 if isinstance(turned, float) else 0.0
    kinds = {effect.id: kind_named(effect.kind) for effect in mechanism.effects}
    for (effect, parameter), rows in experiment.inputs.groupby(["effect", "parameter"], sort=False):  # type: ignore[misc]
        spec = kinds[str(effect)].parameters[str(parameter)]
        usual = float(np.median(np.abs(rows["value"].to_numpy(float))))
        if spec.unit == "N m" and (share := usual / (mass * G_M_PER_S2 * size)) > STRONG:
            yield (
                f'effect "{effect}" {parameter} is {usual:.4g} N m on record (the median), {times(share)} times the '
                f"weight of all that moves, {mass * G_M_PER_S2:.3g} N, on the mechanism's size, {size:.3g} m; torques "
                "are in N m: divide N mm by 1000"
            )
