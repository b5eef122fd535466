"""The effects of one kind in a model, and where each of them acts."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from backend.effects.effect import AbstractEffect
from backend.model.incidence import added, picked


class Placed(eqx.Module):
    """Effects of one kind.  Leaves of `effect` have one row per drawn effect; a row may act at several places."""

    effect: AbstractEffect
    ids: tuple[str, ...] = eqx.field(static=True)
    rows: tuple[int, ...] = eqx.field(static=True)
    places: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Of each place: joint or marker index (1), body slots (1 or 2), batch and row of another effect (2); none (0)
    where it acts on all of a measurement, or where the shape itself says where."""
    shares: tuple[float, ...] = eqx.field(static=True, default=())
    """Part of the effect that acts at each place; empty where it is all of it."""

    @property
    def here(self) -> AbstractEffect:
        """The effects with one row of leaves per place."""
        rows = np.array(self.rows, dtype=int)
        if np.array_equal(rows, np.arange(len(self.ids))):
            return self.effect
        return jax.tree.map(lambda leaf: picked(leaf, rows), self.effect)

    def each(self) -> list[Any]:
        """The effect at each place, by itself."""
        return [jax.tree.map(lambda leaf, r=row: leaf[r], self.effect) for row in self.rows]

    def at(self, column: int = 0) -> np.ndarray:
        """(places,) joint indices or body slots."""
        return np.array([place[column] for place in self.places], dtype=int)

    def summed(self, count: int, values: Array) -> Array:
        """Add one value per place into an array over joints or bodies."""
        return added(values, self.at(), count)
