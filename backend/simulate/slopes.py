"""Slopes along what moves: numbers that nobody varies cost nothing, and what is known already is not computed again."""

import functools
from collections.abc import Callable
from typing import Any

import jax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array


def along(function: Callable, primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    """jax.jvp for rules that are told symbolic zeros: XLA would multiply by zeros and add them."""
    leaves, tree = jax.tree.flatten(primals)
    changes = dict(enumerate(tree.flatten_up_to(tangents)))
    moving = {i: change for i, change in changes.items() if not isinstance(change, SymbolicZero)}

    def moved(some: dict[int, Any]) -> Any:
        return function(*tree.unflatten([some.get(i, leaf) for i, leaf in enumerate(leaves)]))

    return jax.jvp(moved, ({i: leaves[i] for i in moving},), (moving,))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def known(function: Callable, value: Any, *arguments: Any) -> Any:
    """`value`, which is function(*arguments).  Where slopes are asked for it is computed anew: less than keeping it."""
    return value


def _known_jvp(function: Callable, primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    return along(function, primals[1:], tangents[1:])


known.defjvp(_known_jvp, symbolic_zeros=True)


@jax.custom_jvp
def varied(value: Array, by: Array) -> Array:
    """`value`, with a slope of zero where `by` has one: a loop that begins so is traced once, instead of until it is
    settled what in it has slopes.
    """
    return value


@varied.defjvp
def _varied_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    return primals[0], tangents[0] + 0.0 * tangents[1]
