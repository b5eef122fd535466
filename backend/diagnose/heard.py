"""What of a library of causes the data can hear: numbers, and shared causes, that move something by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.library import Library

SILENT = 1e-6  # of what the loudest number of a cause moves


def heard(known: Library, loudness: Float[np.ndarray, " parameters"]) -> Library:
    """Without the numbers of a cause that move nothing to first order where another of its numbers does: how far a rail
    leans sideways would be fitted to what the cause leaves. Nor with shared causes of which one place alone moves
    anything, as of inertias where all other bodies are told how to move: they are that place's own.

    loudness: size of each parameter's slope where nothing is amiss [sigmas of the data].
    """

    def audible(c: Candidate) -> Candidate:
        loud = np.array([np.linalg.norm(loudness[list(take)]) for take in c.takes]) * c.prior_sd
        loudest = loud[c.sizes].max(initial=0.0)
        return c.only(~c.sizes | (loud > SILENT * loudest)) if loudest > SILENT else c

    def of_one_place(c: Candidate) -> bool:
        if not c.label:
            return False
        ways = [loudness[list(take)] * sd for take, sd, size in zip(c.takes, c.prior_sd, c.sizes, strict=True) if size]
        loud = np.linalg.norm(ways, axis=0) if ways else np.zeros(0)
        return bool(np.sum(loud > SILENT * loud.max(initial=0.0)) == 1)

    return replace(known, candidates=tuple(audible(c) for c in known.candidates if not of_one_place(c)))


def alike(known: Library, other: Library) -> Library:
    """With the numbers that the same candidates of another library have."""
    names = {c.name: {p.name for p in c.parameters} for c in other.candidates}
    kept = [c.only([p.name in names.get(c.name, {p.name}) for p in c.parameters]) for c in known.candidates]
    return replace(known, candidates=tuple(kept))
