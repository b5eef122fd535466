"""The motion behind a fit: all bodies, where the fit itself kept only what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from backend.fit.prediction import Addresses, Setting, halvings, released
from backend.report.evidence import Motion
from backend.simulate.rollout import rollout
from backend.simulate.run import origins
from backend.simulate.shelf import shelved

if TYPE_CHECKING:
    from backend.fit.run import Run


def motion_under(run: Run, values: np.ndarray, own: np.ndarray, moving: Sequence[str]) -> Motion:
    """Poses of the named bodies in one experiment; values: at every free address; own: how it starts."""
    rates = own[run.mobility : run.unknowns] if run.moving else np.zeros(run.mobility)
    x = np.concatenate([values[: len(run.addresses)], own[: run.mobility], rates])
    until = int(np.ceil(run.duration_s / run.step_s)) + 1
    bare = replace(run.setting, since_release_s=jnp.zeros(0), column=jnp.zeros(0, int), turns=jnp.zeros(0))
    seen = _played(bare, run.addresses, jnp.asarray(run.step_s), jnp.asarray(x), jnp.asarray(until))
    time_s, origin, attitude, held_s = map(np.asarray, seen)
    kept = time_s <= run.duration_s
    slots = {body: i for i, body in enumerate(run.model.topology.body_ids) if body in moving}
    return Motion(
        time_s[kept] + run.data.release_s + float(held_s),
        {body: origin[kept, slots[body]] for body in moving},
        {body: attitude[kept, slots[body]] for body in moving},
    )


@shelved("addresses")
def _played(
    setting: Setting, addresses: Addresses, step_s: Float[Array, ""], x: Float[Array, " x"], until: Int[Array, ""]
) -> tuple[Array, Array, Array, Array]:
    """Time and pose of every body at the nodes up to `until`, and for how long the mechanism was held."""
    _, plant, start, record = released(setting, addresses, step_s, x)
    path = rollout(plant, start, step_s, setting.steps, record, halvings(plant), jnp.clip(until, 1, setting.steps))
    return path.time_s, origins(plant, path)[0], path.pose.quaternion, jnp.asarray(plant.held_s)
