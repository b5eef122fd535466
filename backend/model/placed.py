"""The effects of one kind in a model, and where each of them acts."""

from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax import lax
from jaxtyping import Array

from backend.effects.effect import AbstractEffect
from backend.model.incidence import added, picked

State = TypeVar("State")


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

    def in_turn(self, state: State, onward: Callable[[State, Any, Any], State]) -> State:
        """What `onward(state, effect, place)` makes of a state, one effect at its first place after the other.

        Several are a loop, which is compiled once: its places are then no numbers that a program knows.
        """
        if len(self.places) == 1:
            return onward(state, self.each()[0], self.places[0][0])
        return lax.scan(lambda now, one: (onward(now, *one), None), state, (self.here, self.at()))[0]

    def summed(self, count: int, values: Array) -> Array:
        """Add one value per place into an array over joints or bodies."""
        return added(values, self.at(), count)
