"""What is tried where nothing smooth is enough: a shaking base, stops, play, bending, friction that grows with load."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backend.diagnose.adequacy import Adequacy, adequacy
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause, is_new
from backend.diagnose.closer import closer, coming_up
from backend.diagnose.ends import stopping_alike
from backend.diagnose.fitted import LARGE, mean_square
from backend.diagnose.heard import alike
from backend.diagnose.library import BENDING, LOAD, PLAYS, SMOOTH, STOPS, families, library, rubs_dry
from backend.diagnose.onset import MOVED, Onset, moved, onset
from backend.diagnose.standards import NOTHING, SMALL, SURE, WIDE, AbstractStandards
from backend.diagnose.subject import prepare
from backend.diagnose.switch import let_go
from backend.diagnose.switched import TAKEN, switching
from backend.diagnose.where import place_evidence, shares
from backend.diagnose.which import PARTNERS, Search
from backend.mechanism.study import Study, driven_effects

IN_THE_PICTURE = 0.99  # probability of camera and markers beyond which no effect that switches on is tried
UNREAD = 25.0  # noise variances a sample: so much left is far from linear, and shifts follow it as well as forces
FAINT = 200.0  # sum of squares, in noise variances, that a cause takes off: so little is soon imitated
OTHERS = 0.9  # of the misfit, left by one of two effects: as much may be the other's
WORTH_A_TRY = 15.0  # sum of squares left, in noise variances
HARM = 4.0  # noise variances a sample, of a beginning that is well without it: so much no smooth single cause does
BORNE_OUT = 2  # single causes that held-out experiments bear out best, beside which a stop is tried
CLOSELY = 0.02  # of the size of what one of two effects does
LARGER = 0.8  # of the gap's power: the larger of two effects, alone, leaves less
MOST = 0.5  # one more effect must leave at most this share of the power where the law of blows would excuse it


@dataclass
class AbstractBeyondSmooth(AbstractStandards):
    """From the best smooth set to one that may switch on. without: kinds that the library leaves out."""

    study: Study
    rng: np.random.Generator
    without: frozenset[str]

    def __post_init__(self):
        self.searches = {id(self.search.subject): self.search}
        self.met: dict[str, Search] = {}  # by family, of ends of travel that were sought before smooth pairs
        self.struck: set[tuple[str, tuple[str, ...]]] = set()  # families of them, and what they joined
        self.after_blows = np.inf  # power that the best of them leaves

    def switching(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """Where nothing smooth is enough or follows whole records, or held-out experiments refuse it: stops, play,
        bending and friction that grows with load, family by family.
        """
        best, last = self._or_load(best, last)
        refused, lost = self.refused(best), best.fitted.fraction < 1.0
        if not (refused or lost) and (self.enough(last) or self._little(best, last, 1) or self._nothing_of(best, last)):
            return self._or_play(best, last)
        if self._settled(best, last):  # by an end of travel that was met
            return best, last
        if refused:
            self._tell(f"held-out experiments refuse {' + '.join(best.names)}")
        near = 0 < len(best.candidates) <= SURE and not lost
        for step in (self.confirmed, self._tuned) if near else (self._tuned,):  # what costs least first
            best, last = step(best, last)
            if self._settled(best, last):
                return best, last
        refused = self.refused(best)
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
            made = self._switching(search, family, motion, best)
            for cause in made:
                self.search.tried[cause.names] = cause
                if self._likelier(cause, best):
                    best, last = self._judged(cause, search)
            best, last = self._closer(best, last, search)
            found = search.tried.get(best.names) is best
            if found:
                best, last = self._closer(*self._joined(best, last, search), search)
            if self._settled(best, last):
                break
            besides = self._besides(best, None if found else alone, found, made)
            if refused and family in STOPS and not self._cancelled():
                besides += self._borne_out(besides)
            for beside in besides:
                for cause in self._switching(search, family, motion, best, beside)[:1]:
                    self.search.tried[cause.names] = cause
                    cause, judged = self._judged(cause, search)
                    if self._accepted(cause, best, judged, last):
                        best, last = self._closer(cause, judged, search)
                if self._settled(best, last):
                    break
            if self._settled(best, last):
                break
        return best, last

    def _switching(
        self,
        search: Search,
        family: str,
        motion: dict[str, np.ndarray],
        best: Cause,
        beside: Cause | None = None,
    ) -> list[Cause]:
        """Those of a family alone or beside a cause, the likeliest first, as they were found where they were sought
        already.
        """
        joined = () if beside is None else beside.names
        if (family, joined) not in self.struck:
            return switching(search, self.baseline, family, motion, best, beside)
        found = [
            c for c in search.tried.values()
            if tuple(sorted(m.name for m in c.candidates if m.family == SMOOTH)) == joined
        ]  # fmt: skip
        return sorted(found, key=lambda c: -c.log_z)

    def _or_load(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set, or one with friction that grows with load in place of its dry friction: where loads change
        little the one does what the other does, and neither stands in the other's model. Of a pair that friction alone
        is tried, too: what stood beside may have made up for the wrong kind of it. So is it where a single cause of
        any kind takes off less than noise is: what is so faint fits many a law.
        """
        replaced = [c for c in best.candidates if rubs_dry(c.kind)] or self._faint(best)
        if LOAD not in families(self.without) or not replaced or len(best.candidates) > SURE or self._cancelled():
            return best, last
        rest = next((c for c in best.candidates if c is not replaced[0]), None)
        beside = self._single(best, rest) if rest is not None else None
        search = self._search_of(LOAD)
        if search is None or (rest is not None and beside is None):
            return best, last
        self.searches[id(search.subject)] = search
        others = (None,) if beside is None else (beside, None)
        for cause in (c for other in others for c in switching(search, self.baseline, LOAD, {}, best, other)):
            self.search.tried[cause.names] = cause
            if self._likelier(cause, best):
                best, last = self._judged(cause, search)
        return best, last

    def _faint(self, best: Cause) -> tuple[Candidate, ...]:
        """A single cause in the mechanism whose gap is smaller than the noise."""
        single = len(best.candidates) == 1 and not any(map(_is_picture, best.candidates[0].places))
        return best.candidates if single and self._gain(best) < best.fitted.r.size else ()

    def _or_play(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """What is enough, or play, or in the place of a pair that lies in the picture play with a smooth cause beside
        it: of what is faint, play is what a clock or a length may imitate to within the noise.
        """
        pair = len(best.candidates) == SURE
        if pair and not any(_is_picture(place) for c in best.candidates for place in c.places):
            return best, last
        if self.search.followed < 1.0 or not 0.0 < self._gain(best) < (best.fitted.r.size if pair else FAINT):
            return best, last
        for family in sorted(PLAYS & set(families(self.without))):
            search = None if self._cancelled() else self._search_of(family)
            if search is None:
                continue
            self.searches[id(search.subject)] = search
            made = switching(search, self.baseline, family, {}, best, taken=OTHERS if pair else TAKEN)
            if pair and made:
                made += search.level([min(made, key=search.promised)], PARTNERS)[:1]
            for cause in made:
                self.search.tried[cause.names] = cause
                if self._likelier(cause, best):
                    best, last = self._judged(cause, search)
        return best, last

    def _takes_its_part(self, cause: Cause) -> bool:
        """Whether a cause could be the larger of two effects, by what it takes off alone."""
        drawn, fitted = self.baseline.fitted, cause.fitted
        if drawn.fraction < 1.0:
            return True
        return fitted.fraction == 1.0 and fitted.chi2 - fitted.r.size < LARGER * (drawn.chi2 - drawn.r.size)

    def _nothing_of(self, best: Cause, last: Adequacy) -> bool:
        """Whether a pair leaves next to nothing of what its better half alone does: smooth causes do not follow what
        switches on so closely.
        """
        return len(best.candidates) == SURE and last.power < CLOSELY**2 * self._gain(best) / best.fitted.r.size

    def _gain(self, best: Cause) -> float:
        """Sum of squares, in noise variances, that the last of the members took off."""
        fewer = self.baseline if len(best.candidates) < SURE else self._best_alone()
        return 0.0 if fewer is None else (fewer.fitted.chi2 - best.fitted.chi2) / self.scale**2

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
                    best, last = self._exchanged(best, last)
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
        would excuse what is left, it must take most of it, unless it is a marker's own: blows show in all of them.
        """
        excused = self._settled(best, last)
        if (excused and self.enough(last)) or len(best.candidates) >= SURE or self._cancelled():
            return best, last
        for cause in search.level([best], PARTNERS)[:1]:
            cause, judged = self._judged(cause, search)
            of_a_marker = all(p.startswith("marker:") for c in cause.candidates if is_new(c, best) for p in c.places)
            plain = not excused or of_a_marker or judged.power < MOST * max(last.power, NOTHING)
            if plain and self._better(cause, best, judged, last):
                self.search.tried[cause.names] = cause
                return cause, judged
        return best, last

    def _asked_of(self, best: Cause, last: Adequacy, refused: bool, lost: bool) -> list[str]:
        """Families of what switches on that could bear what a cause leaves. Friction that grows with load first: of
        all these it is most like what is smooth, and needs no blows followed.

        refused: by held-out experiments. lost: the motion, before the records end.
        """
        every = sorted(set(families(self.without)) - {SMOOTH}, key=lambda family: (family != LOAD, family))
        if self.after_blows < last.power:  # they are nearer than all that is smooth
            every = sorted(every, key=lambda family: family not in STOPS)
        if lost and self.enough(last):  # all is well until something is met
            return sorted(every, key=lambda family: family not in STOPS)
        if lost or (refused and self.enough(last)):  # nothing that is left here says where to look
            return every
        if not refused and last.excess * best.fitted.r.size < WORTH_A_TRY:
            return []  # too little to bear another effect
        places = shares(place_evidence(best.fitted, self.search.latent, self.scale))
        if last.excess > UNREAD or _in_the_picture(places) < IN_THE_PICTURE:
            return every
        # What is left lies in the picture, not in the mechanism; but a mark drifts where its body's pin is loose, all
        # stand elsewhere before the release where pins lay aside, and marks of a body that bends go apart.
        return [f for f in every if f in PLAYS | BENDING]

    def _alone(self) -> list[Cause]:
        """Single smooth causes that follow whole records: what was tried of another model joins none of this one."""
        smooth = [c for c in self.search.tried.values() if c.fitted.subject is self.search.subject]
        return [c for c in smooth if len(c.candidates) == 1 and c.fitted.fraction == 1.0]

    def _best_alone(self) -> Cause | None:
        """The likeliest of these."""
        return max(self._alone(), key=self._by_fit, default=None)

    def _besides(self, best: Cause, alone: Cause | None, found: bool, made: list[Cause]) -> list[Cause]:
        """Single causes beside which one that switches on is tried: what is enough for the beginnings of the records;
        the likeliest, and each member of the best pair, of which the other may only imitate what switches on. found:
        whether the best set switches on already, which all but the first of these would be tried beside in vain. made:
        those of the family alone; of two effects one of them, or the smooth one, takes its part off without the other.
        """
        if len(best.candidates) > SURE:
            return []
        members = [] if found else [self._single(best, m) for m in best.candidates]
        whole = [c for c in (alone, *members) if c is not None and c.fitted.fraction == 1.0]
        if not any(map(self._takes_its_part, made)):
            whole = [c for c in whole if self._takes_its_part(c)]
        asked: dict[tuple[str, ...], Cause] = {}
        for cause in whole if self._at_first is None else (self._at_first, *whole):
            asked.setdefault(cause.names, cause)
        return list(asked.values())

    def _borne_out(self, known: list[Cause]) -> list[Cause]:
        """Single smooth causes that held-out experiments do not refuse, those that leave least of them first, but for
        known ones: an end of travel that only fitted experiments meet hides what else is amiss from those alone.
        """
        left = {c.names: self.search.left(c, self.scale) for c in self._alone() if not self.refused(c)}
        excess = {names: found.excess for names, found in left.items() if found is not None}
        borne = sorted(excess, key=lambda names: excess[names])[:BORNE_OUT]
        return [self.search.tried[names] for names in borne if all(names != c.names for c in known)]

    @cached_property
    def _onset(self) -> Onset | None:
        """How far into the records the drawing, or a single cause, is enough; None where little has moved by then."""
        found = onset(self.search, self.scale)
        return found if found is not None and moved(self.baseline.fitted, found.share) > MOVED else None

    @property
    def _at_first(self) -> Cause | None:
        """A single cause that is enough for the beginnings of the records, where the drawing is not."""
        return None if self._onset is None or not self._onset.cause.candidates else self._onset.cause

    def _struck(self, top: Cause, judged: Adequacy) -> tuple[Cause, Adequacy] | None:
        """An end of travel, alone or beside what is enough until it is met, where that settles it. None where nothing
        says that it came on later: where the likeliest single cause is not that one, nor harms the beginnings.
        """
        stops = sorted(STOPS & set(families(self.without)))
        if not stops or self._cancelled() or not judged.excess > LARGE or self._onset is None:
            return None
        share, first = self._onset
        same = top.names == first.names
        came_later = judged.excess > UNREAD if same else mean_square(top.fitted, share) > HARM * self.scale**2
        if not came_later:
            return None
        self._tell(f"all is well in the first {share:.0%} of the records, trying what is met later")
        beside, motion = first if first.candidates else None, let_go(self.baseline.fitted)
        known = dict(self.search.tried)
        for family in stops:
            search = self._search_of(family)
            if search is None:
                continue
            self.searches[id(search.subject)] = self.met[family] = search
            self.struck.add((family, () if beside is None else beside.names))
            for cause in switching(search, self.baseline, family, motion, top, beside)[:1]:
                self.search.tried[cause.names] = cause
                best, last = self._closer(*self._judged(cause, search), search)
                self.after_blows = min(self.after_blows, last.power)
                plain = self.enough(last) or last.power < SMALL**2 * min(self.at_base.power, WIDE)
                if plain and self._settled(best, last):  # no smooth pair is asked, so it must be as good as one
                    return best, last
        self.search.tried = known  # smooth sets go on from here, and cannot from one of another model
        return None

    def _single(self, pair: Cause, member: Candidate) -> Cause | None:
        """A member of a smooth pair alone, fitted where that was not done yet; None of one that is not smooth."""
        known = self.search.tried.get((member.name,))
        if known is not None or len(pair.candidates) != SURE or pair.fitted.subject is not self.search.subject:
            return known
        (other,) = (c for c in pair.candidates if c is not member)
        return self.search.without(pair, other)

    def _search_of(self, family: str) -> Search | None:
        """The same experiments under another family's model; None where the mechanism has no place for it."""
        if family in self.met:
            return self.met[family]
        every = library(self.study.mechanism, family, self.study.tolerances, self.without, driven_effects(self.study))
        known = alike(every, self.search.subject.library)
        if not any(c.family == family for c in known.candidates):
            return None
        mine = self.search.subject
        subject = prepare(self.study, known, mine.step_s, (mine.noise, mine.held_noise), mine.kept, mine.coarse)
        for new, old in zip((*subject.fit, *subject.held_out), (*mine.fit, *mine.held_out), strict=True):
            new.correction = old.correction
        return Search(subject, self.search.tell, self.search.cancelled, self.search.latent)

    def _judged(self, cause: Cause, search: Search | None = None) -> tuple[Cause, Adequacy]:
        """A cause and what it leaves, with the responses to unknown forces taken about it."""
        search = search or self.search
        cause = search.seen_through(cause)
        search.look_again(cause)
        return cause, adequacy(cause.fitted, search.latent, self.rng)

    @abstractmethod
    def _exchanged(self, best: Cause, found: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set with members given up or exchanged, as long as that is worth it."""

    @abstractmethod
    def confirmed(self, best: Cause, last: Adequacy) -> tuple[Cause, Adequacy]:
        """The best set, or one that does the same on what was fitted and that held-out experiments prefer."""

    def _tell(self, words: str) -> None:
        self.search.tell(words)

    def _cancelled(self) -> bool:
        return self.search.cancelled()


def _in_the_picture(places: Mapping[str, float]) -> float:
    """Share of what is left that lies in markers and camera, which no effect of the mechanism could bear."""
    return sum(share for place, share in places.items() if _is_picture(place))


def _is_picture(place: str) -> bool:
    return place == "camera" or place.startswith("marker:")
