"""By what a climb to the best set of causes decides: what is enough, what is likelier, what earns its place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backend.diagnose.adequacy import Adequacy, scaled
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import log_evidence, mean_square
from backend.diagnose.library import strikes
from backend.diagnose.shrink import gap_unit
from backend.diagnose.softness import softness
from backend.diagnose.which import Search

ALPHA = 0.01
SURE = 2  # effects at once that a diagnosis may be sure of; with more, almost anything can be imitated
LOUD = 0.25  # noise variances a sample: what must be left for a third effect to be sought
BARE = 50.0  # sum of squares, in noise variances, that a form a little wrong leaves behind
STRICT = 1e-3  # p of what is left on held-out experiments, below which it is no chance
WIDE = 1e4  # noise variances a sample: a gap that large counts no more
SMALL = 0.05  # of the gap's size: what a right law of slightly wrong form leaves behind
BLOWS = 0.15  # the same where parts strike: nobody knows the law of a blow better
TRIFLE = 1e-3  # of the gap's size: what bears no name, because no law of friction or drag is as close to a real one
IN_REACH = 0.3  # of what is left: less than the whole library could take is not worth a search for sets
WORTH = 5.0  # log evidence that another effect must bring at least; more where there were more to choose from
SAME_POWER = 0.9  # one more effect must leave at most this share of what was left
TELLING = 0.7  # the same of a set that no diagnosis may be sure of: one that leaves more tells little
NOTHING = 1e-12  # power, in noise variances a sample


@dataclass
class AbstractStandards:
    """What a cause is held against: the drawing as it is (`baseline`, judged by `at_base`) and held-out experiments.

    scale: of all sigmas, learnt on the way. tolerance_m: what may remain [m, or rad where only encoders measured].
    """

    search: Search
    baseline: Cause
    at_base: Adequacy
    scale: float
    tolerance_m: float | None

    def _likelier(self, cause: Cause, best: Cause) -> bool:
        """Whether a cause follows more of the records than the best one, or as much and all of them better."""
        if cause.fitted.fraction != best.fitted.fraction:
            return cause.fitted.fraction > best.fitted.fraction
        return self._weight(cause) > self._weight(best)

    def _weight(self, cause: Cause) -> float:
        """Log odds by all experiments, those that were not fitted too."""
        foretold = self.search.foretold(cause, self.scale) if cause.fitted.fraction == 1.0 else 0.0
        return self._by_fit(cause) + foretold

    def _by_fit(self, cause: Cause) -> float:
        return log_evidence(scaled(cause.fitted, self.scale)) + cause.log_odds

    def refused(self, cause: Cause) -> bool:
        """Whether held-out experiments show that the form is wrong."""
        if cause.fitted.fraction < 1.0:
            return False
        left, drawn = self.search.left(cause, self.scale), self.search.left(self.baseline, self.scale)
        if left is None or drawn is None or left.p > STRICT:
            return False
        return left.excess >= form(cause) ** 2 * np.clip(drawn.excess, 0.0, WIDE)

    def slight(self, cause: Cause, judged: Adequacy) -> bool:
        """Whether what a cause leaves is what its form may leave of such a gap: where the drawing loses the motion, as
        it does that goes on where the real one is stopped, a blow alone, and no more than what is smooth may.
        """
        if self.search.followed == 1.0:
            return judged.power < form(cause) ** 2 * min(self.at_base.power, WIDE)
        blow = form(cause) > SMALL and cause.fitted.fraction == 1.0
        return blow and judged.power < SMALL**2 * min(self._lost, WIDE)

    @cached_property
    def _lost(self) -> float:
        """Power that the drawing leaves of whole records though it does not follow them; 0 where it ends before they do
        [noise variances a sample].
        """
        whole = mean_square(self.baseline.fitted, 1.0)
        return whole - 1.0 if np.isfinite(whole) else 0.0

    def names_a_remainder(self, best: Cause, enough: bool) -> bool:
        """Whether one of its members alone leaves no more than its form may: the other then names a remainder, as it
        does where the pair imitates something that the library lacks. Not where both together are enough and act on
        different parts: a law of slightly wrong form is seldom put right to within noise from elsewhere.
        """
        if enough and not any(best.shares_a_part):
            return False
        alone = [self.search.tried.get((c.name,)) for c in best.candidates]
        if len(alone) < 2 or self.search.followed < 1.0:
            return False
        gap = self.baseline.fitted.chi2 - best.fitted.chi2
        whole = [c.fitted for c in alone if c is not None and c.fitted.fraction == 1.0]
        left = [made.chi2 - best.fitted.chi2 for made in whole if not made.pressed]
        return min(left, default=np.inf) < SMALL**2 * gap

    def _settled(self, cause: Cause, judged: Adequacy) -> bool:
        as_blows = form(cause) > SMALL and self.slight(cause, judged)
        return (self.enough(judged) or as_blows) and not self.refused(cause) and cause.fitted.fraction == 1.0

    def _better(self, top: Cause, best: Cause, judged: Adequacy, found: Adequacy) -> bool:
        """Whether one more effect earned its place."""
        if top.fitted.fraction != best.fitted.fraction:
            return top.fitted.fraction > best.fitted.fraction
        weight = np.sqrt(softness(scaled(top.fitted, self.scale))) if not self.enough(judged) else 1.0
        width = self.scale / weight
        gain = log_evidence(scaled(top.fitted, width)) - log_evidence(scaled(best.fitted, width))
        asked = max(WORTH, np.log(len(self.search.subject.library.candidates)) + 2.0)
        most = TELLING if len(top.candidates) > SURE and not self.enough(judged) else SAME_POWER
        return gain > asked and (best.fitted.pressed or judged.power < most * max(found.power, NOTHING))

    def _accepted(self, cause: Cause, best: Cause, judged: Adequacy, last: Adequacy) -> bool:
        """Whether a cause takes the best one's place: a larger one has to earn it."""
        if len(cause.candidates) > len(best.candidates):
            return self._better(cause, best, judged, last)
        return self._likelier(cause, best)

    def _little(self, top: Cause, judged: Adequacy, depth: int) -> bool:
        """Too little is left to bear one more effect: it would be a wrong form's remainder that gets a name."""
        left = max(judged.excess, 0.0)
        if top.fitted.fraction < 1.0:
            return False
        if depth < SURE:
            base, bare = self.at_base.power, left * top.fitted.r.size < BARE
            return judged.power < (SMALL if bare else TRIFLE) ** 2 * base
        return left < LOUD

    def _out_of_reach(self, top: Cause, judged: Adequacy) -> bool:
        """Whether all candidates together, to first order, would leave most of what is left."""
        if top.fitted.fraction < 1.0:
            return False
        return self.search.screen(top).ceiling() < IN_REACH * judged.power * top.fitted.r.size

    def enough(self, judged: Adequacy) -> bool:
        """Nothing smooth is left, to the strictness of the noise or of the user's tolerance."""
        return judged.p > ALPHA or self._within_tolerance(judged)

    def _within_tolerance(self, judged: Adequacy) -> bool:
        """What is left is smaller than the user minds."""
        if self.tolerance_m is None:
            return False
        subject = self.search.subject
        unit = gap_unit(subject.fit)
        told = [np.array([c.unit == unit for c in p.data.channels])[p.data.channel] for p in subject.fit]
        sigma = float(np.median(np.concatenate([s[t] for s, t in zip(subject.noise.sigma, told, strict=True)])))
        return np.sqrt(max(judged.upper, 0.0)) * sigma * self.scale < self.tolerance_m


def form(cause: Cause) -> float:
    """Share of a gap's size that the right cause may leave, because no law is exact."""
    return BLOWS if strikes(cause.candidates) else SMALL
