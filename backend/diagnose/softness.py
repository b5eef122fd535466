"""How much of the likelihood counts where even the best form is wrong."""

from __future__ import annotations

from backend.diagnose.fitted import Fitted
from backend.diagnose.independent import independent_of


def softness(best: Fitted) -> float:
    """Weight of the likelihood where even the best form is wrong: independent misses per sample over their power.

    Miller and Dunson (2019) coarsen a likelihood so; a law that misses by ten sigmas over a hundred swings must not
    count each sample as evidence against its rivals.
    """
    power = best.chi2 / max(best.r.size - best.x.size, 1)
    free = independent_of(best.r, best.rows) / best.r.size
    return min(1.0, free / max(power, 1.0))
