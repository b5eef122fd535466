"""What a motion keeps: energy, momentum, closed joints."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.model.state import Pose
from backend.model.system import System
from backend.simulate import forces, kinematics
from backend.simulate.momentum import instantaneous
from backend.simulate.rollout import Trajectory
from backend.simulate.small import apply, dot


def kinetic_energy(system: System, trajectory: Trajectory) -> Float[Array, "nodes"]:
    """½ vᵀ M v of all bodies, rotors included [J]."""

    def at(velocity: Array, rate: Array) -> Array:
        real = jnp.array([body is not None for body in system.topology.body_ids])
        body = jnp.sum(velocity * instantaneous(system, velocity), -1)
        return 0.5 * (jnp.sum(jnp.where(real, body, 0.0)) + jnp.sum(system.rotor * rate**2))

    return jax.vmap(at)(trajectory.velocity, trajectory.rate)


def potential_energy(system: System, trajectory: Trajectory) -> Float[Array, "nodes"]:
    """Weight, springs at joints and between bodies [J]."""

    def at(pose: Pose, q: Array) -> Array:
        placed = kinematics.bodies(system, pose)
        still = jnp.zeros((pose.position.shape[0], 6))
        total = jnp.zeros(())
        for group in system.forces:
            first, second = (group.at(0), group.at(-1))
            views = [forces.views(system, placed, still, which) for which in (first, second)]
            total += jnp.sum(jax.vmap(lambda e, a, b: e.potential(a, b))(group.here, *views))
        for group in system.efforts:
            total += jnp.sum(jax.vmap(lambda e, x: e.potential(x))(group.here, q[group.at()]))
        total += 0.5 * jnp.sum(system.stiffness * (q - system.rest) ** 2)
        length, _ = forces.strut_lines(system, placed)
        first = 0
        for group in system.struts:
            part = length[first : first + len(group.places)]
            total += jnp.sum(jax.vmap(lambda e, x: e.potential(x))(group.here, part))
            first += len(group.places)
        return total

    return jax.vmap(at)(trajectory.pose, trajectory.q)


def constraint_error(system: System, trajectory: Trajectory) -> Float[Array, "nodes"]:
    """Largest offset of a held direction, tilts counted at one mechanism length [m]; play is no error."""

    def at(pose: Pose) -> Array:
        value = kinematics.rows(system, kinematics.bodies(system, pose)).value
        unit = jnp.array([1.0] * 3 + [system.scale.length_m] * 3)
        return jnp.max(jnp.where(system.rigid_rows, jnp.abs(value) * unit, 0.0), initial=0.0)

    return jax.vmap(at)(trajectory.pose)


def momentum(system: System, trajectory: Trajectory) -> Float[Array, "nodes 6"]:
    """Linear [N s] and angular momentum about the world's origin [N m s], in W."""
    real = jnp.array([body is not None for body in system.topology.body_ids])[:, None]

    def at(pose: Pose, velocity: Array) -> Array:
        own = instantaneous(system, velocity)
        linear = jnp.where(real, own[:, :3], 0.0)
        spin = apply(kinematics.bodies(system, pose).rotation[: own.shape[0]], own[:, 3:])
        angular = jnp.where(real, spin, 0.0) + jnp.cross(pose.position, linear)
        return jnp.concatenate([jnp.sum(linear, 0), jnp.sum(angular, 0)])

    return jax.vmap(at)(trajectory.pose, trajectory.velocity)


def joint_power(system: System, trajectory: Trajectory) -> Float[Array, "nodes joints"]:
    """Power that the joints' coordinates take out of (negative) or put into the motion [W]."""
    effort = jnp.sum(jnp.where(system.coordinate_rows, trajectory.reaction, 0.0), -1)
    return dot(effort[..., None], trajectory.rate[..., None])
