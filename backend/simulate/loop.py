"""Loops whose slopes go round with them.

JAX takes a loop's derivative from the whole loop: its body is gone through again until it is settled what in it varies,
and twice more for several directions together, with every loop inside it likewise; that takes longer than most motions.
Here a state and its changes are carried together, and each body is gone through once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import ShapedArray
from jax.custom_derivatives import SymbolicZero
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

State = TypeVar("State")
Arrays = Sequence[Array]


def loop(
    wanted: Callable[[Any, State], Array], onward: Callable[[Any, State], State], given: Any, state: State
) -> State:
    """The state after `onward(given, state)` was repeated for as long as `wanted(given, state)`.

    Both functions take from outside only what is no tracer; all else is in `given`.  What of the state varies must do
    so from the beginning (see `slopes.varied`).  Differentiable forwards.
    """
    leaves, tree = jax.tree.flatten(jax.tree.map(jnp.asarray, (given, state)))
    rounds = _Rounds(wanted, onward, tree, len(jax.tree.leaves(given)))
    return jax.tree.unflatten(jax.tree.structure(state), _loop.bind(*leaves, rounds=rounds, moving=()))


@dataclass(frozen=True, eq=False)
class _Rounds:
    """A loop on the leaves of (given, state); `count` of them are given."""

    wanted: Callable[[Any, Any], Array]
    onward: Callable[[Any, Any], Any]
    tree: Any
    count: int

    def going(self, leaves: Arrays) -> Array:
        """Whether another round is wanted."""
        return self.wanted(*self.tree.unflatten(leaves))

    def after(self, leaves: Arrays) -> list[Array]:
        """The state after another round."""
        return jax.tree.leaves(self.onward(*self.tree.unflatten(leaves)))

    def alone(self, leaves: Arrays) -> list[Array]:
        """The state at the end."""
        given, state = list(leaves[: self.count]), list(leaves[self.count :])
        return lax.while_loop(lambda now: self.going([*given, *now]), lambda now: self.after([*given, *now]), state)

    def followed(self, leaves: Arrays, moving: tuple[int, ...], changes: Arrays) -> tuple[list[Array], list[Array]]:
        """The state at the end, and the slopes of its moving leaves in every direction.

        moving: places of the leaves that vary.  changes: theirs, and so are the slopes, with directions in front.
        """
        given, fixed = leaves[: self.count], sum(at < self.count for at in moving)
        travelling = [at - self.count for at in moving[fixed:]]

        def onwards(now: tuple[list[Array], list[Array]]) -> tuple[list[Array], list[Array]]:
            state, slopes = now
            every = [*given, *state]

            def ends(some: list[Array]) -> tuple[list[Array], list[Array]]:
                here = dict(zip(moving, some, strict=True))
                after = self.after([here.get(at, leaf) for at, leaf in enumerate(every)])
                checked = [leaf if i in travelling else _unmoved(leaf) for i, leaf in enumerate(after)]
                return [after[i] for i in travelling], checked

            def along(change: list[Array]) -> tuple[list[Array], list[Array]]:
                _, slope, after = jax.jvp(ends, ([every[at] for at in moving],), (change,), has_aux=True)
                return after, slope

            return jax.vmap(along, out_axes=(None, 0))([*changes[:fixed], *slopes])

        begin = list(leaves[self.count :]), list(changes[fixed:])
        return lax.while_loop(lambda now: self.going([*given, *now[0]]), onwards, begin)

    def side_by_side(self, leaves: Arrays, axes: Sequence[int | None], size: int) -> list[Array]:
        """The states at the end of several loops, in front; those that end stand still until the last has."""
        given = list(leaves[: self.count])
        state = [_in_front(x, axis, size) for x, axis in zip(leaves[self.count :], axes[self.count :], strict=True)]
        apart = [*axes[: self.count], *[0] * len(state)]
        every, goes = jax.vmap(lambda *x: self.after(x), apart), jax.vmap(lambda *x: self.going(x), apart)

        def onwards(now: tuple[list[Array], Array]) -> tuple[list[Array], Array]:
            state, on = now
            moved = [
                jnp.where(on.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                for new, old in zip(every(*given, *state), state, strict=True)
            ]
            return moved, goes(*given, *moved)

        return lax.while_loop(lambda now: jnp.any(now[1]), onwards, (state, goes(*given, *state)))[0]


@jax.custom_jvp
def _unmoved(leaf: Array) -> Array:
    return leaf


def _unmoved_jvp(primals: tuple[Array], tangents: tuple[Any]) -> tuple[Array, Any]:
    if not isinstance(tangents[0], SymbolicZero):
        shape = jnp.shape(primals[0])
        raise TypeError(f"a part {shape} of a loop's state has a slope after it and none before: begin it `varied`")
    return primals[0], tangents[0]


_unmoved.defjvp(_unmoved_jvp, symbolic_zeros=True)


def _in_front(x: Array, axis: int | None, size: int) -> Array:
    return lax.broadcast(x, (size,)) if axis is None else jnp.moveaxis(x, axis, 0)


def _called(*operands: Array, rounds: _Rounds, moving: tuple[int, ...]) -> list[Array]:
    """Of all leaves, then of the changes of the moving ones: the state's leaves, then the slopes of its moving ones."""
    if not moving:
        return rounds.alone(operands)
    leaves, changes = operands[: -len(moving)], operands[-len(moving) :]
    ends, slopes = rounds.followed(leaves, moving, [change[None] for change in changes])
    return [*ends, *(slope[0] for slope in slopes)]


def _shapes(*operands: ShapedArray, rounds: _Rounds, moving: tuple[int, ...]) -> list[ShapedArray]:
    leaves = operands[: rounds.tree.num_leaves]
    ends = [*leaves[rounds.count :], *(leaves[at] for at in moving if at >= rounds.count)]
    return [ShapedArray(end.shape, end.dtype) for end in ends]


def _along(primals: tuple, tangents: tuple, *, rounds: _Rounds, moving: tuple[int, ...]) -> tuple[list, list]:
    varying = tuple(at for at, tangent in enumerate(tangents) if not isinstance(tangent, ad.Zero))
    changes = [tangents[at] for at in varying]
    if moving:  # the slope of a slope: JAX's own way

        def moved(*some: Array) -> list[Array]:
            every = list(primals)
            for at, x in zip(varying, some, strict=True):
                every[at] = x
            return _called(*every, rounds=rounds, moving=moving)

        return jax.jvp(moved, tuple(primals[at] for at in varying), tuple(changes))
    made = _loop.bind(*primals, *changes, rounds=rounds, moving=varying)
    count = len(primals) - rounds.count
    ends, slopes = made[:count], iter(made[count:])
    return ends, [next(slopes) if at in varying else tangents[at] for at in range(rounds.count, len(primals))]


def _batched(
    operands: tuple[Array, ...], axes: tuple[int | None, ...], *, rounds: _Rounds, moving: tuple[int, ...]
) -> tuple[list[Array], list[int | None]]:
    inputs = rounds.tree.num_leaves
    size = next(x.shape[axis] for x, axis in zip(operands, axes, strict=True) if axis is not None)
    if not moving:
        ends = rounds.side_by_side(operands, axes, size)
        return ends, [0] * len(ends)
    if any(axis is not None for axis in axes[:inputs]):
        ends = jax.vmap(lambda *x: _called(*x, rounds=rounds, moving=moving), axes)(*operands)
        return ends, [0] * len(ends)
    changes = [_in_front(x, axis, size) for x, axis in zip(operands[inputs:], axes[inputs:], strict=True)]
    ends, slopes = rounds.followed(operands[:inputs], moving, changes)
    return [*ends, *slopes], [*[None] * len(ends), *[0] * len(slopes)]


_loop = Primitive("loop_with_slopes")
_loop.multiple_results = True
_loop.def_impl(_called)
_loop.def_abstract_eval(_shapes)
ad.primitive_jvps[_loop] = _along
batching.primitive_batchers[_loop] = _batched
mlir.register_lowering(_loop, mlir.lower_fun(_called, multiple_results=True))
