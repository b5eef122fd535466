"""Values that are expected to be alike: one value shared by many places, and a value of its own where one deviates."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from backend.fit.free import FreeParameter, free_parameters
from backend.mechanism.mechanism import Mechanism

FEWEST = 3  # of two places no one can say which one deviates


@dataclass(frozen=True)
class Alike:
    """Parameters (by index) of one kind and name, each at a place of its own. everywhere: no place is left out."""

    members: tuple[int, ...]
    everywhere: bool


def alike(mechanism: Mechanism, parameters: Sequence[FreeParameter]) -> list[Alike]:
    """Groups of three or more values that differ in their place alone; those with a tolerance keep to themselves."""
    found: dict[tuple[str, str], list[int]] = {}
    for i, f in enumerate(parameters):
        if len(f.on) == 1 and f.prior_sd is None and f.label == f.on[0]:
            found.setdefault((f.kind, f.parameter), []).append(i)
    return [
        Alike(tuple(members), _all(mechanism, *key) == {parameters[i].addresses[0] for i in members})
        for key, members in found.items()
        if len(members) >= FEWEST
    ]


def _all(mechanism: Mechanism, kind: str, parameter: str) -> set[tuple[str, str]]:
    freedom = free_parameters(mechanism, [f"{kind}:all.{parameter}"])
    return {address for f in freedom.parameters for address in f.addresses}


def tied(
    parameters: Sequence[FreeParameter], groups: Sequence[Alike], apart: Collection[int]
) -> tuple[list[FreeParameter], Float[np.ndarray, "all few"]]:
    """Parameters with one value for each group and one for every member apart, and the matrix from few to all.

    Names stay readable as `--free`, so that whoever reads fit.json finds the places again.
    """
    shared = {i: group for group in groups for i in group.members if i not in apart}
    few: list[FreeParameter] = []
    column: dict[int, int] = {}
    for i, f in enumerate(parameters):
        group = shared.get(i)
        if group is None:
            column[i] = len(few)
            few.append(f)
        elif i not in column:
            together = [k for k in group.members if k not in apart]
            column.update(dict.fromkeys(together, len(few)))
            few.append(_joined(parameters, group, together, apart))
    matrix = np.zeros((len(parameters), len(few)))
    matrix[np.arange(len(parameters)), [column[i] for i in range(len(parameters))]] = 1.0
    return few, matrix


def _joined(
    parameters: Sequence[FreeParameter], group: Alike, together: Sequence[int], apart: Collection[int]
) -> FreeParameter:
    members = [parameters[i] for i in together]
    on = tuple(f.on[0] for f in members)
    out = [parameters[i].on[0] for i in group.members if i in apart]
    everywhere = "-".join(["all", "+".join(out)] if out else ["all"])
    return replace(
        members[0],
        on=on,
        label=everywhere if group.everywhere else "+".join(on),
        start=float(np.mean([f.start for f in members])),
        addresses=tuple(a for f in members for a in f.addresses),
    )
