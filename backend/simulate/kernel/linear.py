"""Compiled functions that are linear in some of their arguments, and whose transposes are compiled too."""

import functools
from collections.abc import Callable
from typing import Any

import jax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

SWITCH = "LINKTWIN_KERNEL"
FIRST_ONLY = (
    "The compiled kernel gives first derivatives only (what a slope is taken at is taken as it is). "
    f"Set {SWITCH}=off before Python starts for second derivatives."
)


Arrays = tuple[Array, ...]


def linear(function: Callable, transposed: Callable, at: Arrays, changes: Arrays) -> Arrays:
    """function(at, changes), which is linear in the changes; its transpose is transposed(at, worth)."""
    return tuple(_linear.bind(*at, *changes, function=function, transposed=transposed, known=len(at)))


def _called(*operands: Array, function: Callable, transposed: Callable, known: int) -> Arrays:
    return function(operands[:known], operands[known:])


def _shapes(*operands: ShapedArray, **how: Any) -> list[ShapedArray]:
    return [ShapedArray(x.shape, x.dtype) for x in jax.eval_shape(functools.partial(_called, **how), *operands)]


def _along(primals: tuple, tangents: tuple, *, known: int, **how: Any) -> tuple[list, list]:
    if any(not isinstance(tangent, ad.Zero) for tangent in tangents[:known]):
        raise NotImplementedError(FIRST_ONLY)
    changes = map(ad.instantiate_zeros, tangents[known:])
    here, along = (_linear.bind(*primals[:known], *x, known=known, **how) for x in (primals[known:], changes))
    return here, along


def _sent_back(worth: list, *operands: Any, function: Callable, transposed: Callable, known: int) -> list:
    worth = [ad.instantiate_zeros(x) for x in worth]
    back = _linear.bind(*operands[:known], *worth, function=transposed, transposed=function, known=known)
    return [*[None] * known, *back]


def _batched(
    operands: Arrays, axes: tuple[int | None, ...], *, function: Callable, transposed: Callable, known: int
) -> tuple[list, list[int]]:
    at, changed = axes[:known], axes[known:]
    kept = tuple(0 if axis is None else axis for axis in changed)

    def all_back(operands: Arrays, worth: Arrays) -> Arrays:
        back = jax.vmap(transposed, (at, 0), kept)(operands, worth)
        return tuple(x.sum(0) if axis is None else x for x, axis in zip(back, changed, strict=True))

    every = jax.vmap(function, (at, changed))
    made = _linear.bind(*operands, function=every, transposed=all_back, known=known)
    return made, [0] * len(made)


_linear = Primitive("compiled_linear_function")
_linear.multiple_results = True
_linear.def_impl(_called)
_linear.def_abstract_eval(_shapes)
ad.primitive_jvps[_linear] = _along
ad.primitive_transposes[_linear] = _sent_back
batching.primitive_batchers[_linear] = _batched
mlir.register_lowering(_linear, mlir.lower_fun(_called, multiple_results=True))
