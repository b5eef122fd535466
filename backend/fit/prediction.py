"""What an experiment would have measured: a rollout seen through camera, clock and sampling.

Samples do not fall on steps: between nodes a motion is the cubic through positions and velocities at both
ends (Hermite), as accurate as the step itself. Recorded drives enter as their mean over each step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import Bool, Float, Int

from backend.effects.shapes import (
    AbstractBaseMotion,
    AbstractClock,
    AbstractDrawnError,
    AbstractHold,
    AbstractShutter,
    AbstractView,
    Sight,
)
from backend.fit.free import FreeParameter
from backend.joints.joint import TURN
from backend.model.as_made import redraw
from backend.model.model import Address, Model
from backend.model.state import Pose, Start
from backend.model.system import System, system
from backend.simulate import assemble, kinematics
from backend.simulate.points import marker_paths, marker_positions, marker_velocities, markers_until
from backend.simulate.record import Record
from backend.simulate.rollout import PATIENCE, Trajectory, rollout
from backend.simulate.shelf import shelved
from backend.simulate.small import apply


class Overrides(eqx.Module):
    """Numbers that some experiments set otherwise, laid out alike for all of them, so that they share one compiled
    program.

    value, given: what this experiment sets, and whether it does; else the free value at `source` counts.
    """

    value: Float[Array, " n"]
    given: Bool[Array, " n"]
    addresses: tuple[Address, ...] = eqx.field(static=True)
    source: tuple[int, ...] = eqx.field(static=True)

    def among(self, values: Float[Array, " p"]) -> Float[Array, " n"]:
        """What counts, of free values."""
        return jnp.where(self.given, self.value, values[np.array(self.source, int)])


class Setting(eqx.Module):
    """What distinguishes one experiment's motion: its model, where it starts, what drives and samples it.

    reference, motions: a closed pose and the free motions there; start coordinates count from it. since_release_s,
    column: when (as stated) and what is sampled, padded. turns: whole turns to add to each column, because an
    unwrapped encoder may count them. overrides: None where no number that is free is set by any experiment.
    """

    model: Model
    reference: Pose
    motions: Float[Array, "slots 6 mobility"]
    since_release_s: Float[Array, " samples"]
    column: Int[Array, " samples"]
    turns: Float[Array, " columns"]
    record: Record | None
    steps: int = eqx.field(static=True)
    overrides: Overrides | None = None

    @property
    def mobility(self) -> int:
        """Number of start coordinates."""
        return self.motions.shape[-1]


SEEING = (AbstractBaseMotion, AbstractShutter, AbstractView)  # what parts a marker from where it is reported
LATEST_ROW_S = 0.05  # no camera reads its rows out more slowly
HALVINGS = 8  # times a step may be cut in two where parts strike each other

Addresses = tuple[tuple[Address, ...], ...]


def addresses_of(parameters: Sequence[FreeParameter]) -> Addresses:
    """The model's addresses of every free parameter, hashable."""
    return tuple(p.addresses for p in parameters)


def with_values(
    model: Model, addresses: Addresses, values: Float[Array, " p"], overrides: Overrides | None = None
) -> Model:
    """The model with free parameters set, but for what an experiment sets; differentiable."""
    sources = {a: np.array([i]) for i, group in enumerate(addresses) for a in group}
    if overrides is not None:
        sources |= {a: np.array([len(addresses) + i]) for i, a in enumerate(overrides.addresses)}
        values = jnp.concatenate([values, overrides.among(values)])
    return model.with_numbers(values, sources)


def predict(
    setting: Setting,
    addresses: Addresses,
    step_s: float | Array,
    x: Float[Array, " x"],
    backwards: bool = False,
    patience: int = PATIENCE,
) -> tuple[Float[Array, " samples"], Array]:
    """Predicted samples, and which of them the motion was lost for.

    x: parameters, start coordinates, start rates. backwards: for derivatives backwards in time, where nothing strikes.
    patience: see `rollout`.
    """
    model, made, start, record = released(setting, addresses, step_s, x)
    marker, axis = _marker_of(model, setting.column)
    time = clock(model, setting.since_release_s, marker)
    moved = time - made.held_s
    slack = LATEST_ROW_S if model.of(AbstractShutter) else 0.0
    until = jnp.ceil((jnp.max(lax.stop_gradient(moved)) + slack) / step_s).astype(int) + 2
    end = None if backwards else jnp.clip(until, 1, setting.steps)
    motion = rollout(made, start, step_s, setting.steps, record, halvings(made), end, patience)
    value, slope = columns(model, made, motion, end)
    seen = hermite(value + setting.turns, slope, step_s, moved, setting.column)
    if model.marker_ids and any(model.of(shape) for shape in SEEING):
        there = (setting.column - axis)[:, None] + np.arange(3)

        def sight(time: Float[Array, " samples"]) -> Sight:
            path, rate = hermite_rate(value, slope, step_s, (time - made.held_s)[:, None], there)
            return Sight(path, rate, time, jnp.min(setting.since_release_s))

        late = shutter(model, sight(time), marker)
        time, moved = time + late, moved + late
        points = view(model, sight(time), marker)
        picked = jnp.take_along_axis(points, axis[:, None], 1)[:, 0]
        seen = jnp.where(marker >= 0, picked, seen)
    after = jnp.clip(jnp.ceil(moved / step_s).astype(int), 0, setting.steps)
    return seen, motion.lost[after]


def released(
    setting: Setting, addresses: Addresses, step_s: float | Array, x: Float[Array, " x"]
) -> tuple[Model, System, Start, Record | None]:
    """What a rollout at x sets out with: model and system, where it starts, and what drives it."""
    m = setting.mobility
    model = with_values(setting.model, addresses, x[: len(addresses)], setting.overrides)
    made = system(model)
    coordinates, rates = x[len(addresses) : len(addresses) + m], x[len(addresses) + m :]
    start = begin(setting, model, made, coordinates, rates)
    return model, made, start, known_drives(setting, model, made, step_s)


def begin(setting: Setting, model: Model, made: System, coordinates: Array, rates: Array) -> Start:
    """The start of a model that may differ from the setting's own, for which the reference was found."""
    shift = None
    if model.of(AbstractDrawnError):
        offset = redraw(model).center_of_mass - redraw(setting.model).center_of_mass
        shift = apply(made.stretch, offset)[: model.topology.slots]
    return assemble.start(made, setting.reference, setting.motions, coordinates, rates, shift)  # type: ignore[arg-type]


def known_drives(setting: Setting, model: Model, made: System, step_s: float | Array) -> Record | None:
    """The record on the steps of a motion that begins at the true release."""
    record = setting.record
    return record.later(made.held_s, step_s) if record is not None and model.of(AbstractHold) else record


def _marker_of(model: Model, column: Int[Array, " samples"]) -> tuple[Int[Array, " samples"], Int[Array, " samples"]]:
    """Marker, and coordinate of it, that a sample measures; -1 and 0 for joints."""
    joints, points = len(model.topology.joint_ids), 3 * len(model.marker_ids)
    at = column - joints
    is_marker = (at >= 0) & (at < points)
    return jnp.where(is_marker, at // 3, -1), jnp.where(is_marker, at % 3, 0)


def halvings(made: System) -> int:
    """How often a step of it may be cut in two."""
    return HALVINGS if strikes(made) else 0


def strikes(made: System) -> bool:
    """Whether parts may strike each other, so that steps may be cut and have no derivatives backwards in time."""
    return bool(made.contacts.count or made.touches.count)


@shelved("addresses")
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


@shelved("addresses")
def foreseen(
    setting: Setting, addresses: Addresses, step_s: float, x: Float[Array, " x"]
) -> tuple[Float[Array, " samples"], Array]:
    """Prediction alone, and the samples it was lost for."""
    return predict(setting, addresses, step_s, x)


@shelved("addresses")
def traced_back(
    setting: Setting, addresses: Addresses, step_s: float, x: Float[Array, " x"], weight: Float[Array, " samples"]
) -> Float[Array, " x"]:
    """Derivative of the weighed sum of the samples, backwards in time (reverse mode); nothing may strike."""
    return jax.vjp(lambda x: predict(setting, addresses, step_s, x, backwards=True)[0], x)[1](weight)[0]


def columns(model: Model, made: System, motion: Trajectory, until: Int[Array, ""] | None = None) -> tuple[Array, Array]:
    """Values and their rates at the nodes (nodes, columns): q, markers where they are, efforts.

    until: the node after which nobody looks.
    """
    nodes = motion.q.shape[0]
    effort = _effort(made, motion)
    parts = [(motion.q, motion.rate)]
    if model.marker_ids:
        if until is None:
            path, velocity = marker_paths(model, made, motion), marker_velocities(model, made, motion)
        else:
            path, velocity = markers_until(model, made, motion, until)
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


def view(model: Model, sight: Sight, marker: Int[Array, "*batch"]) -> Float[Array, "*batch 3"]:
    """World points (of these markers, seen from the base) as the camera reports them."""
    for placed in model.of(AbstractBaseMotion):
        for base in placed.each():
            sight = eqx.tree_at(lambda s: s.p_WP, sight, sight.p_WP + base.displacement(sight.time_s))

    def seen(effect: AbstractView, p_WP: Array) -> Array:
        return effect.view(eqx.tree_at(lambda s: s.p_WP, sight, p_WP), model.camera)

    points = sight.p_WP
    for placed in model.of(AbstractView):
        if all(placed.places):
            points = placed.in_turn(
                points, lambda p, effect, place: jnp.where((marker == place)[..., None], seen(effect, p), p)
            )
        else:
            for effect in placed.each():
                points = seen(effect, points)
    return points


def shutter(model: Model, sight: Sight, marker: Int[Array, " n"]) -> Float[Array, " n"]:
    """Time by which points were taken later than their pictures [s]; zero for joints."""
    late = jnp.zeros_like(sight.time_s)
    for placed in model.of(AbstractShutter):
        for effect, place in zip(placed.each(), placed.places, strict=True):
            here = marker == place[0] if place else marker >= 0
            late = late + jnp.where(here, effect.delay(sight, model.camera), 0.0)
    return late


def clock(model: Model, since_release_s: Float[Array, " n"], marker: Int[Array, " n"]) -> Float[Array, " n"]:
    """True time since the stated release, for samples (of these markers, -1 for joints) that state theirs."""
    for placed in model.of(AbstractClock):
        for effect, place in zip(placed.each(), placed.places, strict=True):
            true = effect.true_time(since_release_s)
            since_release_s = true if not place else jnp.where(marker == place[0], true, since_release_s)
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


def hermite_rate(
    value: Float[Array, "nodes columns"],
    slope: Float[Array, "nodes columns"],
    step_s: float | Array,
    time_s: Float[Array, " n"],
    column: Int[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """`hermite` and its rate, which is zero before the motion and after it."""
    last = value.shape[0] - 1
    at = time_s / step_s
    k = jnp.clip(jnp.floor(at).astype(int), 0, last - 1)
    u = jnp.clip(at, 0.0, last) - k
    chord = (value[k + 1, column] - value[k, column]) / step_s
    m0, m1 = slope[k, column], slope[k + 1, column]
    rate = 6 * u * (1 - u) * chord + m0 * (1 - u) * (1 - 3 * u) + m1 * u * (3 * u - 2)
    return hermite(value, slope, step_s, time_s, column), jnp.where((at >= 0) & (at <= last), rate, 0.0)


def roomy(count: int) -> int:
    """A count rounded up by at most an eighth, so that records of similar length share a compiled program."""
    grain = max(2 ** (math.floor(math.log2(max(count, 1))) - 3), 1)
    return -(-count // grain) * grain


@shelved()
def look(
    model: Model, reference: Pose, motions: Float[Array, "slots 6 mobility"]
) -> tuple[Float[Array, " columns"], Float[Array, "columns mobility"]]:
    """What is seen of a closed pose (q, then markers), and its slope along the free motions."""
    made = system(model)

    def seen(coordinates):
        # Closing the loops again would change this to second order only.
        pose = reference.advance(jnp.einsum("bim,m->bi", motions, coordinates))
        q = kinematics.coordinates(made, kinematics.bodies(made, pose))
        points, marker = marker_positions(model, made, pose), jnp.arange(len(model.marker_ids))
        still = Sight(points, jnp.zeros_like(points), jnp.zeros(len(model.marker_ids)), jnp.zeros(()))
        return jnp.concatenate([q, view(model, still, marker).reshape(-1)])

    zero = jnp.zeros(motions.shape[-1])
    return seen(zero), jax.jacfwd(seen)(zero)
