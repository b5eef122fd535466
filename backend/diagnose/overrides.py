"""What experiments set otherwise than drawn, as a spring of another stiffness, of numbers that the library may free."""

from __future__ import annotations

from collections.abc import Collection

import jax.numpy as jnp

from backend.fit.prediction import Addresses, Overrides
from backend.model.model import COMPONENT, Address, Model


def set_somewhere(given: Collection[Address], addresses: Addresses) -> list[tuple[int, Address]]:
    """Free numbers that some experiment sets, each with its place among what is free. given: whole parameters."""
    return [(i, a) for i, group in enumerate(addresses) for a in group if whole(a) in given]


def laid_out(model: Model, given: Collection[Address], known: list[tuple[int, Address]]) -> Overrides | None:
    """Those numbers in one experiment; None where no experiment sets any. model: as that experiment sets it."""
    if not known:
        return None
    source, at = zip(*known, strict=True)
    table = model.parameters
    value, here = jnp.array([table[a].value for a in at]), jnp.array([whole(a) in given for a in at])
    return Overrides(value, here, at, source)


def whole(address: Address) -> Address:
    """All of the parameter of which this is a component."""
    component = COMPONENT.fullmatch(address[1])
    return address[0], component["name"] if component else address[1]
