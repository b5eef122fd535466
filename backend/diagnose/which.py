"""Which causes: from the drawing as it is, one effect at a time, as long as the data ask for another.

Each level screens the library about the best sets so far, refits the most promising and weighs them by evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause, as_last, begun_from, in_order, is_new
from backend.diagnose.fitted import BEHIND, COARSE, LARGE, Fitted, fit, log_evidence, mean_square, start_of
from backend.diagnose.growing import FRACTIONS, follow, stretched
from backend.diagnose.latent import Latent, forces, responses
from backend.diagnose.noise_learnt import remember, set_aside
from backend.diagnose.noise_untold import size_up
from backend.diagnose.screen import EARLY, Screen, containing, screen, tuned
from backend.diagnose.step_error import orderly, step_errors
from backend.diagnose.subject import Choice, Subject
from backend.diagnose.unseen import Left, Unseen, unseen

LEAST = 1.0  # sum of squares, in noise variances, that a candidate takes off to first order, or it is not refitted
REFITS = 8  # candidates of a level that are refitted
PARTNERS = 5  # refitted beside each of the best sets
LEADERS = 3
APART = 9.0  # squared sd below which two explanations do the same
WIDER = 20.0  # noise variances: a fall by which a form with more numbers is worth trying at every place
Wider = Mapping[str, Sequence[Candidate]]


@dataclass
class Search:
    """One family of the library searched level by level. Everything tried is kept in `tried`, by names.

    followed: share of the records that the drawing follows. begun: by choice, where fits of whole records with another
    step ended, from which these begin.
    """

    subject: Subject
    tell: Callable[[str], None]
    cancelled: Callable[[], bool]
    known: Latent | None = None
    begun: Mapping[str, Float[np.ndarray, " x"]] = field(default_factory=dict)

    def __post_init__(self):
        self.tried: dict[tuple[str, ...], Cause] = {}
        self.screens: dict[tuple[str, ...], Screen] = {}
        self.looked: dict[int, tuple[Fitted, Unseen | None]] = {}
        self.opened: dict[int, Fitted] = {}  # of which what nobody states was free as well; kept, as those above are
        self.asked: set[tuple[str, ...]] = set()
        self.least: dict[float, float] = {}
        self.parts: dict[tuple[tuple[str, ...], float, float], float] = {}
        self.raw: list[np.ndarray] = []
        self.forms: set[tuple[str, str]] = set()
        self.followed = 1.0

    @property
    def latent(self) -> Latent:
        """Responses to unknown forces and shifts, about the baseline or what was looked at last."""
        if self.known is None:
            raise RuntimeError("no responses to unknown forces yet: fit the baseline first")
        return self.known

    def baseline(self) -> Cause:
        """The drawing with its tolerances alone, as far into the records as it follows them."""
        choice = self.subject.choose()
        made = follow(self.subject, choice, self._ended(choice))
        self.followed = made.fraction
        if made.fraction == 1.0 and all(p.correction is None for p in self.subject.fit):
            self.subject.put_back(orderly(step_errors(self.subject, made)))
            made = fit(self.subject, made.choice, start=made.x)
        self.raw = raw = forces(self.subject, made)
        self.known = responses(self.subject, made, raw)
        if made.fraction == 1.0:
            # Wild samples hide the noise's memory; with that bettered, others may stand out.
            for learn in (set_aside, size_up, remember, set_aside):
                if learn(made, self.known):
                    made = fit(self.subject, made.choice, start=made.x)
                    self.known = responses(self.subject, made, raw)
        return self.keep(made)

    def level(
        self,
        parents: Sequence[Cause],
        refits: int,
        rival: Cause | None = None,
        place: str | None = None,
        least: float = LEAST,
    ) -> list[Cause]:
        """Each parent with one more candidate: the most promising, refitted over what any of them can follow. A form
        that contains a simpler one is tried where the simpler came out best. rival: a set that they must come near on
        their way to whole records. place: where what the first parent leaves is known to lie; all that acts there is
        tried beside it, because first order may rank low what is not linear in two of its numbers. least: what a
        candidate must gain to first order.
        """
        joined: list[list[Fitted]] = []
        for i, parent in enumerate(parents):
            about = self.screen(parent)
            free = [c for c in self.subject.library.candidates if is_new(c, parent) and not c.sought]
            free = [c for c in free if not self._one_form(c, parent)]
            wider = containing(about, free)
            if not parent.candidates:
                self.forms = {(simple, wide.name) for simple, forms in wider.items() for wide in forms}
            plain = [c for c in free if all(c not in forms for forms in wider.values())]
            fits: list[Fitted] = []
            there = [c for c in plain if c.places == (place,) and about.gain(c) > 0.0] if i == 0 else []
            for candidate in dict.fromkeys([*self.promising(about, plain, refits, least), *there]):
                self._join(parent, about.early or about, candidate, fits, rival)
            self._widen(parent, about.early or about, wider, fits, rival)
            joined.append(fits)
        made = [self.keep(f) for fits in self._leading(joined) for f in stretched(self.subject, fits) if in_order(f)]
        return sorted(made, key=lambda c: -c.log_z)

    def _leading(self, joined: Sequence[list[Fitted]]) -> list[list[Fitted]]:
        """Fits of a level, those seen through that leave little, and the likeliest: another where that falls behind,
        a few times at most, for sets that all miss as widely hardly differ.
        """
        made = [[self._finished(f) if f.chi2 < LARGE * f.r.size else f for f in fits] for fits in joined]
        for _ in range(LEADERS):
            every = [(Cause(f, log_evidence(f)), fits, i) for fits in made for i, f in enumerate(fits)]
            if not every or self.cancelled():
                break
            top, fits, i = max(every, key=lambda e: (e[0].fitted.fraction, e[0].log_z + e[0].log_odds))
            if not top.fitted.in_longer_steps:
                break
            fits[i] = self._finished(top.fitted)
        return made

    def _finished(self, fitted: Fitted) -> Fitted:
        """A fit in the subject's own steps, begun where one in longer steps ended, unless these lose the motion."""
        if not fitted.in_longer_steps:
            return fitted
        self.tell(f"seeing {fitted.choice.name} through")
        made = fit(self.subject, fitted.choice, start=fitted.x, fractions=(fitted.fraction,))
        return made if np.isfinite(made.chi2) else fitted

    def seen_through(self, cause: Cause) -> Cause:
        """A cause in the subject's own steps."""
        return cause if not cause.fitted.in_longer_steps else self.keep(self._finished(cause.fitted))

    def _one_form(self, candidate: Candidate, parent: Cause) -> bool:
        """Whether one of a parent's members is a form of the candidate, or the other way: both would do one thing."""
        return any({(candidate.name, m), (m, candidate.name)} & self.forms for m in parent.names)

    def promising(
        self, about: Screen, candidates: Sequence[Candidate], most: int, least: float = LEAST
    ) -> list[Candidate]:
        """Those that gain most to first order; of a large misfit half as many by its beginning, too."""
        found = [c for c, gain in about.ranking(candidates)[:most] if gain > least]
        if about.early is not None:
            found += [c for c, gain in about.early.ranking(candidates)[: most // 2] if gain > least and c not in found]
        return found

    def _join(
        self,
        parent: Cause,
        about: Screen,
        candidate: Candidate,
        fits: list[Fitted],
        rival: Cause | None,
        simple: Fitted | None = None,
    ) -> None:
        """Fit a parent with one candidate more, unless that was tried. simple: the fit of a form that the candidate
        contains, where it begins.
        """
        names = tuple(sorted([*parent.names, candidate.name]))
        if names in self.tried or names in self.asked or self.cancelled():
            return
        self.asked.add(names)
        self.tell(f"trying {' + '.join(names)}")
        choice = self.subject.choose(*parent.candidates, candidate)
        begin, values = self._beginning(parent.fitted, about, candidate, fits, simple)
        horizons = self._horizons(parent)
        horizons = horizons if about is self.screen(parent) else (EARLY * horizons[0], *horizons)
        if (ended := self._ended(choice)) is not None:
            fitted = self._near(rival, parent.fitted, choice, ended, horizons[-1:])
        else:
            fitted = self._near(rival, parent.fitted, choice, begun_from(begin, choice, values), horizons)
        if fitted is not None and not fitted.chi2 <= parent.fitted.chi2:  # it contains the parent, and went astray
            fitted = self.fit_about(parent.fitted, choice, begun_from(parent.fitted, choice), horizons[-1:])
        if fitted is not None and np.isfinite(fitted.chi2):  # lost from its start, a set explains nothing
            fits.append(fitted)

    def _ended(self, choice: Choice) -> np.ndarray | None:
        """Where a fit of the same numbers ended that took another step."""
        x = self.begun.get(choice.name)
        return x if x is not None and x.size == start_of(self.subject, choice).size else None

    def fit_about(
        self, parent: Fitted, choice: Choice, x: np.ndarray, shares: Sequence[float], ahead: float | None = None
    ) -> Fitted:
        """Over growing shares of the records, in as long steps as what the parent leaves bears; not seen through where
        these are longer than its own.
        """
        rough = parent.longer is not None
        made = fit(parent.longer or self.subject, choice, start=x, fractions=shares, ahead=ahead, coarse=rough)
        return replace(made, subject=self.subject) if rough else made

    def _near(
        self, rival: Cause | None, parent: Fitted, choice: Choice, x: np.ndarray, horizons: Sequence[float]
    ) -> Fitted | None:
        """What joins a parent, fitted over one share of the records after the other; None where it falls far behind a
        rival, which was not even fitted to that share alone.
        """
        made = None
        for share in horizons:
            made = self.fit_about(parent, choice, x, (share,), self.least.get(share))
            x, self.least[share] = made.x, np.fmin(made.chi2, self.least.get(share, np.inf))
            if rival is not None and share < horizons[-1]:
                key = (rival.names, rival.fitted.chi2, share)
                if key not in self.parts:
                    self.parts[key] = mean_square(rival.fitted, share)
                if not made.chi2 < BEHIND * max(self.parts[key], 1.0) * made.r.size:
                    return None
        return made

    def _widen(self, parent: Cause, about: Screen, wider: Wider, fits: list[Fitted], rival: Cause | None) -> None:
        """Fit the forms that contain the candidate that came out best; where one of them leaves much less, at all the
        other places too: the simpler form may have come out best at a wrong one.
        """
        if not fits:
            return
        plain, best = list(fits), min(fits, key=lambda f: f.chi2)
        for candidate in wider.get(best.choice.candidates[-1].name, ()):
            self._join(parent, about, candidate, fits, rival, best)
        fall = max(WIDER, COARSE * best.chi2) if best.in_longer_steps else WIDER
        better = {f.choice.candidates[-1].kind for f in fits[len(plain) :] if best.chi2 - f.chi2 > fall}
        for simple in plain:
            for candidate in wider.get(simple.choice.candidates[-1].name, ()):
                if simple is not best and candidate.kind in better:
                    self._join(parent, about, candidate, fits, rival, simple)

    def _beginning(
        self, parent: Fitted, about: Screen, candidate: Candidate, fits: Sequence[Fitted], simple: Fitted | None
    ) -> tuple[Fitted, dict[str, float]]:
        """The fit to begin from, and values for a candidate that joins it: where a simpler form ended, or the best of
        two that do the same as it (every hinge of a scissor rubs alike), or at the parent with a guess.
        """
        if simple is not None and (values := as_last(simple, about, candidate)):
            return simple, values
        alike = [(f, values) for f in fits if (values := as_last(f, about, candidate))]
        if len(alike) > 1:  # the first may have ended in a place of its own
            return min(alike, key=lambda pair: pair[0].chi2)
        return parent, about.guess(candidate)

    def _horizons(self, cause: Cause) -> tuple[float, ...]:
        """Shares of the records over which a set like the cause is fitted, one after the other: where the drawing
        loses the motion, values that follow the whole of it badly do not lead to those that follow it well.
        """
        return tuple(f for f in FRACTIONS if self.followed <= f <= cause.fitted.fraction)

    def exchange(self, cause: Cause) -> None:
        """Try what remains with each member given up, and with another candidate in its place: of a set that grew one
        by one, the first may have stood for two that joined it since.
        """
        for member in cause.candidates:
            self.level([self.without(cause, member)], PARTNERS, cause)

    def without(self, cause: Cause, member: Candidate) -> Cause:
        """What remains of a cause, begun where the cause ended."""
        choice = self.subject.choose(*(c for c in cause.candidates if c is not member))
        fitted = self.fit_about(cause.fitted, choice, begun_from(cause.fitted, choice), self._horizons(cause))
        return self.keep_likelier(fitted)

    def simpler(self, cause: Cause) -> list[Cause]:
        """A cause with a simpler form, at the same place, instead of a member that contains it."""
        made = []
        for member in cause.candidates:
            if not any(member.tries):
                continue
            others = tuple(sorted(c.name for c in cause.candidates if c is not member))
            rest = self.tried.get(others) or self.without(cause, member)
            about, free = self.screen(rest), [c for c in self.subject.library.candidates if is_new(c, rest)]
            wider = containing(about, free)
            for simple in (c for c in free if member in wider.get(c.name, ())):
                fits: list[Fitted] = []
                self._join(rest, about, simple, fits, None)
                for fitted in filter(in_order, map(self._finished, fits)):
                    self.keep(fitted)
                names = tuple(sorted([*others, simple.name]))
                made += [self.tried[names]] if names in self.tried else []
        return made

    def wider(self, cause: Cause) -> list[Cause]:
        """A cause with a form that contains one of its members in that member's place, begun where the cause ended."""
        made = []
        for member in cause.candidates:
            others = [c for c in cause.candidates if c is not member]
            rest = self.tried.get(tuple(sorted(c.name for c in others))) or self.without(cause, member)
            about, free = self.screen(rest), [c for c in self.subject.library.candidates if is_new(c, rest)]
            for wide in containing(about, free).get(member.name, ()):
                choice = self.subject.choose(*others, member)
                simple = fit(self.subject, choice, start=begun_from(cause.fitted, choice), max_iterations=1)
                fits: list[Fitted] = []
                self._join(rest, about, wide, fits, None, simple)
                made += [self.keep(fitted) for fitted in map(self._finished, fits) if in_order(fitted)]
        return made

    def tuning(self, parent: Cause, rival: Cause) -> list[Cause]:
        """A parent with a candidate more whose numbers no slope leads to: the best of some values, then fitted.

        rival: the best set, which they must come near on their way to whole records.
        """
        made = []
        for candidate in self.subject.library.candidates:
            names = tuple(sorted([*parent.names, candidate.name]))
            if candidate.sought and is_new(candidate, parent) and names not in self.tried and not self.cancelled():
                self.tell(f"trying {' + '.join(names)}")
                if values := tuned(self.screen(parent), candidate):
                    choice = self.subject.choose(*parent.candidates, candidate)
                    x = begun_from(parent.fitted, choice, values)
                    fitted = self._near(rival, parent.fitted, choice, x, self._horizons(rival))
                    if fitted is not None and np.isfinite(fitted.chi2):
                        made.append(self.keep(fitted))
        return made

    def begun_at(self, cause: Cause, members: Sequence[Candidate], values: Mapping[str, float]) -> Cause | None:
        """Another set, fitted from where a cause ended and from these values, or what was tried under its names where
        that is the likelier; None where the motion is lost.
        """
        choice = self.subject.choose(*members)
        self.tell(f"trying {choice.name} as well")
        fitted = self.fit_about(cause.fitted, choice, begun_from(cause.fitted, choice, values), (1.0,))
        if not np.isfinite(fitted.chi2):
            return None
        return self.keep_likelier(fitted)

    def screen(self, cause: Cause) -> Screen:
        """First-order gains about a cause."""
        if cause.names not in self.screens:
            self.screens[cause.names] = screen(self.subject, cause.fitted)
        return self.screens[cause.names]

    def promised(self, cause: Cause) -> float:
        """Sum of squares that the best of one more candidate would leave beside a cause, to first order."""
        about = self.screen(cause)
        free = (c for c in self.subject.library.candidates if is_new(c, cause) and not c.sought)
        return cause.fitted.chi2 - max(map(about.gain, free), default=0.0)

    def at_full_length(self, cause: Cause) -> Cause:
        """The same set over the whole records."""
        if cause.fitted.fraction == 1.0:
            return cause
        return self.keep(fit(self.subject, cause.fitted.choice, start=cause.fitted.x))

    def look_again(self, cause: Cause) -> None:
        """Take the responses to unknown forces about this cause."""
        self.known = responses(self.subject, cause.fitted)

    def _unseen(self, cause: Cause) -> Unseen | None:
        if id(cause.fitted) not in self.looked:
            self.looked[id(cause.fitted)] = cause.fitted, unseen(cause.fitted)  # kept, so that its id stays its own
        return self.looked[id(cause.fitted)][1]

    def left(self, cause: Cause, scale: float) -> Left | None:
        """What a cause leaves on held-out experiments; None where there are none. scale: of all sigmas."""
        if not self.subject.held_out:
            return None
        made = self._unseen(cause)
        return Left(0.0, np.inf) if made is None else made.rescaled(scale).left()

    def foretold(self, cause: Cause, scale: float) -> float:
        """Log density of held-out experiments under a cause and what it learnt from the others, up to a constant."""
        if not self.subject.held_out:
            return 0.0
        made = self._unseen(cause)
        return -np.inf if made is None else made.rescaled(scale).log_density()

    def keep_likelier(self, fitted: Fitted) -> Cause:
        """What was tried under the same names, over as much of the records, unless this fit is the likelier."""
        made = Cause(fitted, log_evidence(fitted))
        before = self.tried.get(made.names)
        if before is not None and before.fitted.fraction == fitted.fraction and not made.log_z > before.log_z:
            return before
        self.screens.pop(made.names, None)  # it was about the other fit
        self.tried[made.names] = made
        return made

    def keep(self, fitted: Fitted) -> Cause:
        """Enter it among what was tried."""
        cause = Cause(fitted, log_evidence(fitted))
        self.tried[cause.names] = cause
        return cause
