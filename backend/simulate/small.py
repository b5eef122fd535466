"""Products of batches of small matrices, written as sums so that XLA fuses them into one loop."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def apply(matrix: Float[Array, "*batch i j"], vector: Float[Array, "*batch j"]) -> Float[Array, "*batch i"]:
    """M v."""
    return jnp.einsum("...ij,...j->...i", matrix, vector)


def apply_transposed(matrix: Float[Array, "*batch i j"], vector: Float[Array, "*batch i"]) -> Float[Array, "*batch j"]:
    """Mᵀ v."""
    return jnp.einsum("...ij,...i->...j", matrix, vector)


def dot(a: Float[Array, "*batch i"], b: Float[Array, "*batch i"]) -> Float[Array, "*batch"]:
    """a · b."""
    return jnp.sum(a * b, -1)
