"""A mechanism ready to move: its layout, its drawing as arrays, and its effects."""

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import AbstractEffect, Declaration
from backend.effects.shapes import AbstractSection
from backend.model.drawing import Drawing
from backend.model.flexible import whole
from backend.model.placed import Placed
from backend.model.scale import Scale
from backend.model.topology import Topology

Shape = TypeVar("Shape", bound=AbstractEffect)
Address = tuple[str, str]
"""(effect id, parameter name)."""


@dataclasses.dataclass(frozen=True)
class ParameterRow:
    """One parameter of one effect in a model, with what its file declares about it."""

    effect: str
    kind: str
    on: tuple[str, ...]
    parameter: str
    declaration: Declaration
    value: float | tuple[float, ...]
    natural: float
    """A size that a parameter of this unit has in this mechanism: from its own mass, length and gravity."""


class Model(eqx.Module):
    """Numbers are array leaves (differentiable); topology, names and counts are static."""

    topology: Topology = eqx.field(static=True)
    drawing: Drawing
    effects: tuple[Placed, ...]
    drawn_poses: Float[Array, "bodies 7"]
    """Origin position [m] and quaternion wxyz of every body as drawn, fixed bodies last."""
    marker_points: Float[Array, "markers 3"]
    marker_ids: tuple[str, ...] = eqx.field(static=True)
    marker_bodies: tuple[int, ...] = eqx.field(static=True)
    view_axis: Float[Array, "3"]
    """Unit vector about which joints turn, upwards where none does: where a camera looks along, and across the bed."""
    scale: Scale

    def of(self, shape: type[Shape]) -> list[Placed]:
        """The effects of one shape."""
        return [placed for placed in self.effects if isinstance(placed.effect, shape)]

    @property
    def parameters(self) -> dict[Address, ParameterRow]:
        """Every effect parameter of the model, by address."""
        table = {}
        for placed in self.effects:
            for row, effect_id in enumerate(placed.ids):
                on = self._names(placed, row)
                for name, declared in placed.effect.declarations().items():
                    value = getattr(placed.effect, name)[row]
                    table[(effect_id, name)] = ParameterRow(
                        effect_id,
                        placed.effect.kind,
                        on,
                        name,
                        declared,
                        float(value) if declared.size == 1 else tuple(map(float, value)),
                        declared.typical * self.scale.of(declared.unit),
                    )
        return table

    def with_parameters(self, values: Mapping[Address, Array | float]) -> "Model":
        """A copy with other parameter values; differentiable in them.

        Raises KeyError naming the known effects where an address is not in the model.
        """
        model = self
        for (effect_id, name), value in values.items():
            index, row = model._find(effect_id, name)
            leaf = getattr(model.effects[index].effect, name).at[row].set(value)
            model = eqx.tree_at(lambda m, i=index, n=name: getattr(m.effects[i].effect, n), model, leaf)
        return model

    def _find(self, effect_id: str, name: str) -> tuple[int, int]:
        for index, placed in enumerate(self.effects):
            if effect_id in placed.ids and name in placed.effect.declarations():
                return index, placed.ids.index(effect_id)
        known = ", ".join(f"{e}.{p}" for e, p in self.parameters)
        raise KeyError(f"no parameter '{effect_id}.{name}' in this model; it has: {known or 'none'}")

    def _names(self, placed: Placed, row: int) -> tuple[str, ...]:
        t = self.topology
        bodies = t.body_ids + t.fixed_ids
        names = t.joint_ids if placed.effect.acts_on == "joint" else bodies
        if isinstance(placed.effect, AbstractSection):
            names = tuple(map(whole, t.joint_ids))
        if placed.effect.acts_on in ("world", "camera"):
            return (placed.effect.acts_on,)
        return tuple(
            str(names[i]) for r, place in zip(placed.rows, placed.places, strict=True) if r == row for i in place
        )


def world_axis(axes: Float[Array, "joints 3"]) -> Float[Array, "3"]:
    """The direction that axes share, sign of the first."""
    signs = jnp.sign(axes @ axes[0])
    mean = jnp.sum(jnp.where(signs == 0, 1.0, signs)[:, None] * axes, 0)
    return mean / jnp.linalg.norm(mean)
