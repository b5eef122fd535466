"""The compiled functions as JAX sees them: batched by vmap; the solve is linear in the right-hand side."""

import ctypes
import functools
import os
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from backend.simulate.kernel.build import library
from backend.simulate.kernel.linear import FIRST_ONLY, SWITCH, linear

FACTOR, SOLVE = "linktwin_block_tridiagonal_factor", "linktwin_block_tridiagonal_solve"
ROWS = "linktwin_joint_rows"
SLOPES, SLOPES_BACK = "linktwin_joint_slopes", "linktwin_joint_slopes_transposed"
TARGETS = {
    FACTOR: "BlockTridiagonalFactor",
    SOLVE: "BlockTridiagonalSolve",
    ROWS: "JointRows",
    SLOPES: "JointSlopes",
    SLOPES_BACK: "JointSlopesTransposed",
}
"""Names for JAX, and of the functions in the library."""


def available() -> bool:
    """Whether a library stands ready for this program: double precision on the CPU, and not switched off."""
    wanted = os.environ.get(SWITCH, "on").lower() != "off"
    double = jnp.zeros(()).dtype == jnp.float64
    return wanted and double and jax.default_backend() == "cpu" and _loaded()


@functools.cache
def _loaded() -> bool:
    found = library()
    if found is None:
        return False
    try:
        symbols = ctypes.cdll.LoadLibrary(str(found))
    except OSError:
        return False
    for name, symbol in TARGETS.items():
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(getattr(symbols, symbol)), platform="cpu")
    return True


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1, 2))
def factor(
    levels: int,
    width: int,
    links: tuple[tuple[int, int], ...],
    bodies: Float[Array, "slots 6 6"],
    left: Float[Array, "joints 6 12"],
    stiffness: Float[Array, "joints 6"] | Float[Array, "joints 6 6"],
    right: Float[Array, "joints 6 12"],
    others: Float[Array, "others 12 12"],
) -> tuple[Float[Array, "levels n n"], Float[Array, "levels n n"], Float[Array, "levels n n"]]:
    """Pivots' inverses, lower blocks and couplings; links: slots of both ends, joints first."""
    blocks = jax.ShapeDtypeStruct((levels, 6 * width, 6 * width), jnp.float64)
    call = jax.ffi.ffi_call(FACTOR, (blocks, blocks, blocks), vmap_method="expand_dims")
    slots = np.array(links, dtype=np.int32).ravel()
    made = call(bodies, left, stiffness, right, others, links=slots, width=np.int64(width))
    return made[0], made[1], made[2]


@factor.defjvp
def _factor_jvp(levels: int, width: int, links: tuple, primals: tuple, tangents: tuple) -> tuple:
    raise NotImplementedError(FIRST_ONLY)


def solve(
    pivot_inverse: Float[Array, "levels n n"],
    lower: Float[Array, "levels n n"],
    coupling: Float[Array, "levels n n"],
    rhs: Float[Array, "slots 6"],
) -> Float[Array, "slots 6"]:
    """x with M x = rhs."""

    def by(transposed: bool, b: Array) -> Array:
        call = jax.ffi.ffi_call(SOLVE, jax.ShapeDtypeStruct(b.shape, b.dtype), vmap_method="expand_dims")
        return call(pivot_inverse, lower, coupling, b, transposed=transposed)

    def times(x: Array) -> Array:
        """M x = (pivots + lower) (1 + coupling) x; JAX asks for it and then needs only the two solves."""
        levels, n, _ = pivot_inverse.shape
        reduced = x.reshape(levels, n)
        reduced = reduced.at[:-1].add(jnp.einsum("lij,lj->li", coupling[:-1], reduced[1:]))
        b = jnp.linalg.solve(pivot_inverse, reduced[..., None])[..., 0]
        return b.at[1:].add(jnp.einsum("lij,lj->li", lower[:-1], reduced[:-1])).reshape(x.shape)

    solve_it, solve_transposed = functools.partial(by, False), functools.partial(by, True)
    return lax.custom_linear_solve(times, rhs, lambda _, b: solve_it(b), lambda _, b: solve_transposed(b))


class Joints(NamedTuple):
    """What is known of all joints when a program is compiled."""

    pairs: tuple[tuple[int, int], ...]
    """Bodies A and B, fixed ones last."""
    turns: tuple[bool, ...]
    """Whether the coordinate is a turn about the pin."""
    slides: tuple[bool, ...]


VALUE, WRENCH, COORDINATE = 6, 12, 1
"""What joints measure, by its count of numbers: the rows, Jᵀ λ on both bodies, q."""


def joint_rows(
    joints: Joints,
    position: Float[Array, "bodies 3"],
    rotation: Float[Array, "bodies 3 3"],
    axes_a: Float[Array, "joints 3 3"],
    axes_b: Float[Array, "joints 3 3"],
    point_a: Float[Array, "joints 3"],
    point_b: Float[Array, "joints 3"],
) -> tuple[Float[Array, "joints 6"], Float[Array, "joints 6 12"]]:
    """Values and Jacobian of all joints' rows, without derivatives."""
    count = len(joints.pairs)
    shapes = jax.ShapeDtypeStruct((count, 6), jnp.float64), jax.ShapeDtypeStruct((count, 6, 12), jnp.float64)
    call = jax.ffi.ffi_call(ROWS, shapes, vmap_method="expand_dims")
    bodies, free = np.array(joints.pairs, dtype=np.int32).ravel(), np.array(joints.turns, dtype=np.int32)
    made = call(position, rotation, axes_a, axes_b, point_a, point_b, bodies=bodies, turns_freely=free)
    return made[0], made[1]


def joint_slopes(
    measure: int, joints: Joints, operands: tuple[Array, ...], changes: dict[int, Array]
) -> Float[Array, "joints measure"]:
    """What joints measure, along changes of some operands, which are numbered.

    operands: as of `joint_rows`, position first; for the wrench also the impulses (joints 6).
    """
    count, varied = len(joints.pairs), tuple(changes)
    attributes = {
        "bodies": np.array(joints.pairs, dtype=np.int32).ravel(),
        "does": np.array(joints.turns, dtype=np.int32) + 2 * np.array(joints.slides, dtype=np.int32),
        "varied": np.array(varied, dtype=np.int32),
    }
    measured = (jax.ShapeDtypeStruct((count, measure), jnp.float64),)
    sent = tuple(jax.ShapeDtypeStruct(operands[i].shape, jnp.float64) for i in varied)

    def by(target: str, shapes: tuple, operands: tuple[Array, ...], given: tuple[Array, ...]) -> tuple[Array, ...]:
        call = jax.ffi.ffi_call(target, shapes, vmap_method="expand_dims")
        return tuple(call(*operands, *given, **attributes))

    along, back = functools.partial(by, SLOPES, measured), functools.partial(by, SLOPES_BACK, sent)
    return linear(along, back, operands, tuple(changes.values()))[0]
