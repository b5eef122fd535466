"""What a value owes to a guess: a shutter's readout to how high its picture is, where nobody says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from backend.effects.catalogue import catalogue
from backend.fit.free import FreeParameter
from backend.mechanism.mechanism import Mechanism


def guesses(
    mechanism: Mechanism, parameters: Sequence[FreeParameter], values: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """Standard deviation that each value owes to a parameter which the drawing leaves to a guess, in the value's unit;
    0 where it owes nothing.
    """
    of = [_guess(mechanism, p, parameters) for p in parameters]
    return np.array([abs(x) * guess[1] if guess else 0.0 for guess, x in zip(of, values, strict=True)])


def told(mechanism: Mechanism, parameters: Sequence[FreeParameter]) -> Iterator[str]:
    """What was guessed, and what to do about it."""
    for p in parameters:
        if guess := _guess(mechanism, p, parameters):
            yield (
                f"{p.name} rests on {guess[0]}, which nobody stated: its interval allows for a guess that is "
                f"{100 * guess[1]:.0f}% off. State it in the drawing."
            )


def _guess(mechanism: Mechanism, parameter: FreeParameter, beside: Sequence[FreeParameter]) -> tuple[str, float] | None:
    """`rests_on` of its declaration, unless the drawing gives that or it is free itself."""
    kind = catalogue().get(parameter.kind)  # a camera's numbers have none
    declared = kind.declarations().get(parameter.parameter) if kind else None
    if declared is None or declared.rests_on is None:
        return None
    given = {e.id for e in mechanism.effects if declared.rests_on[0] in e.parameters}
    given |= {effect for p in beside for effect, name in p.addresses if name == declared.rests_on[0]}
    return None if all(effect in given for effect, _ in parameter.addresses) else declared.rests_on
