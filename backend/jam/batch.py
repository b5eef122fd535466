"""Jammed or not, for many samples of a drawing's parameters at once: no cause, no margin, two motions a sample.

A sample is jammed where its motion ends at rest (`stuck`) and a copy without friction and play, let go from there,
moves.  The samples of a chunk move in one compiled program; one that cannot be followed is told as lost.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from backend.jam.follow import HALVINGS
from backend.jam.knobs import frictions, plays
from backend.jam.scene import FLOWS, FREED
from backend.jam.stuck import AT_REST, FEWEST, SHORTEST_S, STANDSTILL, creep
from backend.model.model import Address, Model
from backend.model.state import Pose, Start, drawn_pose
from backend.model.system import System, system
from backend.simulate import kinematics
from backend.simulate.assemble import closed
from backend.simulate.rollout import Trajectory, rollout
from backend.simulate.run import OPEN_JOINT
from backend.simulate.spectrum import real

WATCHED = 250  # steps for which the ideal copy is followed
CHUNK = 64  # samples of one call
TOGETHER = 16  # of them that move side by side: more wait for the one whose steps are hardest, and leave the cache


@dataclass(frozen=True)
class Verdicts:
    """What came of each sample.  onset_s: since when it rests, NaN where it moves to the end.

    lost: its loops could not be closed or a step could not be solved; such a sample is neither jammed nor free.
    """

    jammed: Bool[np.ndarray, "samples"]
    rests: Bool[np.ndarray, "samples"]
    onset_s: Float[np.ndarray, "samples"]
    lost: Bool[np.ndarray, "samples"]


class _Seen(NamedTuple):
    jammed: Array
    rests: Array
    onset: Array
    lost: Array


def verdicts(
    model: Model,
    addresses: Sequence[Address],
    samples: Float[np.ndarray, "samples addresses"],
    duration_s: float = 1.0,
    step_s: float = 1e-3,
    chunk: int = CHUNK,
) -> Iterator[tuple[slice, Verdicts]]:
    """Verdicts chunk by chunk, with the samples that each is about; every chunk runs in the same program.

    addresses: (effect id, parameter) that a sample sets, in SI; the drawing's own values elsewhere.  A motion begins
    at rest in the drawn pose.  Exact dead centres are not looked for.  Raises ValueError for samples of another width.
    """
    samples = np.asarray(samples, float)
    if samples.ndim != 2 or samples.shape[1] != len(addresses):
        raise ValueError(f"samples have shape {samples.shape}; give one column for each of {len(addresses)} addresses")
    steps, ideal = round(duration_s / step_s), (*frictions(model), *plays(model))
    for first in range(0, len(samples), chunk):
        some = samples[first : first + chunk]
        # The last chunk is filled up: another size would be another program.
        filled = np.concatenate([some, np.repeat(some[-1:], chunk - len(some), axis=0)])
        seen = _many(model, tuple(addresses), ideal, jnp.asarray(filled), jnp.asarray(step_s), steps)
        jammed, rests, onset, lost = (np.asarray(leaf)[: len(some)] for leaf in seen)
        yield slice(first, first + len(some)), Verdicts(jammed, rests, np.where(rests, onset, np.nan), lost)


@eqx.filter_jit
def _many(
    model: Model,
    addresses: tuple[Address, ...],
    ideal: tuple[Address, ...],
    samples: Array,
    step_s: Array,
    steps: int,
) -> _Seen:
    one = functools.partial(_one, model, addresses, ideal, step_s=step_s, steps=steps)
    return lax.map(one, samples, batch_size=min(TOGETHER, len(samples)))


def _one(
    model: Model,
    addresses: tuple[Address, ...],
    ideal: tuple[Address, ...],
    values: Array,
    *,
    step_s: Array,
    steps: int,
) -> _Seen:
    own = model.with_parameters({address: values[k] for k, address in enumerate(addresses)})
    still = jnp.zeros((model.topology.slots, 6))
    plant = system(own)
    pose = closed(plant, drawn_pose(own, plant))
    path = rollout(plant, Start(pose, still), step_s, steps, None, HALVINGS)
    rates, nodes = creep(plant, path.rate, path.velocity), jnp.arange(steps + 1)

    def first_below(bound: Array | float) -> Array:
        return jnp.max(jnp.where(rates < bound, 0, nodes + 1))

    since = first_below(AT_REST)
    lasting = steps + 1 - since
    rests = (lasting >= FEWEST) & ((since == 0) | (lasting * step_s >= SHORTEST_S))
    onset = step_s * first_below(jnp.maximum(AT_REST, STANDSTILL * rates.max()))
    bare = own.with_parameters({address: jnp.zeros(()) for address in ideal})
    copy = system(bare)
    here = jax.tree.map(lambda leaf: leaf[-1], path.pose)
    away = rollout(copy, Start(closed(copy, here), still), step_s, WATCHED, None, HALVINGS)
    lost = path.lost[-1] | ~_meets(plant, pose)
    return _Seen(rests & _moves(copy, away) & ~lost, rests & ~lost, onset, lost)


def _meets(plant: System, pose: Pose) -> Array:
    """Whether every joint is closed: lengths of a sample may leave a loop open."""
    value = kinematics.rows(plant, kinematics.bodies(plant, pose)).value
    unit = jnp.array([1 / plant.scale.length_m] * 3 + [1.0] * 3)
    held = plant.held_rows & ~plant.coordinate_rows
    return jnp.max(jnp.where(held, jnp.abs(value) * unit, 0.0), initial=0.0) < OPEN_JOINT


def _moves(plant: System, path: Trajectory) -> Array:
    """Whether a copy let go comes away, or flows at the end."""
    length = plant.scale.length_m
    turned = jnp.abs(path.q[-1] - path.q[0]) / jnp.where(plant.coordinate_rows[:, :3].any(-1), length, 1.0)
    shifted = jnp.abs(path.pose.position[-1] - path.pose.position[0])[real(plant)] / length
    flows = jnp.min(creep(plant, path.rate[-3:], path.velocity[-3:])) > FLOWS
    return flows | (turned.max(initial=0.0) > FREED) | (shifted.max(initial=0.0) > FREED)
