"""Known drives of a motion: recorded values that replace an effect's parameter step by step."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import Akima1DInterpolator

from backend.mechanism.study import Experiment
from backend.model.model import Address, Model
from backend.model.placed import Placed
from backend.model.system import System

BASE = "@base"
"""Effect, in an address, that stands for an acceleration of the base along an axis of W, `x` to `z` [m/s²]."""


class Record(eqx.Module):
    """Drive values for every step; column i belongs to addresses[i]."""

    values: Float[Array, "steps drives"]
    addresses: tuple[Address, ...] = eqx.field(static=True)

    def apply(self, system: System, now: Float[Array, "drives"]) -> System:
        """The system with its driven parameters at this step's values."""
        for (effect, name), value in zip(self.addresses, now, strict=True):
            system = _with_value(system, effect, name, value)
        return system

    def later(self, delay_s: Array, step_s: float | Array) -> "Record":
        """The record as it acts on steps that begin later; its last values hold on."""
        last = self.values.shape[0] - 1
        at = jnp.arange(last + 1) + delay_s / step_s
        first = jnp.clip(jnp.floor(at).astype(int), 0, last)
        share = (at - first)[:, None]
        here, next_ = self.values[first], self.values[jnp.minimum(first + 1, last)]
        return Record(here + share * (next_ - here), self.addresses)


Series = tuple[Address, Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]
"""A recorded drive: what it drives, times [s], values."""


def series_of(experiment: Experiment) -> list[Series]:
    """The recorded drives of an experiment."""
    if experiment.inputs is None:
        return []
    return [
        ((str(effect), str(name)), rows["time_s"].to_numpy(float), rows["value"].to_numpy(float))
        for (effect, name), rows in experiment.inputs.groupby(["effect", "parameter"], sort=False)  # type: ignore[misc]
    ]


def beginning(model: Model, series: Sequence[Series]) -> Model:
    """The model with prescribed paths where their records begin, which says in which whole turn their joints do."""
    rows = model.parameters if series else {}
    ends = [(address, values[0]) for address, _, values in series if address in rows and len(values)]
    return model.with_parameters({a: value for a, value in ends if rows[a].declaration.drive == "end"})


def on_steps(
    model: Model,
    series: Sequence[Series],
    step_s: float,
    steps: int,
    start_s: float = 0.0,
) -> Record:
    """Recorded drives (address, times [s], values) on the steps of a rollout.

    A force, held from each sample to the next, acts at a node for the step around it, so it enters as its mean over
    that step: no impulse of a coarse or uneven record is lost.  At the first node the half behind it counts alone, for
    what acted before the release moved nothing.  A prescribed path enters as its value at the step's end.

    Raises ValueError naming an effect or parameter that takes no record.
    """
    nodes = start_s + step_s * np.arange(steps + 1)
    columns, table, driven = [], model.parameters, []
    for (effect, name), times, values in series:
        at = [address for address in model.addresses(effect, name) if address in table]
        drive = table[at[0]].declaration.drive if at else None
        if drive is None:
            takes = [f"{e}.{p}" for (e, p), r in table.items() if r.declaration.drive]
            raise ValueError(f"'{effect}.{name}' takes no recorded input; inputs here: {', '.join(takes) or 'none'}")
        if drive == "end":
            column = path_value(times, values, nodes + step_s)
        else:
            column = mean_value(times, values, np.maximum(nodes - 0.5 * step_s, start_s), nodes + 0.5 * step_s)
        columns += [column] * len(at)
        driven += at
    return Record(jnp.asarray(np.stack(columns, -1)), tuple(driven))


def path_value(times: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Where a path is that was sampled: joined smoothly between samples, for what moves does not jump, and without
    overshoot where it stops (Akima 1970, modified); at rest before its first sample and after its last.
    """
    if len(times) < 2:
        return np.full(len(at), values[0])
    return Akima1DInterpolator(times, values, method="makima")(np.clip(at, times[0], times[-1]))


def mean_value(times: np.ndarray, values: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Mean of a zero-order hold over intervals."""
    area = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(times))])

    def total(at: np.ndarray) -> np.ndarray:
        index = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(values) - 1)
        return area[index] + values[index] * (at - times[index])

    return (total(end) - total(start)) / (end - start)


def _with_value(system: System, effect: str, name: str, value: Array) -> System:
    if effect == BASE:
        return accelerated(system, jnp.eye(3)["xyz".index(name)] * value)
    for field in ("forces", "efforts", "motions"):
        groups: tuple[Placed, ...] = getattr(system, field)
        for index, group in enumerate(groups):
            if effect in group.ids and name in group.effect.declarations():
                leaf = getattr(group.effect, name).at[group.ids.index(effect)].set(value)
                return eqx.tree_at(lambda s, f=field, i=index: getattr(getattr(s, f)[i].effect, name), system, leaf)
    raise KeyError(f"'{effect}.{name}' is not a drive of this system")


def accelerated(system: System, acceleration: Float[Array, "3"]) -> System:
    """The system in the frame of a base with this acceleration in W [m/s²]: weight takes it off."""
    return eqx.tree_at(lambda s: s.forces[0].effect.gravity_m_per_s2, system, replace_fn=lambda g: g - acceleration)
