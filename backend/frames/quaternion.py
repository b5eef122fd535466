"""Unit quaternions [w, x, y, z] that rotate body coordinates into world coordinates."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def multiply(p: Float[Array, "*batch 4"], q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """Hamilton product p ⊗ q: turn by q first, then by p."""
    pw, pv, qw, qv = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    scalar = pw * qw - jnp.sum(pv * qv, -1, keepdims=True)
    return jnp.concatenate([scalar, pw * qv + qw * pv + jnp.cross(pv, qv)], -1)


def conjugate(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 4"]:
    """The inverse turn of a unit quaternion."""
    return q * jnp.array([1.0, -1.0, -1.0, -1.0])


def rotation(q: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrix R_WB of a unit quaternion, columns are the body's axes in W."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        jnp.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        jnp.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        jnp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return jnp.stack(rows, -2)


def cosine_half(phi: Float[Array, "*batch 3"]) -> Float[Array, "*batch 1"]:
    """Scalar part s = √(1 - |φ|²/4) of the turn whose vector part is φ/2."""
    return jnp.sqrt(1.0 - 0.25 * jnp.sum(phi * phi, -1, keepdims=True))


def advance(q: Float[Array, "*batch 4"], phi: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Turn a body by φ in its own axes: q ⊗ (s, φ/2).  For small turns φ is the rotation vector [rad]."""
    return multiply(q, jnp.concatenate([cosine_half(phi), 0.5 * phi], -1))


def increment(q: Float[Array, "*batch 4"], q_next: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """The φ that `advance` needs to reach q_next from q (shortest way)."""
    turn = multiply(conjugate(q), q_next)
    return 2.0 * turn[..., 1:] * jnp.sign(turn[..., :1])


def skew(v: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """The matrix of v ×."""
    a, b, c = v[..., 0], v[..., 1], v[..., 2]
    zero = jnp.zeros_like(a)
    rows = [jnp.stack([zero, -c, b], -1), jnp.stack([c, zero, -a], -1), jnp.stack([-b, a, zero], -1)]
    return jnp.stack(rows, -2)


def tangent_map(phi: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """dφ/dθ, where θ is a small turn of the advanced body in its own axes."""
    return cosine_half(phi)[..., None] * jnp.eye(3) + 0.5 * skew(phi)


def turning_map(phi: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """dθ/dφ, the inverse of `tangent_map`; a half turn has none."""
    s = cosine_half(phi)[..., None]
    return s * jnp.eye(3) + 0.25 / s * phi[..., :, None] * phi[..., None, :] - 0.5 * skew(phi)
