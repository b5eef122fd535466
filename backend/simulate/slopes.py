"""Slopes along what moves: numbers that nobody varies cost nothing, and what is known already is not computed again."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


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
def varied(value: Any, by: Any) -> Any:
    """`value`, with a slope of zero where anything of `by` has one: what a loop gives slopes to must begin with one."""
    return value


def _varied_jvp(primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    leaves, tree = jax.tree.flatten(primals[0])
    changes = tree.flatten_up_to(tangents[0])
    causes = [c for c in jax.tree.leaves(tangents[1]) if not isinstance(c, SymbolicZero)]
    if causes:
        none = 0.0 * jnp.ravel(causes[0])[0]  # not a plain zero: it goes in all directions that the cause goes in
        changes = [
            jnp.full(leaf.shape, none) if isinstance(change, SymbolicZero) else change
            for leaf, change in zip(leaves, changes, strict=True)
        ]
    return primals[0], tree.unflatten(changes)


varied.defjvp(_varied_jvp, symbolic_zeros=True)
