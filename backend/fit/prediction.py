"""What an experiment would have measured: a rollout seen through camera, clock and sampling.

Samples do not fall on steps: between nodes a motion is the cubic through positions and velocities at both
ends (Hermite), as accurate as the step itself. Recorded drives enter as their mean over each step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from backend.effects.shapes import AbstractClock, AbstractView
from backend.fit.free import FreeParameter
from backend.joints.joint import TURN
from backend.model.model import Address, Model
from backend.model.state import Pose
from backend.model.system import System, system
from backend.simulate import assemble, kinematics
from backend.simulate.points import marker_paths, marker_positions, marker_velocities
from backend.simulate.record import Record
from backend.simulate.rollout import Trajectory, rollout


class Setting(eqx.Module):
    """What distinguishes one experiment's motion: its model, where it starts, what drives and samples it.

    reference, motions: a closed pose and the free motions there; start coordinates count from it. since_release_s,
    column: when (as stated) and what is sampled, padded. turns: whole turns to add to each column, because an
    unwrapped encoder may count them.
    """

    model: Model
    reference: Pose
    motions: Float[Array, "slots 6 mobility"]
    since_release_s: Float[Array, " samples"]
    column: Int[Array, " samples"]
    turns: Float[Array, " columns"]
    record: Record | None
    steps: int = eqx.field(static=True)

    @property
    def mobility(self) -> int:
        """Number of start coordinates."""
        return self.motions.shape[-1]


HALVINGS = 8  # times a step may be cut in two where parts strike each other

Addresses = tuple[tuple[Address, ...], ...]


def addresses_of(parameters: Sequence[FreeParameter]) -> Addresses:
    """The model's addresses of every free parameter, hashable."""
    return tuple(p.addresses for p in parameters)


def with_values(model: Model, addresses: Addresses, values: Float[Array, " p"]) -> Model:
    """The model with free parameters set; differentiable."""
    return model.with_parameters({a: values[i] for i, group in enumerate(addresses) for a in group})


def predict(
    setting: Setting, addresses: Addresses, step_s: float | Array, x: Float[Array, " x"]
) -> tuple[Float[Array, " samples"], Array]:
    """Predicted samples, and which of them the motion was lost for.

    x: parameters, start coordinates, start rates.
    """
    m = setting.mobility
    model = with_values(setting.model, addresses, x[: len(addresses)])
    made = system(model)
    coordinates, rates = x[len(addresses) : len(addresses) + m], x[len(addresses) + m :]
    start = assemble.start(made, setting.reference, setting.motions, coordinates, rates)  # type: ignore[arg-type]
    motion = rollout(made, start, step_s, setting.steps, setting.record, HALVINGS if _strikes(made) else 0)
    value, slope = columns(model, made, motion)
    time = clock(model, setting.since_release_s)
    seen = hermite(value + setting.turns, slope, step_s, time, setting.column)
    after = jnp.clip(jnp.ceil(time / step_s).astype(int), 0, setting.steps)
    return seen, motion.lost[after]


def _strikes(made: System) -> bool:
    return bool(made.contacts.count or made.touches.count)


@partial(jax.jit, static_argnames="addresses")
def linearised(
    setting: Setting,
    addresses: Addresses,
    step_s: float,
    x: Float[Array, " x"],
    directions: Float[Array, "k x"],
) -> tuple[Float[Array, " samples"], Float[Array, "samples k"], Array]:
    """Prediction, its derivative along k directions (forward mode), and the samples it was lost for."""

    def along(direction):
        return jax.jvp(lambda x: predict(setting, addresses, step_s, x), (x,), (direction,))

    (seen, lost), (slope, _) = jax.vmap(along, out_axes=((None, None), (1, None)))(directions)
    return seen, slope, lost


def columns(model: Model, made: System, motion: Trajectory) -> tuple[Array, Array]:
    """Values and their rates at the nodes (nodes, columns): q, markers as the camera sees them, efforts."""
    nodes = motion.q.shape[0]
    effort = _effort(made, motion)
    parts = [(motion.q, motion.rate)]
    if model.marker_ids:
        path, velocity = jax.jvp(
            lambda p: view(model, p),
            (marker_paths(model, made, motion),),
            (marker_velocities(model, made, motion),),
        )
        parts.append((path.reshape(nodes, -1), velocity.reshape(nodes, -1)))
    parts.append((effort, _slope(effort, motion.time_s)))
    return jnp.concatenate([v for v, _ in parts], 1), jnp.concatenate([s for _, s in parts], 1)


def _slope(value: Float[Array, "nodes joints"], time_s: Float[Array, " nodes"]) -> Float[Array, "nodes joints"]:
    """Central differences; one-sided at the ends."""
    at = jnp.arange(value.shape[0])
    after, before = jnp.clip(at + 1, 0, at[-1]), jnp.clip(at - 1, 0, at[-1])
    return (value[after] - value[before]) / (time_s[after] - time_s[before])[:, None]


def _effort(made: System, motion: Trajectory) -> Float[Array, "nodes joints"]:
    """Force or torque that a joint carries along or about its own axis; about it where the joint is rigid."""
    rows = np.array(made.coordinate_rows)
    rows[~rows.any(1), TURN] = True
    return jnp.sum(jnp.where(rows, motion.reaction, 0.0), -1)


def view(model: Model, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """World points as the camera reports them."""
    for placed in model.of(AbstractView):
        for row in placed.rows:
            effect = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            points = effect.view(points, model.view_axis)
    return points


def clock(model: Model, since_release_s: Float[Array, " n"]) -> Float[Array, " n"]:
    """True time since the release, for samples that state `since_release_s`."""
    for placed in model.of(AbstractClock):
        for row in placed.rows:
            effect = jax.tree.map(lambda leaf, r=row: leaf[r], placed.effect)
            since_release_s = effect.true_time(since_release_s)
    return since_release_s


def hermite(
    value: Float[Array, "nodes columns"],
    slope: Float[Array, "nodes columns"],
    step_s: float | Array,
    time_s: Float[Array, " n"],
    column: Int[Array, " n"],
) -> Float[Array, " n"]:
    """Cubic interpolation of one column each at the given times; held at both ends of the motion."""
    last = value.shape[0] - 1
    at = jnp.clip(time_s / step_s, 0.0, last)
    k = jnp.clip(jnp.floor(at).astype(int), 0, last - 1)
    u = at - k
    y0, y1 = value[k, column], value[k + 1, column]
    m0, m1 = step_s * slope[k, column], step_s * slope[k + 1, column]
    return y0 * (1 + 2 * u) * (1 - u) ** 2 + m0 * u * (1 - u) ** 2 + y1 * u**2 * (3 - 2 * u) - m1 * u**2 * (1 - u)


def roomy(count: int) -> int:
    """A count rounded up by at most an eighth, so that records of similar length share a compiled program."""
    grain = max(2 ** (math.floor(math.log2(max(count, 1))) - 3), 1)
    return -(-count // grain) * grain


@jax.jit
def look(
    model: Model, reference: Pose, motions: Float[Array, "slots 6 mobility"]
) -> tuple[Float[Array, " columns"], Float[Array, "columns mobility"]]:
    """What is seen of a closed pose (q, then markers), and its slope along the free motions."""
    made = system(model)

    def seen(coordinates):
        # Closing the loops again would change this to second order only.
        pose = reference.advance(jnp.einsum("bim,m->bi", motions, coordinates))
        q = kinematics.coordinates(made, kinematics.bodies(made, pose))
        points = view(model, marker_positions(model, made, pose)) if model.marker_ids else jnp.zeros((0, 3))
        return jnp.concatenate([q, points.reshape(-1)])

    zero = jnp.zeros(motions.shape[-1])
    return seen(zero), jax.jacfwd(seen)(zero)
