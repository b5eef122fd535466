"""Discrete momenta of the variational integrator, and what moves them between steps.

A step from q_k to q_{k+1} is an increment ξ = (Δx, φ) per body.  Its momentum at either end is
P±(ξ) = (m Δx / h, (1/h)[s J φ ± ½ φ x J φ]), s = √(1 - |φ|²/4), turns in body axes: P⁺ at q_k, P⁻ at q_{k+1}.
The sum of P⁺ - P⁻ over a body is zero in free flight (Manchester and Peck 2016, eq. 22 up to notation).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.frames.quaternion import cosine_half, skew, tangent_map
from backend.model.system import System
from backend.simulate.small import apply

BodyRows = Float[Array, "slots 6"]


def momentum(system: System, xi: BodyRows, step_s: float | Array, end: float) -> BodyRows:
    """P⁺ (end = +1, at the step's start) or P⁻ (end = -1, at its end) [N s, N m s]."""
    phi = xi[:, 3:]
    spin = apply(system.inertia, phi)
    turning = cosine_half(phi) * spin + end * 0.5 * jnp.cross(phi, spin)
    return jnp.concatenate([system.mass[:, None] * xi[:, :3], turning], -1) / step_s


def momentum_slope(system: System, xi: BodyRows, step_s: float | Array) -> Float[Array, "slots 6 6"]:
    """dP⁺ / d(Δx, turn of the advanced body in its own axes)."""
    phi = xi[:, 3:]
    s = cosine_half(phi)[..., None]
    spin = apply(system.inertia, phi)
    turning = s * system.inertia - spin[:, :, None] * phi[:, None, :] / (4 * s)
    gyration = skew(phi)[:, :, :, None] * system.inertia[:, None, :, :]
    turning = turning + 0.5 * (jnp.sum(gyration, 2) - skew(spin))
    turning = jnp.sum(turning[:, :, :, None] * tangent_map(phi)[:, None, :, :], 2)
    linear = system.mass[:, None, None] * jnp.eye(3)
    zero = jnp.zeros_like(linear)
    top, bottom = jnp.concatenate([linear, zero], -1), jnp.concatenate([zero, turning], -1)
    return jnp.concatenate([top, bottom], -2) / step_s


def instantaneous(system: System, velocity: BodyRows) -> BodyRows:
    """M v: momentum of a velocity (turn rate in body axes)."""
    return jnp.concatenate([system.mass[:, None] * velocity[:, :3], apply(system.inertia, velocity[:, 3:])], -1)
