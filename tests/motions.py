"""Let a model move, and look at what a motion should keep.  One compiled program serves every drawing of a topology."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import TOLERANCE, system
from backend.simulate import invariants
from backend.simulate.assemble import free_motions, start
from backend.simulate.record import Record
from backend.simulate.rollout import Trajectory, rollout
from backend.simulate.run import reactions


class Motion(NamedTuple):
    """A trajectory and its invariants, as NumPy arrays; the first axis is time."""

    path: Trajectory
    kinetic: Float[np.ndarray, "nodes"]
    potential: Float[np.ndarray, "nodes"]
    open_m: Float[np.ndarray, "nodes"]
    momentum: Float[np.ndarray, "nodes 6"]
    force: Float[np.ndarray, "nodes joints 3"]
    """Of each joint on its body B, in W [N]."""
    torque: Float[np.ndarray, "nodes joints 3"]

    @property
    def energy(self) -> Float[np.ndarray, "nodes"]:
        return self.kinetic + self.potential


def move(
    model: Model,
    velocity: Float[Array, "slots 6"],
    step_s: Array,
    steps: int,
    record: Record | None = None,
    tolerance: float = TOLERANCE,
    halvings: int = 0,
) -> Motion:
    """From the drawn pose with a velocity; every argument but the counts is an array, so that programs are shared."""
    plant = system(model, tolerance)
    path = rollout(plant, Start(drawn_pose(model, plant), velocity), step_s, steps, record, halvings)
    return Motion(
        path,
        invariants.kinetic_energy(plant, path),
        invariants.potential_energy(plant, path),
        invariants.constraint_error(plant, path),
        invariants.momentum(plant, path),
        *reactions(plant, path),
    )


_compiled = eqx.filter_jit(move)


def follow(
    model: Model,
    step_s: float,
    steps: int,
    velocity: np.ndarray | None = None,
    record: Record | None = None,
    halvings: int = 0,
) -> Motion:
    """The motion from the drawn pose, at rest unless a velocity is given."""
    begin = still(model) if velocity is None else jnp.asarray(velocity)
    motion = _compiled(model, begin, jnp.asarray(step_s), steps, record, halvings=halvings)
    return jax.tree.map(np.asarray, motion)


def still(model: Model) -> Float[Array, "slots 6"]:
    """No velocity."""
    return jnp.zeros((model.topology.slots, 6))


def allowed(model: Model, rates: Sequence[float]) -> Float[np.ndarray, "slots 6"]:
    """The velocity of the drawn pose at these rates along its free motions."""
    plant = eqx.filter_jit(system)(model)
    here = drawn_pose(model, plant)
    motions = free_motions(plant, here)
    begin = eqx.filter_jit(start)(plant, here, motions, jnp.zeros(len(rates)), jnp.asarray(rates, dtype=float))
    return np.asarray(begin.velocity)


def stacked(models: list[Model]) -> Model:
    """Models of one topology as one batch."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)


def crossings(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Times at which a sampled value rises through zero (linear between samples)."""
    before = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    share = -values[before] / (values[before + 1] - values[before])
    return time_s[before] + share * (time_s[before + 1] - time_s[before])
