"""The six rows of every joint, and how they change when its bodies move."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from backend.frames import quaternion
from backend.joints.joint import SLIDE, TURN
from backend.model.incidence import picked
from backend.model.state import Pose
from backend.model.system import System
from backend.simulate.kernel import call as kernel
from backend.simulate.kernel.call import Joints
from backend.simulate.slopes import along
from backend.simulate.small import apply, apply_transposed, dot


class Bodies(NamedTuple):
    """Poses of all bodies, fixed ones last, with their rotation matrices."""

    position: Float[Array, "bodies 3"]
    rotation: Float[Array, "bodies 3 3"]


class Rows(NamedTuple):
    """Joint rows and their Jacobian with respect to (Δx in W, turn in body axes) of body A, then body B.

    value: offset x, y, z in frame A [m]; tilt x, tilt y; sine of the turn about z.
    """

    value: Float[Array, "joints 6"]
    jacobian: Float[Array, "joints 6 12"]


def bodies(system: System, pose: Pose) -> Bodies:
    """Moving and fixed bodies in one table."""
    position = jnp.concatenate([pose.position, system.fixed_position])
    attitude = jnp.concatenate([pose.quaternion, system.fixed_quaternion])
    return Bodies(position, quaternion.rotation(attitude))


def rows(system: System, placed: Bodies) -> Rows:
    """All six rows of every joint at these poses, held or not."""
    rows_of = _compiled if system.topology.joints and kernel.available() else _rows
    return rows_of(_joints(system), placed, _drawn(system))


class Drawn(NamedTuple):
    """The joints' frames in their bodies: columns are axes in body axes, points are relative to the centre of mass."""

    axes_a: Float[Array, "joints 3 3"]
    axes_b: Float[Array, "joints 3 3"]
    point_a: Float[Array, "joints 3"]
    point_b: Float[Array, "joints 3"]


def _joints(system: System) -> Joints:
    turns, slides = (tuple(system.coordinate_rows[:, row].tolist()) for row in (TURN, SLIDE))
    return Joints(system.topology.joints, turns, slides)


def _drawn(system: System) -> Drawn:
    return Drawn(system.axes_a, system.axes_b, system.point_a, system.point_b)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _compiled(joints: Joints, placed: Bodies, drawn: Drawn) -> Rows:
    return Rows(*kernel.joint_rows(joints, *placed, *drawn))


def _compiled_jvp(joints: Joints, primals: tuple, tangents: tuple) -> tuple[Rows, Rows]:
    # Of the Jacobian's own change only walls and friction that falls with the rate ever ask.
    _, change = along(functools.partial(_rows, joints), primals, tangents)
    value = _compiled_slopes(kernel.VALUE, joints, primals, tangents)
    return _compiled(joints, *primals), Rows(value, change.jacobian)


_compiled.defjvp(_compiled_jvp, symbolic_zeros=True)


def _compiled_slopes(measure: int, joints: Joints, primals: tuple, tangents: tuple) -> Float[Array, "joints measure"]:
    """What joints measure, along the tangents that are no symbolic zeros."""
    operands, tree = jax.tree.flatten(primals)
    changes = enumerate(tree.flatten_up_to(tangents))
    moving = {i: change for i, change in changes if not isinstance(change, SymbolicZero)}
    return kernel.joint_slopes(measure, joints, tuple(operands), moving)


def _rows(joints: Joints, placed: Bodies, drawn: Drawn) -> Rows:
    a, b = np.array(joints.pairs, dtype=int).reshape(-1, 2).T
    free_turn = joints.turns
    F_A, F_B, r_A, r_B = drawn
    R_WA, R_WB = picked(placed.rotation, a), picked(placed.rotation, b)
    axes_W = _product(R_WA, F_A)
    p_AP = apply_transposed(R_WA, picked(placed.position, b) + apply(R_WB, r_B) - picked(placed.position, a))
    offset = apply_transposed(F_A, p_AP - r_A)
    x_W, z_W = apply(R_WB, F_B[:, :, 0]), apply(R_WB, F_B[:, :, 2])
    along_x, along_y = axes_W[:, :, 0], axes_W[:, :, 1]
    angles = jnp.stack([dot(along_x, z_W), dot(along_y, z_W), dot(along_y, x_W)], -1)

    axes_t = jnp.swapaxes(axes_W, 1, 2)
    shift = jnp.concatenate(
        [
            -axes_t,
            _product(jnp.swapaxes(F_A, 1, 2), quaternion.skew(p_AP)),
            axes_t,
            -_product(_product(axes_t, R_WB), quaternion.skew(r_B)),
        ],
        -1,
    )
    x_A, z_A = apply_transposed(R_WA, x_W), apply_transposed(R_WA, z_W)
    x_B, y_B = apply_transposed(R_WB, along_x), apply_transposed(R_WB, along_y)
    zero = jnp.zeros_like(x_A)
    turn = jnp.stack(
        [
            jnp.concatenate([zero, jnp.cross(F_A[:, :, 0], z_A), zero, jnp.cross(F_B[:, :, 2], x_B)], -1),
            jnp.concatenate([zero, jnp.cross(F_A[:, :, 1], z_A), zero, jnp.cross(F_B[:, :, 2], y_B)], -1),
            jnp.concatenate([zero, jnp.cross(F_A[:, :, 1], x_A), zero, jnp.cross(F_B[:, :, 0], y_B)], -1),
        ],
        1,
    )
    if any(free_turn):
        # A free turn is measured by increments about the pin, which know no ±90 degrees.
        pin = jnp.concatenate([zero, -F_A[:, :, 2], zero, F_B[:, :, 2]], -1)
        turn = turn.at[:, 2].set(jnp.where(np.array(free_turn)[:, None], pin, turn[:, 2]))
    return Rows(jnp.concatenate([offset, angles], -1), jnp.concatenate([shift, turn], 1))


def pulled(
    system: System, placed: Bodies, jacobian: Float[Array, "joints 6 12"], impulses: Float[Array, "joints 6"]
) -> Float[Array, "joints 12"]:
    """Jᵀ λ of every joint on its two bodies.  J is known; the slope is that of the product, not of all of J."""
    return _pulled(_joints(system), jacobian, placed, _drawn(system), impulses)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _pulled(
    joints: Joints, jacobian: Array, placed: Bodies, drawn: Drawn, impulses: Array
) -> Float[Array, "joints 12"]:
    return apply_transposed(jacobian, impulses)


def _pulled_jvp(joints: Joints, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    if joints.pairs and kernel.available():
        change = _compiled_slopes(kernel.WRENCH, joints, primals[1:], tangents[1:])
    else:
        _, change = along(functools.partial(_wrenches, joints), primals[1:], tangents[1:])
    return _pulled(joints, *primals), change


_pulled.defjvp(_pulled_jvp, symbolic_zeros=True)


def _wrenches(
    joints: Joints, placed: Bodies, drawn: Drawn, impulses: Float[Array, "joints 6"]
) -> Float[Array, "joints 12"]:
    """Impulses along the rows as impulse (in W) and turning impulse (in body axes) on body A, then on body B."""
    a, b = np.array(joints.pairs, dtype=int).reshape(-1, 2).T
    free_turn = joints.turns
    F_A, F_B, _, r_B = drawn
    R_WA, R_WB = picked(placed.rotation, a), picked(placed.rotation, b)
    turn = jnp.where(np.array(free_turn), 0.0, impulses[:, 5])
    along = jnp.stack([impulses[:, :3], jnp.stack([impulses[:, 3], impulses[:, 4], jnp.zeros_like(turn)], -1)], -1)
    push_W, tilt_W = jnp.moveaxis(_product(R_WA, _product(F_A, along)), -1, 0)
    arm_W = apply(R_WB, r_B)
    lever_W = picked(placed.position, b) + arm_W - picked(placed.position, a)
    z_W = apply(R_WB, F_B[:, :, 2])
    twist_W = jnp.cross(tilt_W, z_W)
    if not all(free_turn):
        along_y = apply(R_WA, turn[:, None] * F_A[:, :, 1])
        twist_W = twist_W + jnp.cross(along_y, apply(R_WB, F_B[:, :, 0]))
    on_a = apply_transposed(R_WA, jnp.cross(push_W, lever_W) + twist_W)
    on_b = apply_transposed(R_WB, jnp.cross(arm_W, push_W) - twist_W)
    if any(free_turn):
        pin = jnp.where(np.array(free_turn), impulses[:, 5], 0.0)[:, None]
        on_a, on_b = on_a - pin * F_A[:, :, 2], on_b + pin * F_B[:, :, 2]
    return jnp.concatenate([-push_W, on_a, push_W, on_b], -1)


def turned(system: System, xi: Float[Array, "slots 6"]) -> Float[Array, "joints"]:
    """Turn of B relative to A about the pin in a step ξ [rad], to third order in the turn."""
    a, b = system.pairs.T
    phi = jnp.concatenate([xi[:, 3:], jnp.zeros_like(system.fixed_position)])
    return dot(system.axes_b[:, :, 2], picked(phi, b)) - dot(system.axes_a[:, :, 2], picked(phi, a))


def ease(system: System, rows: Float[Array, "n k 12"], pairs: np.ndarray) -> Float[Array, "n"]:
    """Inverse of the mass that two bodies alone oppose to a push along their rows, the largest of k rows."""
    if not len(pairs):
        return jnp.zeros(0)
    share = jnp.stack([1.0 / system.mass, 3.0 / jnp.trace(system.inertia, axis1=1, axis2=2)], -1).repeat(3, -1)
    both = picked(share, np.minimum(pairs, system.topology.slots).ravel()).reshape(-1, 1, 12)
    return jnp.max(jnp.sum(rows * rows * both, -1), -1)


def coordinates(system: System, placed: Bodies) -> Float[Array, "joints"]:
    """q of every joint as a motion begins: turn, in its whole turn, or travel; 0 where a joint has none."""
    return coordinates_near(system, placed, system.begins_near)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _coordinates(joints: Joints, placed: Bodies, drawn: Drawn) -> Float[Array, "joints"]:
    return _turns_and_travels(joints, placed, drawn)


def _coordinates_jvp(joints: Joints, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    if joints.pairs and kernel.available():
        change = _compiled_slopes(kernel.COORDINATE, joints, primals, tangents)[:, 0]
    else:
        _, change = along(functools.partial(_turns_and_travels, joints), primals, tangents)
    return _coordinates(joints, *primals), change


_coordinates.defjvp(_coordinates_jvp, symbolic_zeros=True)


def _turns_and_travels(joints: Joints, placed: Bodies, drawn: Drawn) -> Float[Array, "joints"]:
    a, b = np.array(joints.pairs, dtype=int).reshape(-1, 2).T
    R_WA, R_WB = picked(placed.rotation, a), picked(placed.rotation, b)
    axes_A, axes_B = _product(R_WA, drawn.axes_a), _product(R_WB, drawn.axes_b)
    x_B = axes_B[:, :, 0]
    turn = jnp.arctan2(dot(axes_A[:, :, 1], x_B), dot(axes_A[:, :, 0], x_B))
    p_W = (
        picked(placed.position, b)
        + apply(R_WB, drawn.point_b)
        - picked(placed.position, a)
        - apply(R_WA, drawn.point_a)
    )
    travel = dot(axes_A[:, :, 2], p_W)
    return jnp.where(np.array(joints.turns), turn, 0.0) + jnp.where(np.array(joints.slides), travel, 0.0)


def coordinates_near(system: System, placed: Bodies, near: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """q of every joint, with the whole turns that bring it nearest to another q."""
    return unwrap(system, _coordinates(_joints(system), placed, _drawn(system)), near)


def unwrap(system: System, q: Float[Array, "joints"], near: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Add whole turns so that turning joints stay near their previous q."""
    return jnp.where(system.coordinate_rows[:, TURN], q + 2 * jnp.pi * jnp.round((near - q) / (2 * jnp.pi)), q)


def _product(a: Float[Array, "n i j"], b: Float[Array, "n j k"]) -> Float[Array, "n i k"]:
    return jnp.einsum("...ij,...jk->...ik", a, b)
