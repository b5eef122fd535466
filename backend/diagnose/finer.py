"""What is unknown, finer in time: a base that moves, told from forces at a joint and from shifts of the picture.

A table that gives, a floor that shakes or a hand that holds the rig moves faster than a mechanism swings. Every body
feels minus the base's acceleration beside its weight, and a camera that stands still sees everything moved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from backend.diagnose.bumps import bells, width
from backend.diagnose.fitted import Fitted
from backend.diagnose.probe import Probe
from backend.diagnose.seer import Seer
from backend.diagnose.subject import Subject

WORLD, CAMERA = "world", "camera"
APART = 0.5  # natural times between bumps
MOST = 96  # of them within a record


def finer_responses(
    subject: Subject, fitted: Fitted, joints: Sequence[str] = ()
) -> dict[str, Float[np.ndarray, "n bumps"]]:
    """Whitened responses about a fit to bumps of the base's displacement, of the picture's, and of the force at these
    joints, all as fine, lest a place be the likelier for being the finer. Columns: see `base_response`.

    Nothing where no marker was seen: an encoder does not tell a base that moves from forces at joints.
    """
    if not subject.axes:
        return {}
    pushes = {f"joint:{id}": (subject.joints.index(id) - len(subject.joints) - len(subject.axes),) for id in joints}
    made = {place: _whitened(subject, fitted, drives) for place, drives in pushes.items()}
    return {WORLD: base_response(subject, fitted), CAMERA: _whitened(subject, fitted, ()), **made}


def base_response(subject: Subject, fitted: Fitted) -> Float[np.ndarray, "n bumps"]:
    """Of the base alone; columns run over experiments, axes, then bumps in time."""
    return _whitened(subject, fitted, range(-len(subject.axes), 0), moved=True)


def knots(subject: Subject, probe: Probe) -> Float[np.ndarray, " bumps"]:
    """Middles of the bumps [s after the release], one beyond either end: what begins and ends within a record is seldom
    at a turning point there.
    """
    count = int(np.clip(np.ceil(probe.duration_s / (APART * float(subject.model.scale.time_s))), 4, MOST))
    return probe.duration_s / count * np.arange(-1.0, count + 2)


def displacement(time_s: Float[np.ndarray, " n"], knots_s: Float[np.ndarray, " bumps"]) -> Float[np.ndarray, "n bumps"]:
    """Of the base by bumps of one metre, none at the release and before."""
    return bells(np.maximum(time_s, 0.0), knots_s) - bells(np.zeros(1), knots_s)


def _acceleration(time_s: Float[np.ndarray, " n"], knots_s: Float[np.ndarray, " bumps"]) -> np.ndarray:
    """Its second derivative [m/s² for a metre]."""
    sd = width(knots_s)
    return (((time_s[:, None] - knots_s) / sd) ** 2 - 1.0) * bells(time_s, knots_s) / sd**2


def _whitened(
    subject: Subject, fitted: Fitted, drives: Sequence[int], moved: bool = False
) -> Float[np.ndarray, "n bumps"]:
    """Of all experiments. drives: columns of their records; none stands for shifts of the picture along every axis.
    moved: whether the drives are accelerations of the base, whose displacement is seen.
    """
    seer = Seer(subject, fitted.probes, fitted.fraction)
    along = len(drives) or len(subject.axes)
    ends = np.cumsum([0, *(along * knots(subject, p).size for p in fitted.probes)])
    made = np.zeros((seer.count, ends[-1]))

    def one(i: int) -> None:
        probe = fitted.rough[i]
        middles = knots(subject, probe)
        if drives:
            found = _driven(fitted, i, drives, (_acceleration if moved else bells)(_nodes(probe), middles))
        else:
            found = np.zeros((probe.data.time_s.size, along, middles.size))
        if moved or not drives:
            found = found + _seen_moved(subject, probe, displacement(probe.since_release_s, middles))
        made[seer.rows[i], ends[i] : ends[i + 1]] = seer.white[i](found.reshape(found.shape[0], -1))

    subject.over(one, range(len(fitted.rough)))
    return made


def _nodes(probe: Probe) -> Float[np.ndarray, " nodes"]:
    return probe.step_s * np.arange(probe.bumps.shape[0])


def _driven(
    fitted: Fitted, i: int, drives: Sequence[int], shapes: Float[np.ndarray, "nodes bumps"]
) -> Float[np.ndarray, "samples drives bumps"]:
    """What the motion of one experiment does, as many bumps at once as its program has room for."""
    probe = fitted.rough[i]
    room, values, own = probe.bumps.shape[1], fitted.gliding, fitted.own(i)
    parts = range(0, shapes.shape[1], room)
    return np.nan_to_num(
        np.concatenate([probe.drive_slopes(values, own, drives, shapes[:, k : k + room]) for k in parts], 2)
    )


def _seen_moved(
    subject: Subject, probe: Probe, moved: Float[np.ndarray, "samples bumps"]
) -> Float[np.ndarray, "samples axes bumps"]:
    """What a camera that stands still sees of everything moved along each axis."""
    axis = np.array([c.coordinate[0] if c.at.startswith("marker:") else "" for c in probe.data.channels])
    on = axis[probe.data.channel][:, None] == np.array(subject.axes)
    return on[:, :, None] * moved[:, None, :]
