"""Rows gathered and added by tables that are known when a program is compiled: who acts on whom.

XLA runs a scatter, which is also the transpose of a gather, as a loop over its rows.  But the transpose of such a table
is a table again, so here both directions gather, and derivatives backwards in time as well.
"""

from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float

Table = tuple[tuple[int, ...], ...]
FEW = 4  # rows that are added at once


def picked(rows: Float[Array, "n *row"], which: np.ndarray) -> Float[Array, "m *row"]:
    """Row which[i] in place i; zeros where which[i] is n."""
    return gathered(rows, np.asarray(which, dtype=int)[:, None])


def gathered(rows: Float[Array, "n *row"], table: np.ndarray) -> Float[Array, "m *row"]:
    """The sum of the rows table[i] in place i; n adds nothing."""
    return _gather.bind(jnp.asarray(rows), table=tuple(map(tuple, table.tolist())), axis=0)


def added(rows: Float[Array, "n *row"], which: np.ndarray, count: int) -> Float[Array, "m *row"]:
    """Row i added to place which[i] of `count`."""
    return _sent_back(jnp.asarray(rows), ((place,) for place in which.tolist()), count, 0)


def with_row(rows: Float[Array, "n *row"], at: int | Array, row: Array) -> Float[Array, "n *row"]:
    """A copy with another row in place `at`, by a choice that XLA fuses."""
    here = (jnp.arange(rows.shape[0]) == at).reshape(-1, *[1] * (rows.ndim - 1))
    return jnp.where(here, row, rows)


def _sent_back(rows: Array, table: Iterable[tuple[int, ...]], count: int, axis: int) -> Array:
    """The transpose of gathering from `count` rows: row i goes to every place that table[i] names."""
    places: list[list[int]] = [[] for _ in range(count + 1)]
    for i, entries in enumerate(table):
        for entry in entries:
            places[entry].append(i)
    places = places[:count]
    while any(len(place) > FEW for place in places):  # all act on one body: a few sums first, or its row makes all wide
        parts = [place[i : i + FEW] for place in places for i in range(0, len(place), FEW)]
        rows, ends = _gather.bind(rows, table=_filled(parts, rows.shape[axis]), axis=axis), iter(range(len(parts)))
        places = [[next(ends) for _ in range(0, len(place), FEW)] for place in places]
    return _gather.bind(rows, table=_filled(places, rows.shape[axis]), axis=axis)


def _filled(places: list[list[int]], none: int) -> Table:
    deepest = max([1, *map(len, places)])
    return tuple((*place, *[none] * (deepest - len(place))) for place in places)


def _gathered(rows: Array, *, table: Table, axis: int) -> Array:
    count, index = rows.shape[axis], np.array(table, dtype=int)
    if not index.size:
        return jnp.zeros(_shape(rows, table, axis), rows.dtype)
    if (index == count).any():
        none = jnp.zeros((*rows.shape[:axis], 1, *rows.shape[axis + 1 :]), rows.dtype)
        rows = jnp.concatenate([rows, none], axis)
    found = jnp.take(rows, index, axis, mode="clip")
    return jnp.squeeze(found, axis + 1) if index.shape[1] == 1 else jnp.sum(found, axis + 1)


def _shape(rows: Array | ShapedArray, table: Table, axis: int) -> tuple[int, ...]:
    return *rows.shape[:axis], len(table), *rows.shape[axis + 1 :]


def _transposed(change: Array | ad.Zero, rows: ad.UndefinedPrimal, *, table: Table, axis: int) -> list:
    if isinstance(change, ad.Zero):
        return [ad.Zero(rows.aval)]
    return [_sent_back(change, table, rows.aval.shape[axis], axis)]


def _batched(arguments: tuple[Array], dimensions: tuple[int], *, table: Table, axis: int) -> tuple[Array, int]:
    return _gather.bind(jnp.moveaxis(arguments[0], dimensions[0], 0), table=table, axis=axis + 1), 0


_gather = Primitive("gather_by_table")
_gather.def_impl(_gathered)
_gather.def_abstract_eval(lambda rows, *, table, axis: rows.update(shape=_shape(rows, table, axis)))
ad.deflinear2(_gather, _transposed)
batching.primitive_batchers[_gather] = _batched
mlir.register_lowering(_gather, mlir.lower_fun(_gathered, multiple_results=False))
