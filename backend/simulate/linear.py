"""The O(n) solve: a block tridiagonal matrix over the levels of the body graph.

`kernel` holds the same two functions compiled; they are used where they have been built.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from backend.model.topology import Topology
from backend.simulate.kernel import call as kernel

UNPIVOTED = 1e3  # times a pivot: entries behind it in its row may be as large before others are sought


class Factor(NamedTuple):
    """M = (pivots + lower) (1 + coupling), n = 6 x width; the last lower and coupling blocks are zero."""

    pivot_inverse: Float[Array, "levels n n"]
    lower: Float[Array, "levels n n"]
    """From a level to the next."""
    coupling: Float[Array, "levels n n"]
    """Pivot inverse x upper: from the next level to this."""


def factor(
    topology: Topology,
    bodies: Float[Array, "slots 6 6"],
    left: Float[Array, "joints 6 12"],
    stiffness: Float[Array, "joints 6"] | Float[Array, "joints 6 6"],
    right: Float[Array, "joints 6 12"],
    others: Float[Array, "others 12 12"],
) -> Factor:
    """Eliminate level by level a matrix over the body graph.

    It has a block on every body, leftᵀ K right between the bodies of every joint (K the stiffness of its rows, or of
    each row by itself), and one block for each other link.
    """
    levels, width, n = topology.levels, topology.width, 6 * topology.width
    if topology.slots and kernel.available():
        pairs = topology.joints + topology.struts + topology.touches
        return Factor(*kernel.factor(levels, width, pairs, bodies, left, stiffness, right, others))
    pull = stiffness[:, :, None] * right if stiffness.ndim == 2 else jnp.einsum("jrs,jsk->jrk", stiffness, right)
    links = jnp.concatenate([jnp.einsum("jri,jrk->jik", left, pull), others])
    blocks = links.reshape(-1, 2, 6, 2, 6).transpose(0, 1, 3, 2, 4).reshape(-1, 6, 6)
    blocks = jnp.concatenate([blocks, jnp.zeros((1, 6, 6))])
    diagonal, upper, lower = (
        jnp.sum(blocks[table], 3).transpose(0, 1, 3, 2, 4).reshape(levels, n, n) for table in topology.blocks
    )
    own = bodies.reshape(levels, width, 6, 6)
    eye = jnp.eye(width)
    diagonal = diagonal + (own[:, :, :, None, :] * eye[None, :, None, :, None]).reshape(levels, n, n)

    def eliminate(carried: Array, level: tuple[Array, Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        block, below, above = level
        inverse, coupling = _eliminated(block - carried, above)
        return _product(below, coupling), (inverse, coupling)

    _, (pivots, couplings) = lax.scan(eliminate, jnp.zeros((n, n)), (diagonal, lower, upper))
    return Factor(pivots, lower, couplings)


def solve(factored: Factor, rhs: Float[Array, "slots 6"]) -> Float[Array, "slots 6"]:
    """x with M x = rhs; linear in rhs, so that JAX can transpose it."""
    levels, n, _ = factored.pivot_inverse.shape
    if rhs.size and kernel.available():
        return kernel.solve(*factored, rhs)

    def forward(carried: Array, level: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        inverse, below, right = level
        reduced = _product(inverse, right - carried)
        return _product(below, reduced), reduced

    def backward(after: Array, level: tuple[Array, Array]) -> tuple[Array, Array]:
        coupling, reduced = level
        x = reduced - _product(coupling, after)
        return x, x

    zero = jnp.zeros(n)
    _, reduced = lax.scan(forward, zero, (factored.pivot_inverse, factored.lower, rhs.reshape(levels, n)))
    _, x = lax.scan(backward, zero, (factored.coupling, reduced), reverse=True)
    return x.reshape(-1, 6)


def _product(a: Float[Array, "n n"], b: Float[Array, "n *m"]) -> Float[Array, "n *m"]:
    """a b as a sum: handing a single small product to a library takes longer than the product."""
    return jnp.sum(a.reshape(*a.shape, *[1] * (b.ndim - 1)) * b, 1)


@jax.custom_jvp
def _eliminated(a: Float[Array, "n n"], above: Float[Array, "n n"]) -> tuple[Float[Array, "n n"], Float[Array, "n n"]]:
    """a⁻¹ and a⁻¹ above, by Gauss and Jordan with the pivots in their order, as inertia and stiffness allow; where one
    of them is too small, LAPACK's, in a loop so that a batch none of whose samples asks for it does without.

    Both come of the same row operations.  The product of inverse and `above` would be off by rounding times the
    condition of a: where a stiff joint links a body that nothing stiff holds to the next, more than the mass of either.
    """
    n = a.shape[-1]
    each = jnp.arange(2 * n)

    def eliminate(k: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        b, share = now
        own = each == k
        row = jnp.where(own, 1.0, b[k]) / b[k, k]
        others = jnp.where(own, 0.0, b) - b[:, k, None] * row
        behind = jnp.where(each[:n] > k, jnp.abs(row[:n]), 0.0)
        return jnp.where(own[:n, None], row, others), jnp.maximum(share, behind)

    both = jnp.concatenate([a, above], -1)
    in_order, share = lax.fori_loop(0, n, eliminate, (both, jnp.zeros(n)), unroll=2)
    refused = ~jnp.all(share < UNPIVOTED)

    def pivoted(now: tuple[Array, Array]) -> tuple[Array, Array]:
        return ~now[0], jnp.linalg.solve(now[1][:, :n], jnp.concatenate([jnp.eye(n), now[1][:, n:]], -1))

    begin = refused, jnp.where(refused, both, in_order)
    made = lax.while_loop(lambda now: now[0], pivoted, begin)[1]
    return made[:, :n], made[:, n:]


@_eliminated.defjvp
def _eliminated_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[tuple, tuple]:
    inverse, coupling = _eliminated(*primals)
    by_a, by_above = tangents
    return (inverse, coupling), (-inverse @ by_a @ inverse, inverse @ (by_above - by_a @ coupling))
