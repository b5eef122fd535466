"""What experiments set otherwise than drawn, as a spring of another stiffness, of numbers that the library may free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from backend.fit.prediction import Addresses, Overrides
from backend.model.model import Address


def laid_out(given: Mapping[str, Mapping[Address, Any]], addresses: Addresses) -> dict[str, Overrides]:
    """What each experiment sets of free numbers; nothing where none does. given: by experiment, whole parameters."""
    somewhere = {address for values in given.values() for address in values}
    known = [(i, a) for i, group in enumerate(addresses) for a in group if whole(a) in somewhere]
    if not known:
        return {}
    source, at = zip(*known, strict=True)
    return {
        experiment: Overrides(
            jnp.array([_number(values, a) for a in at]), jnp.array([whole(a) in values for a in at]), at, source
        )
        for experiment, values in given.items()
    }


def whole(address: Address) -> Address:
    """All of the parameter of which this is a component."""
    return address[0], address[1].partition("[")[0]


def _number(values: Mapping[Address, Any], address: Address) -> float:
    value, component = np.ravel(values.get(whole(address), 0.0)), address[1].partition("[")[2].rstrip("]")
    return float(value[int(component)] if component and value.size > 1 else value[0])
