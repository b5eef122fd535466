"""Where loose pins lie before the release: pressed to a side of their holes, nobody knows to which.

A motion begins with every pin in the middle of its hole. Frames before the release show the mechanism as its weight or
a hand held it: its pins lie off by the play, and with them what hangs on them, by ways that closing the joints allows.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from backend.fit.prediction import look
from backend.fit.run import Run
from backend.model.system import system
from backend.simulate import kinematics


def lying(run: Run, joints: Sequence[str]) -> Float[np.ndarray, "samples ways"]:
    """What each way in which the mechanism may lie adds to the samples before the release, per metre of play: of every
    loose pin along x and y of its hole, and of the mechanism along its free motions, for what lies off is not held.
    """
    made = system(run.model)
    pose, slots = run.found.reference, run.model.topology.slots
    slopes = np.asarray(kinematics.rows(made, kinematics.bodies(made, pose)).jacobian)
    count = len(run.model.topology.joint_ids)
    dense = np.zeros((count, 6, slots + 1, 6))  # what stands still comes last
    for j, (a, b) in enumerate(np.minimum(made.pairs, slots)):
        dense[j, :, a] += slopes[j, :, :6]
        dense[j, :, b] += slopes[j, :, 6:]
    held = made.held_rows
    closing = np.linalg.pinv(dense[:, :, :slots].reshape(count * 6, -1)[held.ravel()], rcond=1e-9)
    number = np.cumsum(held.ravel()).reshape(held.shape) - 1
    pins = [number[run.model.topology.joint_ids.index(j), row] for j in joints for row in (0, 1)]
    openings = closing[:, pins].reshape(slots, 6, len(pins))
    slope = np.array(look(run.model, pose, jnp.asarray(np.concatenate([openings, run.found.motions], -1)))[1])
    points = slope[count : count + 3 * len(run.model.marker_ids), len(pins) :]
    slope[:, len(pins) :] /= np.maximum(np.abs(points).max(0, initial=0.0), 1e-12)  # a metre of the farthest marker
    column = run.data.column
    inside = run.data.still & (column < len(slope))
    return np.where(inside[:, None], slope[np.where(inside, column, 0)], 0.0)


def aside(left: Sequence[np.ndarray], still: Sequence[np.ndarray], channel: Sequence[np.ndarray]) -> float:
    """p of how far the frames before the release lie aside, by what is left of each experiment's samples [sigmas].

    What lies aside does so all the while: of each channel the mean tells it, where the samples' own spread hides it.
    still: which of them are before the release; 1.0 where none or all are. What is missed after it counts as noise.
    """
    power, ways = 0.0, 0
    for r, held, of in zip(left, still, channel, strict=True):
        for own in (held & (of == c) for c in np.unique(of[held])):
            power, ways = power + r[own].sum() ** 2 / own.sum(), ways + 1
    after = np.concatenate([r[~held] for r, held in zip(left, still, strict=True)])
    return float(chdtrc(ways, power / max(np.mean(after**2), 1.0))) if ways and after.size else 1.0
