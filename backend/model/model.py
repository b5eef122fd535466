"""A mechanism ready to move: its layout, its drawing as arrays, and its effects."""

import dataclasses
import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.effects.effect import AbstractEffect, Declaration
from backend.effects.shapes import AbstractPush, AbstractSection, Camera
from backend.mechanism.effect import ParameterValue
from backend.model.drawing import Drawing
from backend.model.flexible import whole
from backend.model.incidence import picked
from backend.model.placed import Placed
from backend.model.scale import Scale
from backend.model.topology import Topology

Shape = TypeVar("Shape", bound=AbstractEffect)
Address = tuple[str, str]
"""(effect id, parameter name); one number of several is `name[0]`."""
COMPONENT = re.compile(r"(?P<name>.+)\[(?P<at>\d+)\]")


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

    @property
    def expected(self) -> float | None:
        """Standard deviation of its value before any data, in its unit; None: not a cause that a diagnosis frees."""
        return None if self.declaration.expected is None else self.declaration.expected * self.natural

    @property
    def unstated(self) -> float | None:
        """As far from its default as it may lie where nobody states it, in its unit; None: nowhere else."""
        far = self.declaration.unstated
        return None if far is None else far * (self.natural if self.declaration.unstated_is_natural else 1.0)


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
    camera: Camera
    scale: Scale

    @property
    def view_axis(self) -> Float[Array, "3"]:
        """Unit vector about which joints turn, upwards where none does: along the line of sight, across the bed."""
        return self.camera.axis

    def of(self, shape: type[Shape]) -> list[Placed]:
        """The effects of one shape."""
        return [placed for placed in self.effects if isinstance(placed.effect, shape)]

    @property
    def parameters(self) -> dict[Address, ParameterRow]:
        """Every effect parameter of the model, by address; one of several numbers as a whole and by component."""
        table: dict[Address, ParameterRow] = {}
        sizes: dict[str, float] = {}  # of units, which are far fewer than parameters
        for placed in self.effects:
            # Whole columns are fetched: a number at a time costs a computation each.
            columns = {name: np.asarray(getattr(placed.effect, name)) for name in placed.effect.declarations()}
            for row, effect_id in enumerate(placed.ids):
                on = self._names(placed, row)
                for name, declared in placed.effect.declarations().items():
                    unit = declared.natural_unit or declared.unit
                    if unit not in sizes:
                        sizes[unit] = self.scale.of(unit)
                    value = columns[name][row]
                    value = float(value) if declared.size == 1 else tuple(map(float, value))
                    for key, one in {name: value, **_components(name, value)}.items():
                        table[(effect_id, key)] = ParameterRow(
                            effect_id, placed.effect.kind, on, key, declared, one, declared.typical * sizes[unit]
                        )
        return table

    def with_parameters(self, values: Mapping[Address, Array | float]) -> "Model":
        """A copy with other parameter values; differentiable in them.

        Raises KeyError naming the known effects where an address is not in the model.
        """
        given = [jnp.ravel(jnp.broadcast_to(jnp.asarray(v), self._places(a)[2].shape)) for a, v in values.items()]
        ends = np.cumsum([0, *(v.size for v in given)])
        sources = {a: np.arange(first, end) for a, (first, end) in zip(values, pairwise(ends), strict=True)}
        return self.with_numbers(jnp.concatenate(given), sources) if given else self

    def with_numbers(self, values: Float[Array, " n"], sources: Mapping[Address, np.ndarray]) -> "Model":
        """A copy in which parameters are values[source]: the last source of a number counts.

        Of each kind's parameter all in one pass: XLA would run a loop for every one that is set by itself.
        """
        leaves: dict[tuple[int, str], np.ndarray] = {}
        for address, source in sources.items():
            index, name, places = self._places(address)
            size = getattr(self.effects[index].effect, name).size
            leaves.setdefault((index, name), np.arange(size))[places] = size + source
        if not leaves:
            return self

        def changed(index: int, name: str, source: np.ndarray) -> Array:
            leaf = getattr(self.effects[index].effect, name)
            return picked(jnp.concatenate([jnp.ravel(leaf), values.astype(leaf.dtype)]), source).reshape(leaf.shape)

        return eqx.tree_at(
            lambda m: [getattr(m.effects[i].effect, n) for i, n in leaves],
            self,
            [changed(i, n, source) for (i, n), source in leaves.items()],
        )

    def _places(self, address: Address) -> tuple[int, str, np.ndarray]:
        """Which effects and parameter of theirs hold a number, and its places among all of that parameter."""
        component = COMPONENT.fullmatch(address[1])
        name = component["name"] if component else address[1]
        index, row = self._find(address[0], name)
        shape = np.shape(getattr(self.effects[index].effect, name))
        places = np.atleast_1d(np.arange(np.prod(shape, dtype=int)).reshape(shape)[row])
        return index, name, places[[int(component["at"])]] if component else places

    def addresses(self, effect_id: str, name: str) -> list[Address]:
        """Where the model holds a number of a drawn effect: one that it holds once a place (`id@place`), because its
        places differ, at each where the parameter means something; none where there is no such effect.
        """
        if any(effect_id in placed.ids for placed in self.effects):
            return [(effect_id, name)]
        types = dict(zip(self.topology.joint_ids, self.topology.joint_types, strict=True))
        found = []
        for placed in self.effects:
            declared = placed.effect.declarations().get(name)
            for row, id in enumerate(placed.ids):
                if declared is None or not id.startswith(f"{effect_id}@"):
                    continue
                able = declared.joint_types
                if able is None or types[self._names(placed, row)[0]] in able:
                    found.append((id, name))
        return found

    def overridden(self, overrides: Mapping[str, Mapping[str, ParameterValue]]) -> dict[Address, Any]:
        """Values that an experiment sets otherwise than drawn, by address.

        Raises ValueError for a value with which the effect would have to be built otherwise than it is drawn.
        """
        found = {}
        for effect_id, given in overrides.items():
            for name, value in given.items():
                for address in self.addresses(effect_id, name):
                    self._check_built(*address, value)
                    found[address] = value
        return found

    def _check_built(self, effect_id: str, name: str, value: ParameterValue) -> None:
        """Refuse what asks for another structure: the rings of a bearing that was drawn without a length, the axis
        about which a link was cut.
        """
        index, row = self._find(effect_id, name)
        effect = self.effects[index].effect
        drawn = {n: getattr(effect, n)[row] for n, d in effect.declarations().items() if d.size == 1}
        drawn |= {n: getattr(effect, n) for n in effect.choices()}
        cut = isinstance(effect, AbstractSection) and effect.declarations()[name].size > 1
        if cut or any(getattr(effect, n) != other for n, other in effect.structure({**drawn, name: value}).items()):
            raise ValueError(
                f"override of effect '{effect_id}': {name} {value} decides how the effect is built, once for all "
                "experiments; draw it so, and remove the override"
            )

    def _find(self, effect_id: str, name: str) -> tuple[int, int]:
        for index, placed in enumerate(self.effects):
            if effect_id in placed.ids and name in placed.effect.declarations():
                return index, placed.ids.index(effect_id)
        known = ", ".join(f"{e}.{p}" for e, p in self.parameters)
        raise KeyError(f"no parameter '{effect_id}.{name}' in this model; it has: {known or 'none'}")

    def _names(self, placed: Placed, row: int) -> tuple[str, ...]:
        t = self.topology
        bodies = t.body_ids + t.fixed_ids
        acts_on = placed.effect.acts_on
        places = [place for r, place in zip(placed.rows, placed.places, strict=True) if r == row]
        if acts_on == "effect":
            return tuple(self.effects[batch].ids[other] for batch, other in places)
        if places == [()] or (acts_on == "world" and not isinstance(placed.effect, AbstractPush)):
            return (acts_on,)
        names = {"joint": t.joint_ids, "world": t.joint_ids, "marker": self.marker_ids, "camera": self.marker_ids}
        table = names.get(acts_on, bodies)
        if isinstance(placed.effect, AbstractSection):
            table = tuple(map(whole, t.joint_ids))
        return tuple(str(table[i]) for place in places for i in place)


def _components(name: str, value: float | tuple[float, ...]) -> dict[str, float]:
    return {f"{name}[{i}]": one for i, one in enumerate(value)} if isinstance(value, tuple) else {}


@jax.jit
def world_axis(axes: Float[Array, "joints 3"]) -> Float[Array, "3"]:
    """The direction that axes share, sign of the first."""
    signs = jnp.sign(axes @ axes[0])
    mean = jnp.sum(jnp.where(signs == 0, 1.0, signs)[:, None] * axes, 0)
    return mean / jnp.linalg.norm(mean)
