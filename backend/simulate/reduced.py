"""The reduced solve: redundant rows are let go, and chosen again where the kept ones lose their hold.

A row that is let go keeps its place, with so large a compliance that it carries nothing: which rows these are is data,
so that one compiled program serves every choice.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import kinematics
from backend.simulate.equations import Motion
from backend.simulate.redundancy import LetGo, let_go_at
from backend.simulate.rollout import Seen

RELEASE = 2e13  # times the compliance: a row 1e-10 m open then carries 1e-11 N in a step of 1 ms
OPEN = 1e-9  # mechanism lengths that a row let go may always open: ten times a step's tolerance
FOLLOW = 30.0  # times what the kept rows open: they give way under load, and those let go follow them
TRIES = 3  # choices of rows before compliance carries a stretch
STRETCH = 25  # steps between two looks at the rows let go

Carry = tuple[Motion, Array]
March = Callable[[System, Carry, int], tuple[Carry, Seen]]


class Kept(NamedTuple):
    """How a reduced solve went: rows let go from which step on, and the steps that compliance carried instead."""

    removed: tuple[tuple[int, np.ndarray], ...]
    carried: int

    def sentence(self, steps: int) -> str:
        """One line for a summary."""
        count = len(self.removed)
        said = f"reduced: {int(self.removed[0][1].sum())} rows let go, chosen {count} time{'s' * (count > 1)}"
        return said + (f"; compliance carried {self.carried} of {steps} steps" if self.carried else "")


def released(system: System, let_go: LetGo) -> System:
    """The system without these held rows, which no longer carry anything, nor close; the others stand in for them."""
    factor = np.where(let_go.rows, RELEASE, let_go.share)
    return eqx.tree_at(lambda s: s.compliance, system, system.compliance * factor)


def march_reduced(
    system: System, carry: Carry, steps: int, march: March, threshold: float | None = None
) -> tuple[list[Seen], Kept]:
    """March with redundant rows let go, in stretches; the last one may run past `steps`.

    march(system, carry, first step) -> (carry, seen) takes one stretch of STRETCH steps.  After each, every held row is
    looked at: where one let go has opened far more than those kept, the kept rows had lost rank, and the stretch is
    taken again with rows chosen where it opened.  Where no choice holds, compliance carries the stretch.
    """
    pose = carry[0].pose
    drawn = float(
        _openings(system, jax.tree.map(lambda leaf: leaf[None], pose)).max(where=system.rigid_rows, initial=0.0)
    )
    # A drawing that does not quite close leaves rows open whichever are let go.
    always = max(OPEN, FOLLOW * drawn)
    let_go = let_go_at(system, pose, threshold)
    chosen, parts, carried = [(0, let_go.rows)], [], 0
    for first in range(0, steps, STRETCH):
        for _ in range(TRIES):
            after, seen = march(released(system, let_go), carry, first)
            bad = _broken(system, let_go.rows, after, seen, always)
            if bad is None:
                break
            let_go = let_go_at(system, bad, threshold)
        else:
            after, seen = march(system, carry, first)
            carried += STRETCH
            let_go = let_go_at(system, after[0].pose, threshold)
        if not np.array_equal(let_go.rows, chosen[-1][1]):
            chosen.append((first, let_go.rows))
        carry = after
        parts.append(seen)
    return parts, Kept(tuple(chosen), min(carried, steps))


def _broken(system: System, removed: np.ndarray, after: Carry, seen: Seen, always: float) -> Pose | None:
    """The first pose of a stretch at which a row let go stands open, or that was not solved; None where all is well."""
    poses = jax.tree.map(lambda nodes, last: jnp.concatenate([nodes, last[None]]), seen.pose, after[0].pose)
    opening = np.asarray(_openings(system, poses))
    kept = opening.max((1, 2), where=system.rigid_rows & ~removed, initial=0.0)
    bad = opening.max((1, 2), where=removed, initial=0.0) > np.maximum(always, FOLLOW * kept)
    bad[1:] |= np.asarray(seen.lost)
    if not bad.any():
        return None
    return jax.tree.map(lambda leaf: leaf[int(bad.argmax())], poses)


@eqx.filter_jit
def _openings(system: System, poses: Pose) -> Float[Array, "nodes joints 6"]:
    """How far every row stands open at each pose, in mechanism lengths and rad."""

    def at(pose: Pose) -> Array:
        value = kinematics.rows(system, kinematics.bodies(system, pose)).value
        unit = jnp.array([1 / system.scale.length_m] * 3 + [1.0] * 3)
        return jnp.abs(value) * unit

    return jax.vmap(at)(poses)
