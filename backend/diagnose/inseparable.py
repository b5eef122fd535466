"""Effects that these data could not tell apart, whichever of them were there: one motion to first order.

A pendulum's angle says as much of a longer arm as of a clock that runs slow. Such groups hold whatever the verdict is,
also for effects that are not amiss here.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.screen import Screen
from backend.diagnose.which import APART
from backend.fit.free import FreeParameter

Number = tuple[Candidate, FreeParameter]


def inseparable(about: Screen, scale: float) -> list[list[Number]]:
    """Groups of numbers of effects at single places, each group loudest first.

    Two are alike where the responses to them, at the largest size that is expected of both, differ by less than noise
    does: what one leaves beside the other is then less than APART in squares. scale: of all sigmas.
    """
    numbers, responses = _visible(about.rescaled(scale))
    groups: list[list[Number]] = []
    left = sorted(range(len(numbers)), key=lambda i: -float(np.linalg.norm(responses[i])))
    while left:
        head, *others = left
        with_it = [i for i in others if _apart(responses[head], responses[i]) < APART]
        left = [i for i in others if i not in with_it]
        group = [numbers[i] for i in (head, *with_it)]
        if len({c.name for c, _ in group}) > 1:
            groups.append(group)
    return groups


def _visible(about: Screen) -> tuple[list[Number], list[Float[np.ndarray, " n"]]]:
    numbers, responses = [], []
    for c in about.subject.library.candidates:
        S, least = about.signature(c) * c.prior_sd, about.detectable(c)
        for k, p in enumerate(c.parameters):
            if len(c.on) == 1 and c.sizes[k] and least[k] < c.prior_sd[k]:
                numbers.append((c, p))
                responses.append(S[:, k])
    return numbers, responses


def _apart(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    """Squares left of the fainter one beside the louder one."""
    faint, loud = sorted((a, b), key=np.linalg.norm)
    rest = faint - loud * (loud @ faint) / (loud @ loud)
    return float(rest @ rest)
