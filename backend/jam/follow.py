"""Follow a model from a start: the program compiled for the run itself serves every counterfactual of it."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from backend.model.model import Model
from backend.model.state import Start
from backend.model.system import System, system
from backend.simulate.record import Record
from backend.simulate.rollout import Trajectory, depart, march, trajectory

CHUNK = 250  # steps of one call: a counterfactual takes one
HALVINGS = 10  # times a step may be cut in two before the motion is lost

Progress = Callable[[int, int], None]

_depart = eqx.filter_jit(depart)
_march = eqx.filter_jit(march)


def follow(
    model: Model,
    start: Start,
    step_s: float,
    steps: int,
    record: Record | None = None,
    progress: Progress | None = None,
) -> tuple[System, Trajectory]:
    """The motion of a model from a start, nodes 0..steps; the last values of a record hold on.

    After a step that cannot be solved the trajectory is frozen and `lost`.
    """
    plant = system(model)
    carry, parts = (_depart(plant, start), jnp.zeros((), dtype=bool)), []
    for first in range(0, steps + 1, CHUNK):
        carry, seen = _march(plant, carry, jnp.asarray(step_s), CHUNK, _part(record, first), HALVINGS)
        parts.append(seen)
        if progress:
            progress(min(first + CHUNK, steps), steps)
    # As numpy: every slice of a jax array on the way would be a program of its own.
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves)[: steps + 1], *parts)
    return plant, trajectory(whole, step_s)


def steady(record: Record | None, model: Model) -> Record | None:
    """A record of the same addresses that holds the model's own values: what a counterfactual is driven by."""
    if record is None:
        return None
    table = model.parameters
    values = [table[address].value for address in record.addresses]
    return Record(jnp.tile(jnp.asarray(values, dtype=float), (2, 1)), record.addresses)


def _part(record: Record | None, first: int) -> Record | None:
    if record is None:
        return None
    rows = np.minimum(np.arange(first, first + CHUNK), record.values.shape[0] - 1)
    return Record(record.values[rows], record.addresses)
