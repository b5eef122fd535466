"""Pairs put together anew from members of the likeliest ones.

Exchanging one member at a time finds no pair that is two exchanges away from every pair that leads: friction at one pin
with a bar's mass led, friction at all pins with another bar's mass came second, and the truth was the first's friction
with the second's mass, which was never tried.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.which import Search

PAIRS = 6  # likeliest ones whose members are put together anew
TRIED = 4  # of the pairs that this gives, those whose members come from the likeliest


def recombined(search: Search, best: Cause) -> list[Cause]:
    """Pairs of two kinds from the likeliest pairs that were not tried, begun where their members ended."""
    alike = [c for c in search.tried.values() if len(c.candidates) == 2 and c.fitted.fraction == best.fitted.fraction]
    leading = sorted((c for c in alike if c.fitted.subject is search.subject), key=lambda c: -c.log_z)[:PAIRS]
    homes: dict[str, tuple[Candidate, Cause]] = {}
    for pair in leading:
        for member in pair.candidates:
            homes.setdefault(member.name, (member, pair))
    found = []
    for (one, first), (other, second) in combinations(homes.values(), 2):
        names = tuple(sorted((one.name, other.name)))
        one_form = {names, names[::-1]} & search.forms  # both would do one thing
        if names not in search.tried and one.kind != other.kind and not one_form:
            found.append((first.log_z + second.log_z, first, (one, other), second.values))
    made = []
    for _, home, members, values in sorted(found, key=lambda f: -f[0])[:TRIED]:
        if not search.cancelled():
            own = {p.name for c in members for p in c.parameters} - set(home.values)
            made.append(search.begun_at(home, members, {name: v for name, v in values.items() if name in own}))
    return [c for c in made if c is not None and np.isfinite(c.log_z)]
