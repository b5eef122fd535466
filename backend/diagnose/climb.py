"""How many causes: one more effect at a time while the data bear it, then sets gone back on, then what switches on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backend.diagnose.adequacy import Adequacy, adequacy, scaled
from backend.diagnose.belief import weigh
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.closer import closer, coming_up
from backend.diagnose.ends import stopping_alike
from backend.diagnose.library import LOAD, PLAYS, SMOOTH, alike, families, library, rubs_dry
from backend.diagnose.same_motion import complete, elsewhere
from backend.diagnose.softness import softness
from backend.diagnose.standards import NOTHING, SURE, WORTH, AbstractStandards
from backend.diagnose.subject import prepare
from backend.diagnose.switch import let_go
from backend.diagnose.switched import switching
from backend.diagnose.where import place_evidence, shares
from backend.diagnose.which import LEADERS, PARTNERS, Search
from backend.mechanism.study import Study, driven_effects

DEEPEST = 4  # effects in one explanation
IN_THE_PICTURE = 0.99  # probability of camera and markers beyond which no effect that switches on is tried
UNREAD = 25.0  # noise variances a sample: so much left is far from linear, and shifts follow it as well as forces
BEYOND_DOUBT = 0.99
FAINT = 200.0  # sum of squares, in noise variances, that a cause takes off: so little is soon imitated
WORTH_A_TRY = 15.0  # sum of squares left, in noise variances
NEAR = 12.0  # log odds: sets that may still be the likelier ones by experiments that were not fitted
NAMED = 1.0  # log odds: of sets that explain as much, by which one is named before another
MOST_GONE = 0.1  # of the gap's power: of a cause that leaves no more, others that do the same are sought too
PLAIN = 8  # sets of a size, the likeliest, that may do for a larger one
TELLING = 0.7  # of the power that is left: a set that leaves no less than this of another's tells little more
MOST = 0.5  # one more effect must leave at most this share of the power where the law of blows would excuse it


@dataclass
class Climb(AbstractStandards):
    """From the drawing as it is to the best set of causes. without: kinds that the library leaves out. large: whether
    more effects at once earned their place than a diagnosis may be sure of.
    """

    study: Study
    rng: np.random.Generator
    without: frozenset[str]

    def __post_init__(self):
        self.searches = {id(self.search.subject): self.search}
        self.large = False

    def smooth(self, singles: list[Cause]) -> tuple[Cause, Adequacy]:
        """Add effects as long as what is left is large enough to be worth one, and one takes a good part of it."""
        best, level = self.baseline, singles
        found: Adequacy | None = None
        for depth in range(1, DEEPEST + 1):
            leaders = self._leaders(level)
            if not leaders:
                break
            top, judged = self._judged(leaders[0])
            self._tell(f"{' + '.join(top.names)} leaves {judged.excess:.3g} of the noise's power, p {judged.p:.2g}")
            if found is not None and not self._better(top, best, judged, found):
                break
            best, found = top, judged
            if self._may_mislead(top) and not self.enough(judged):
                best, found = top, judged = self._exchanged(top, judged, WORTH)
            if top.fitted.fraction == 1.0:
                self.scale = max(1.0, min(judged.noise, 1.5))
            if depth == DEEPEST or self._cancelled():
                break
            if depth >= SURE or not top.fitted.pressed:  # one that is enough only at the end of its range is not
                if self.enough(judged) or self._little(top, judged, depth):
                    break
                if self._out_of_reach(top, judged):
                    self._tell("nothing smooth in the library could take what is left")
                    break
            level = self.search.level(leaders[:LEADERS] if depth < SURE else [top], PARTNERS, place=self._place(top))
        if found is None:
            found = adequacy(best.fitted, self.search.latent, self.rng)
        if len(best.candidates) > SURE and self._may_mislead(best) and not self._cancelled():
            best, found = self._exchanged(best, found, NAMED)
        if len(best.candidates) > 1 and self.enough(found) and not self._cancelled():
            best, found = self._thinned(best, found)
        if not self._cancelled():
            best, found = self._narrowed(best, found)
        if len(best.candidates) <= SURE and best.fitted.fraction == 1.0 and elsewhere(self.search, best):
            best, found = self._likelier_than(best, found)
        return best, found

    def _place(self, top: Cause) -> str | None:
        """Where what a cause leaves lies beyond doubt."""
        found = shares(place_evidence(top.fitted, self.search.latent, self.scale))
        place = max(found, key=lambda at: found[at], default=None)
        return place if place is not None and found[place] > BEYOND_DOUBT else None

    def _thinned(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """A set that is enough with a member given up, where that is more probable: the first of a pair may have been
        needed only to lead to the other.
        """
        for member in best.candidates:
            self.search.without(best, member)
        return self._likelier_than(best, found)

    def _narrowed(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """A set with a simpler form in the place of one that contains it, where that is more probable: beside another
        effect where it stands alone, for the wider form may do what that does.
        """
        narrow = self.search.simpler(best)
        if len(best.candidates) < SURE:
            for simple in narrow:
                self.search.level([simple], PARTNERS)
        return self._likelier_than(best, found, SURE) if narrow else (best, found)

    def _likelier_than(self, best: Cause, found: Adequacy, size: int = 0) -> tuple[Cause, Adequacy]:
        """The most probable set of so many members, or of as many as the best one has, unless that alone is enough."""
        top = self._most_probable(best, 0.0, size)
        if top is best:
            return best, found
        self._tell(f"{' + '.join(top.names)} is the likelier")
        judged = self._judged(top, self.searches[id(top.fitted.subject)])
        return judged if self.enough(judged[1]) or not self.enough(found) else self._judged(best)

    def switching(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """Where nothing smooth is enough or follows whole records, or held-out experiments refuse it: stops, play,
        bending and friction that grows with load, family by family.
        """
        best, last = self._or_load(best, last)
        refused, lost = self.refused(best), best.fitted.fraction < 1.0
        if not (refused or lost) and (self.enough(last) or self._little(best, last, 1)):
            return self._or_play(best, last)
        if refused:
            self._tell(f"held-out experiments refuse {' + '.join(best.names)}")
        best, last = self._tuned(best, last)
        if self._settled(best, last):
            return best, last
        asked = self._asked_of(best, last, refused, lost)
        motion, alone = let_go(self.baseline.fitted) if asked else {}, self._best_alone()
        for family in asked:
            if self._cancelled():
                break
            self._tell(f"trying {family.replace('_', ' ')}")
            search = self._search_of(family)
            if search is None:
                continue
            self.searches[id(search.subject)] = search
            for cause in switching(search, self.baseline, family, motion, best):
                self.search.tried[cause.names] = cause
                if self._likelier(cause, best):
                    best, last = self._judged(cause, search)
            best, last = self._closer(best, last, search)
            if search.tried.get(best.names) is best:
                best, last = self._closer(*self._joined(best, last, search), search)
            elif self._settled(best, last):
                break
            elif len(best.candidates) <= SURE:
                for beside in self._besides(best, alone):
                    for cause in switching(search, self.baseline, family, motion, best, beside)[:1]:
                        self.search.tried[cause.names] = cause
                        cause, judged = self._judged(cause, search)
                        if self._accepted(cause, best, judged, last):
                            best, last = self._closer(cause, judged, search)
                    if self._settled(best, last):
                        break
            if self._settled(best, last):
                break
        return best, last

    def _or_load(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set, or one with friction that grows with load in place of its dry friction: where loads change
        little the one does what the other does, and neither stands in the other's model.
        """
        dry = [c for c in best.candidates if rubs_dry(c.kind)]
        if LOAD not in families(self.without) or not dry or len(best.candidates) > SURE or self._cancelled():
            return best, last
        rest = next((c for c in best.candidates if c is not dry[0]), None)
        beside = self._single(best, rest) if rest is not None else None
        search = self._search_of(LOAD)
        if search is None or (rest is not None and beside is None):
            return best, last
        self.searches[id(search.subject)] = search
        for cause in switching(search, self.baseline, LOAD, {}, best, beside):
            self.search.tried[cause.names] = cause
            if self._likelier(cause, best):
                best, last = self._judged(cause, search)
        return best, last

    def _or_play(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """What is enough, or play: of a faint gap, play is what a clock or a length may imitate to within the noise."""
        gain = self.baseline.fitted.chi2 - best.fitted.chi2
        if self.search.followed < 1.0 or not 0.0 < gain < FAINT * self.scale**2:
            return best, last
        for family in sorted(PLAYS & set(families(self.without))):
            search = None if self._cancelled() else self._search_of(family)
            if search is None:
                continue
            self.searches[id(search.subject)] = search
            for cause in switching(search, self.baseline, family, {}, best):
                self.search.tried[cause.names] = cause
                if self._likelier(cause, best):
                    best, last = self._judged(cause, search)
        return best, last

    def _tuned(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set, or a cause that no slope leads to: alone, or beside the likeliest single one, or beside another
        that the same motion shows once it is there.
        """
        beside = self._best_alone()
        for cause in self.search.tuning(self.baseline, best):
            if self._likelier(cause, best):
                best, last = self._joined(*self._judged(cause), self.search)
        if beside is None or self._settled(best, last):
            return best, last
        for cause in self.search.tuning(beside, best):
            cause, judged = self._judged(cause)
            if self._accepted(cause, best, judged, last):
                best, last = cause, judged
                if not self._settled(best, last):
                    best, last = self._exchanged(best, last, WORTH)
        return best, last

    def _closer(self, best: Cause, last: Adequacy, search: Search) -> tuple[Cause, Adequacy]:
        """The best set with walls as they come, where it is of this family, not enough as it is and likelier so, or
        what needs only such walls and nothing beside them; sets that could come up with it so, and other ends of travel
        that stop the motion alike, are asked as well.
        """
        if search.tried.get(best.names) is not best:
            return best, last
        better = best if self.enough(last) else closer(search, best)
        if better is not best and len(best.candidates) > 1:  # what stood beside may have made up for walls too hard
            fewer = [search.without(better, c) for c in better.candidates if c.family == SMOOTH]
            better = max([better, *fewer], key=self._by_fit)
        alike = stopping_alike(search, better)
        if better is best and not alike:
            return best, last
        known = {c.names for c in (better, *alike)}
        others = [c for c in search.tried.values() if c.names not in known]
        found = [better, *alike, *coming_up(search, best, better, others)]
        self.search.tried.update({c.names: c for c in found})
        return self._judged(max(found, key=self._weight), search)

    def _joined(self, best: Cause, last: Adequacy, search: Search) -> tuple[Cause, Adequacy]:
        """A cause that switches on, with a smooth one beside it where that earns its place. Where the law of blows
        would excuse what is left, it must take most of it.
        """
        excused = self._settled(best, last)
        if (excused and self.enough(last)) or len(best.candidates) >= SURE or self._cancelled():
            return best, last
        for cause in search.level([best], PARTNERS)[:1]:
            cause, judged = self._judged(cause, search)
            if self._better(cause, best, judged, last) and (
                not excused or judged.power < MOST * max(last.power, NOTHING)
            ):
                self.search.tried[cause.names] = cause
                return cause, judged
        return best, last

    def _asked_of(self, best: Cause, last: Adequacy, refused: bool, lost: bool) -> list[str]:
        """Families of what switches on that could bear what a cause leaves. Friction that grows with load first: of
        all these it is most like what is smooth, and needs no blows followed.

        refused: by held-out experiments. lost: the motion, before the records end.
        """
        every = sorted(set(families(self.without)) - {SMOOTH}, key=lambda family: (family != LOAD, family))
        if lost or (refused and self.enough(last)):  # nothing that is left here says where to look
            return every
        if not refused and last.excess * best.fitted.r.size < WORTH_A_TRY:
            return []  # too little to bear another effect
        places = shares(place_evidence(best.fitted, self.search.latent, self.scale))
        if last.excess > UNREAD or _in_the_picture(places) < IN_THE_PICTURE:
            return every
        # What is left lies in the picture, not in the mechanism; but a mark drifts where its body's pin is loose, and
        # all stand elsewhere before the release where pins lay aside.
        return [f for f in every if f in PLAYS]

    def _best_alone(self) -> Cause | None:
        """The likeliest single cause that follows whole records."""
        singles = [c for c in self.search.tried.values() if len(c.candidates) == 1 and c.fitted.fraction == 1.0]
        return max(singles, key=self._by_fit, default=None)

    def _besides(self, best: Cause, alone: Cause | None) -> list[Cause]:
        """Single causes beside which one that switches on is tried: the likeliest, and each member of the best pair, of
        which the other may only imitate what switches on.
        """
        found = [alone] if alone is not None else []
        for member in best.candidates:
            single = self._single(best, member)
            if single is not None and single.names not in [c.names for c in found]:
                found.append(single)
        return [c for c in found if c.fitted.fraction == 1.0]

    def _single(self, pair: Cause, member: Candidate) -> Cause | None:
        """A member of a smooth pair alone, fitted where that was not done yet; None of one that is not smooth."""
        known = self.search.tried.get((member.name,))
        if known is not None or len(pair.candidates) != SURE or pair.fitted.subject is not self.search.subject:
            return known
        (other,) = (c for c in pair.candidates if c is not member)
        return self.search.without(pair, other)

    def _search_of(self, family: str) -> Search | None:
        """The same experiments under another family's model; None where the mechanism has no place for it."""
        every = library(self.study.mechanism, family, self.study.tolerances, self.without, driven_effects(self.study))
        known = alike(every, self.search.subject.library)
        if not any(c.family == family for c in known.candidates):
            return None
        mine = self.search.subject
        subject = prepare(self.study, known, mine.step_s, (mine.noise, mine.held_noise), mine.kept)
        for new, old in zip((*subject.fit, *subject.held_out), (*mine.fit, *mine.held_out), strict=True):
            new.correction = old.correction
        return Search(subject, self.search.tell, self.search.cancelled, self.search.latent)

    def _judged(self, cause: Cause, search: Search | None = None) -> tuple[Cause, Adequacy]:
        """A cause and what it leaves, with the responses to unknown forces taken about it."""
        search = search or self.search
        search.look_again(cause)
        return cause, adequacy(cause.fitted, search.latent, self.rng)

    def _may_mislead(self, best: Cause) -> bool:
        """Whether the way to a set is worth going back: to a pair, or to three where the drawing loses the motion."""
        return SURE <= len(best.candidates) <= (SURE if self.search.followed == 1.0 else SURE + 1)

    def _exchanged(self, best: Cause, found: Adequacy, worth: float) -> tuple[Cause, Adequacy]:
        """The best set with members given up or exchanged, as long as that makes it so much more probable."""
        for _ in best.candidates:
            self.search.exchange(best)
            top = self._most_probable(best, worth)
            if top is best or self._cancelled():
                break
            best, found = self._judged(top)
            self._tell(f"{' + '.join(best.names)} instead leaves {found.excess:.3g} of the noise's power")
            if self.enough(found):
                break
        return best, found

    def _most_probable(self, best: Cause, worth: float, size: int = 0) -> Cause:
        """Of all sets tried that are no larger than it or than `size`, by as much of the likelihood as the closest fit
        bears; others must be worth it.
        """
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
            known = bool(best.candidates) and self.search.tried.get(best.names) is best
            if known and best.fitted.fraction == 1.0 and last.power < MOST_GONE * self.at_base.power:
                wide = self.scale / np.sqrt(softness(scaled(best.fitted, self.scale)))
                for alias in complete(self.searches[id(best.fitted.subject)], best, float(wide)):
                    self.search.tried[alias.names] = alias
            return self._likelier_than(best, last) if known else (best, last)
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

    def _tell(self, words: str) -> None:
        self.search.tell(words)

    def _cancelled(self) -> bool:
        return self.search.cancelled()


def _in_the_picture(places: Mapping[str, float]) -> float:
    """Share of what is left that lies in markers and camera, which no effect of the mechanism could bear."""
    return sum(share for place, share in places.items() if place == "camera" or place.startswith("marker:"))
