"""How many causes: one more effect at a time while the data bear it, then sets gone back on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backend.diagnose.adequacy import Adequacy, adequacy, scaled
from backend.diagnose.belief import weigh
from backend.diagnose.beyond_smooth import AbstractBeyondSmooth
from backend.diagnose.cause import Cause, is_new
from backend.diagnose.closer import closer, in_shape
from backend.diagnose.recombined import recombined
from backend.diagnose.same_motion import complete, elsewhere
from backend.diagnose.softness import softness
from backend.diagnose.standards import STRICT, SURE, TELLING, WORTH
from backend.diagnose.where import beyond_doubt, place_evidence
from backend.diagnose.which import LEADERS, PARTNERS

DEEPEST = 4  # effects in one explanation
NEAR = 12.0  # log odds: sets that may still be the likelier ones by experiments that were not fitted
NAMED = 1.0  # log odds: of sets that explain as much, by which one is named before another
HINT = 0.1  # p of what a single cause leaves: of less it is asked whether one more effect would take that
MOST_GONE = 0.1  # of the gap's power: of a cause that leaves no more, others that do the same are sought too
PLAIN = 8  # sets of a size, the likeliest, that may do for a larger one


@dataclass
class Climb(AbstractBeyondSmooth):
    """From the drawing as it is to the best set of causes. large: whether more effects at once earned their place than
    a diagnosis may be sure of.
    """

    def __post_init__(self):
        super().__post_init__()
        self.large = False

    def smooth(self, singles: list[Cause]) -> tuple[Cause, Adequacy]:
        """Add effects as long as what is left is large enough to be worth one, and one takes a good part of it. Where a
        pair follows whole records, what switches on is asked before a third.
        """
        best, level = self.baseline, singles
        found: Adequacy | None = None
        for depth in range(1, DEEPEST + 1):
            leaders = self._leaders(level)
            if not leaders:
                break
            top, judged = self._judged(leaders[0])
            leaders = [top, *leaders[1:]]
            if depth == SURE and not self.enough(judged):
                leaders = self._leaders(in_shape(self.search, leaders))
                if leaders[0] is not top:
                    top, judged = self._judged(leaders[0])
            self._tell(f"{' + '.join(top.names)} leaves {judged.excess:.3g} of the noise's power, p {judged.p:.2g}")
            if found is not None and not self._better(top, best, judged, found):
                break
            best, found = top, judged
            if depth == SURE and not self.enough(judged):
                best, found = top, judged = self._completed(top, judged)
            if self._may_mislead(top) and not self.enough(judged):
                best, found = top, judged = self._exchanged(top, judged)
            if depth == 1 and not self.enough(judged) and (struck := self._struck(top, judged)) is not None:
                return struck
            if top.fitted.fraction == 1.0:
                self.scale = max(1.0, min(judged.noise, 1.5))
            if depth == DEEPEST or (depth == SURE and top.fitted.fraction == 1.0) or self._cancelled():
                break
            # One that is enough only at the end of its range is not.
            if (depth >= SURE or not top.fitted.pressed) and self._borne(top, judged, depth):
                break
            parents = leaders[:LEADERS] if depth < SURE else [top]
            level = self.search.level(parents, PARTNERS, rival=top, place=self._place(top))
        if found is None:
            found = adequacy(best.fitted, self.search.latent, self.rng)
        if len(best.candidates) > SURE:
            best, found = self._likelier_than(best, found, worth=NAMED)
        if len(best.candidates) > 1 and not self._cancelled():
            best, found = self._thinned(best, found) if self.enough(found) else self._shaped(best, found)
        if not self._cancelled():
            best, found = self._narrowed(best, found)
        if len(best.candidates) <= SURE and best.fitted.fraction == 1.0 and elsewhere(self.search, best):
            best, found = self._likelier_than(best, found)
        return self._recombined(best, found)

    def larger(self, best: Cause, last: Adequacy, pair: Cause, left: Adequacy) -> tuple[Cause, Adequacy]:
        """Three smooth effects and more, from a pair on, where neither it nor what switches on is enough; the best set
        where they do not take its place. left: what the pair leaves.
        """
        smooth = len(pair.candidates) == SURE and pair.fitted.subject is self.search.subject
        if not smooth or pair.fitted.fraction < 1.0 or self.enough(last) or self._settled(best, last):
            return best, last
        self.search.look_again(pair)
        top, judged = pair, left
        for depth in range(SURE, DEEPEST):
            if self._cancelled() or self._borne(top, judged, depth):
                break
            leaders = self._leaders(self.search.level([top], PARTNERS, rival=top, place=self._place(top)))
            if not leaders:
                break
            cause, found = self._judged(leaders[0])
            self._tell(f"{' + '.join(cause.names)} leaves {found.excess:.3g} of the noise's power, p {found.p:.2g}")
            if not self._better(cause, top, found, judged):
                break
            top, judged = cause, found
        if top is pair:
            return best, last
        top, judged = self._likelier_than(top, judged, worth=NAMED)
        for step in (self._thinned if self.enough(judged) else self._shaped, self._narrowed):
            if top.fitted.subject is self.search.subject and not self._cancelled():
                top, judged = step(top, judged)
        if best is not pair and not self._accepted(top, best, judged, last):
            return best, last
        self.scale = max(1.0, min(judged.noise, 1.5))
        return top, judged

    def _borne(self, top: Cause, judged: Adequacy, depth: int) -> bool:
        """Whether a set leaves too little to bear one more effect, or what none could take."""
        plain = self.enough(judged) and not (depth < SURE and self._hinted(top, judged))
        if plain or self._little(top, judged, depth):
            return True
        if not self._out_of_reach(top, judged):
            return False
        self._tell("nothing smooth in the library could take what is left")
        return True

    def _hinted(self, top: Cause, judged: Adequacy) -> bool:
        """Whether what a cause leaves, though noise may leave as much, is what one of the library does beyond chance: a
        test of all that could be there overlooks what is small beside the first.
        """
        if top.fitted.fraction < 1.0 or self._within_tolerance(judged):
            return False
        left = self.search.left(top, self.scale)
        if min(judged.p, 1.0 if left is None else left.p) > HINT:
            return False
        free = [c for c in self.search.subject.library.candidates if is_new(c, top) and not c.sought]
        return self.search.screen(top).rescaled(self.scale).p_value(free, self.rng) < STRICT

    def _place(self, top: Cause) -> str | None:
        """Where what a cause leaves lies beyond doubt."""
        return beyond_doubt(place_evidence(top.fitted, self.search.latent, self.scale))

    def _thinned(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """A set that is enough with a member given up, where that is more probable: the first of a pair may have been
        needed only to lead to the other, or make up for a shape of it that was not free.
        """
        least, gap = best.fitted.chi2, self.baseline.fitted.chi2 - best.fitted.chi2
        for member in best.candidates:
            rest = self.search.without(best, member)
            if rest.fitted.fraction == best.fitted.fraction and rest.fitted.chi2 - least < MOST_GONE * gap:
                closer(self.search, rest)
        return self._likelier_than(best, found)

    def _shaped(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """A set that is not enough with what of a member's shape is freed late, where that makes it likelier."""
        better = closer(self.search, best) if best.fitted.fraction == 1.0 else best
        return (best, found) if better is best else self._judged(better)

    def _narrowed(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """A set with a simpler form in the place of one that contains it, where that is more probable: beside another
        effect where it stands alone, for the wider form may do what that does.
        """
        narrow = self.search.simpler(best)
        if len(best.candidates) < SURE:
            for simple in narrow:
                self.search.level([simple], PARTNERS)
        return self._likelier_than(best, found, SURE) if narrow else (best, found)

    def _likelier_than(self, best: Cause, found: Adequacy, size: int = 0, worth: float = 0.0) -> tuple[Cause, Adequacy]:
        """The most probable set of so many members, or of as many as the best one has, where others are worth it,
        unless the best one alone is enough.
        """
        top = self._most_probable(best, worth, size)
        if top is best:
            return best, found
        self._tell(f"{' + '.join(top.names)} is the likelier")
        judged = self._judged(top, self.searches[id(top.fitted.subject)])
        return judged if self.enough(judged[1]) or not self.enough(found) else self._judged(best)

    def _recombined(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """A pair, or one of members of the likeliest pairs where it is not enough or held-out experiments refuse it."""
        if len(best.candidates) != SURE or (self.enough(last) and not self.refused(best)) or self._cancelled():
            return best, last
        likelier = [cause for cause in recombined(self.search, best) if self._likelier(cause, best)]
        return self._judged(max(likelier, key=self._weight)) if likelier else (best, last)

    def _may_mislead(self, best: Cause) -> bool:
        """Whether the way to a set is worth going back: to a pair, or to three where the drawing loses the motion."""
        return SURE <= len(best.candidates) <= (SURE if self.search.followed == 1.0 else SURE + 1)

    def _exchanged(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set with members given up or exchanged, as long as that makes it more probable by what that is
        worth; a set that no diagnosis may be sure of once.
        """
        size = len(best.candidates)
        for _ in range(size if size <= SURE else 1):
            if self._cancelled():
                break
            self.search.exchange(best)
            top = self._most_probable(best, WORTH)
            # A likelier set of another model has no members that could be exchanged in this one.
            if top is best or top.fitted.subject is not self.search.subject:
                break
            best, found = self._judged(top)
            self._tell(f"{' + '.join(best.names)} instead leaves {found.excess:.3g} of the noise's power")
            if self.enough(found):
                break
        return best, found

    def _most_probable(self, best: Cause, worth: float, size: int = 0) -> Cause:
        """Of all sets tried that are no larger than it or than `size`, by as much of the likelihood as the closest fit
        bears; others must be worth it, seen through in the study's own steps.
        """
        top = self._likeliest(best, worth, size)
        for _ in range(LEADERS):
            if not top.fitted.in_longer_steps:
                break
            self.search.tried[top.names] = self.searches[id(top.fitted.subject)].seen_through(top)
            top = self._likeliest(best, worth, size)
        return top

    def _likeliest(self, best: Cause, worth: float, size: int) -> Cause:
        """The same in whichever steps a set was fitted."""
        most = max(len(best.candidates), size)
        sets = [
            c for c in self.search.tried.values()
            if 0 < len(c.candidates) <= most and c.fitted.fraction == best.fitted.fraction
        ]  # fmt: skip
        closest = min(sets, key=lambda c: c.fitted.chi2)
        soft = softness(scaled(closest.fitted, self.scale))
        found = weigh(None, sets, len(self.search.subject.library.candidates), scale=self.scale, softness=soft)
        place = next(i for i, c in enumerate(found.causes) if c is best)
        return found.causes[0] if found.log_z[0] > found.log_z[place] + worth else best

    def _leaders(self, level: Sequence[Cause]) -> list[Cause]:
        """Most probable first, among those that follow the longest part of the records."""
        longest = max((c.fitted.fraction for c in level), default=1.0)
        at = [c for c in level if c.fitted.fraction == longest]
        return sorted(at, key=lambda c: -self._by_fit(c))

    def confirmed(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """Of sets as large that the fitted experiments hardly tell apart, the one that held-out ones prefer; where no
        form is right, the most probable one.
        """
        if not self.enough(last):
            return self._completed(best, last)
        if len(best.candidates) == SURE and best.fitted.subject is self.search.subject and best.fitted.fraction == 1.0:
            self.search.wider(best)  # of what stands beside one that came late, as a base that shakes
        for alias in complete(self.searches[id(best.fitted.subject)], best, self.scale) if best.candidates else ():
            self.search.tried[alias.names] = alias
        near = [
            c for c in self.search.tried.values()
            if len(c.candidates) == len(best.candidates) > 0 and c.fitted.fraction == best.fitted.fraction == 1.0
            and self._by_fit(c) > self._by_fit(best) - NEAR
        ]  # fmt: skip
        top = max(near, key=self._weight, default=best)
        if top is best or not self._weight(top) > self._weight(best) + NAMED:
            return best, last
        self._tell(f"held-out experiments prefer {' + '.join(top.names)}")
        return self._judged(top, self.searches[id(top.fitted.subject)])

    def _completed(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """A set that is not enough, or the most probable one: where it leaves little, sets that promise as much about
        its motion are fitted, for its members may each do a part of what others do.
        """
        if not best.candidates or self.search.tried.get(best.names) is not best:
            return best, last
        if best.fitted.fraction == 1.0 and last.power < MOST_GONE * self.at_base.power:
            wide = self.scale / np.sqrt(softness(scaled(best.fitted, self.scale)))
            for alias in complete(self.searches[id(best.fitted.subject)], best, float(wide)):
                self.search.tried[alias.names] = alias
        return self._likelier_than(best, last)

    def plain(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """Of sets so large that they imitate almost anything, the smallest that leaves not much more, of what was
        fitted and of held-out experiments: a member that takes little off either is not named. Larger ones are
        withdrawn.
        """
        size = len(best.candidates)
        if size <= SURE or best.fitted.fraction < 1.0 or self.enough(last) or self._cancelled():
            return best, last
        self.large, found = True, best
        for few in range(1, size):
            sets = [c for c in self.search.tried.values() if len(c.candidates) == few and c.fitted.fraction == 1.0]
            near = sorted(sets, key=lambda c: -self._by_fit(c))[:PLAIN]
            plain = next((c for c in near if self._tells_little_more(best, last, c)), None)
            if plain is not None:
                found, size = plain, few
                break
        self.search.tried = {k: c for k, c in self.search.tried.items() if len(c.candidates) <= size}
        if found is best:
            return best, last
        self._tell(f"{' + '.join(found.names)} leaves little more")
        return self._judged(found, self.searches[id(found.fitted.subject)])

    def _tells_little_more(self, best: Cause, last: Adequacy, plain: Cause) -> bool:
        """Whether a set takes little more than a smaller one off the fitted experiments and off the held-out ones."""
        lost = (plain.fitted.chi2 - best.fitted.chi2) / best.fitted.r.size
        if lost > (1.0 / TELLING - 1.0) * last.power:
            return False
        large, small = self.search.left(best, self.scale), self.search.left(plain, self.scale)
        return large is None or small is None or TELLING * max(small.excess, 0.0) <= max(large.excess, 0.0)
