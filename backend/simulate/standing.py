"""Whether a drawing stands where it may be let go: at the beginning of its prescribed paths, and within its ends."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from backend.effects.shapes import AbstractJointMotion, AbstractJointStop
from backend.joints.joint import TURN
from backend.model.model import Model
from backend.model.state import Pose, drawn_pose
from backend.model.system import System
from backend.simulate import kinematics
from backend.simulate.record import Series

SNAP = 1e-3  # rad, or mechanism lengths, that a prescribed path or an end may stand off the drawn pose
RIGID = 1e-12  # rad/(N m) or m/N: an end that gives way by less


def check_drives(model: Model, plant: System, inputs: Sequence[Series] = ()) -> None:
    """Refuse a prescribed path that begins elsewhere than the drawing: a step would have to bridge the gap.

    Raises ValueError naming the effect, its joint and both places.
    """
    drawn = _drawn_at(model, plant)
    first = {address: float(values[0]) for address, _, values in inputs}
    for placed in model.of(AbstractJointMotion):
        targets = np.asarray(jax.vmap(lambda e: e.target())(placed.here))
        for row, joint, target in zip(placed.rows, placed.at(), targets, strict=True):
            begins = first.get((placed.ids[row], "q"), float(target))
            unit, size = _unit(plant, joint)
            if abs(begins - drawn[joint]) > SNAP * size:
                raise ValueError(
                    f"effect '{placed.ids[row]}': the path of joint '{model.topology.joint_ids[joint]}' begins at "
                    f"{begins:.6g} {unit}, the drawing stands at {drawn[joint]:.6g} {unit}; let the path begin where "
                    "the joint is drawn, or draw the joint where the path begins"
                )


def check_ends(model: Model, plant: System) -> None:
    """Refuse a rigid end of travel that the drawing stands beyond: it would hold the joint where it never came.

    Raises ValueError naming the effect, its joint and both places.
    """
    drawn = _drawn_at(model, plant)
    for placed in model.of(AbstractJointStop):
        low, high = (np.asarray(end) for end in jax.vmap(lambda e: e.ends())(placed.here))
        give = np.asarray(jax.vmap(lambda e: e.wall().give)(placed.here))
        for n, joint in enumerate(placed.at()):
            unit, size = _unit(plant, joint)
            beyond = max(low[n] - drawn[joint], drawn[joint] - high[n])
            if give[n] < RIGID and beyond > SNAP * size:
                end = low[n] if drawn[joint] < low[n] else high[n]
                raise ValueError(
                    f"effect '{placed.ids[placed.rows[n]]}': joint '{model.topology.joint_ids[joint]}' is drawn at "
                    f"{drawn[joint]:.6g} {unit}, beyond its end of travel at {end:.6g} {unit}; correct "
                    "the end or the pose"
                )


def _drawn_at(model: Model, plant: System) -> Float[np.ndarray, "joints"]:
    return np.asarray(_coordinates(plant, drawn_pose(model, plant)))


@eqx.filter_jit
def _coordinates(plant: System, pose: Pose) -> Float[Array, "joints"]:
    return kinematics.coordinates(plant, kinematics.bodies(plant, pose))


def _unit(plant: System, joint: int) -> tuple[str, float]:
    """Of a joint's coordinate, and its natural size."""
    return ("rad", 1.0) if plant.coordinate[joint] == TURN else ("m", float(plant.scale.length_m))
