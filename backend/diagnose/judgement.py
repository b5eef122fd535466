"""From what was searched to a verdict: do causes fit, how probable is each, where, and how far does the gap shrink?"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from backend.diagnose.adequacy import Adequacy, scaled
from backend.diagnose.belief import Belief, aliases, weigh
from backend.diagnose.cause import Cause
from backend.diagnose.climb import NEAR, Climb
from backend.diagnose.diagnosis import Diagnosis, Drawn
from backend.diagnose.ends import one_motion
from backend.diagnose.fitted import Fitted, mean_square
from backend.diagnose.latent import forces, log_mean, responses
from backend.diagnose.lone import set_lone_aside
from backend.diagnose.next_experiment import next_experiment
from backend.diagnose.overpromise import overpromise
from backend.diagnose.shrink import Shrinkage, Test, held_out_tests, shrinkage
from backend.diagnose.softness import softness
from backend.diagnose.standards import STRICT, SURE, WIDE, form
from backend.diagnose.subject import SAME, Subject
from backend.diagnose.unknown import Unknown, unknown_about
from backend.diagnose.verdict import fitted_share, make_report
from backend.diagnose.where import locations, shares, trace, whereabouts
from backend.diagnose.which import Search
from backend.fit.guess import told
from backend.mechanism.gap_report import Verdict
from backend.mechanism.study import Study

CLEAR = 1e-4  # p below which a gap is there whatever was believed before
CLOSE = 8  # explanations that held-out experiments are asked about
MOST_OF_IT = 0.9  # of the held-out gap: what a form that is a little wrong has to remove
OF_MANY = 0.99  # the same of several effects none of which does that alone: they imitate nine tenths of anything
NEARLY_ALL = 0.999  # of the held-out gap: a cause that removes so much keeps its name, though its form is not the last
ON_THE_WAY = 2  # smaller sets about whose motion laws of unknown form are weighed, too
DOUBT = 0.9  # probability of an unknown law beyond which a cause that nearly fits is not named
LIKELIER = 0.5  # the same of one that fits
DOUBTED = 0.05  # the same beyond which it is worth to look where it lies, with a base that moves among the places


@dataclass
class Judgement:
    """Verdicts on what a search found. scale: of all sigmas. began: by the clock that ends the report."""

    study: Study
    tolerance_m: float | None
    search: Search
    drawn: Drawn
    scale: float
    rng: np.random.Generator
    tell: Callable[[str], None]
    began: float

    @property
    def subject(self) -> Subject:
        """What the search looked at last."""
        return self.search.subject

    def nothing(self) -> Diagnosis:
        """The drawing is as the data have it."""
        return self._reported("none", self.drawn.cause, False, self.drawn.tests)

    def doubtful(self, causes: Sequence[Cause]) -> bool:
        """Whether nothing amiss is likelier than all named causes together, and no unknown law beyond doubt, though a
        test found the data unusual.
        """
        z = unknown_about(self.drawn.cause.fitted, self.search.latent, self.search.raw).log_z(self.scale)
        count = len(self.subject.library.candidates)
        belief = weigh(self.drawn.cause, causes, count, scale=self.scale, unknown_log_z=log_mean(list(z.values())))
        return belief.unknown < DOUBT and belief.none > np.sum(belief.probability)

    def of(self, best: Cause, last: Adequacy, climb: Climb) -> Diagnosis:
        """The best set of causes, from adequacy here and on the held-out experiments."""
        if self.subject.held_out and set_lone_aside(best.fitted):
            self.search.looked.clear()  # all that is foretold is of the samples that count
            self.drawn = replace(self.drawn, tests=held_out(self.drawn.cause, self.scale, self.tell))
        after = held_out(best, self.scale, self.tell)
        enough = climb.enough(last)
        verdict = self._verdict(best, last, climb, self._shrunk(after))
        if verdict == "unknown" and self.drawn.p > CLEAR and self.drawn.whole and best.fitted.fraction == 1.0:
            tried = [c for c in self.search.tried.values() if c.candidates and c.fitted.fraction == 1.0]
            if self.doubtful(tried):
                return self._reported("none", self.drawn.cause, False, self.drawn.tests)
        return self._reported(verdict, best, enough, after)

    def _shrunk(self, after: tuple[Test, ...]) -> Shrinkage | None:
        return shrinkage(self.drawn.tests, after, self.rng) if self.drawn.tests else None

    def _verdict(self, best: Cause, last: Adequacy, climb: Climb, shrunk: Shrinkage | None) -> Verdict:
        """Before anything is weighed: by what the causes leave."""
        baseline, enough = self.drawn.cause, climb.enough(last)
        fits = enough or climb.slight(best, last)
        left, drawn = self.search.left(best, self.scale), self.search.left(baseline, self.scale)
        if left is not None and drawn is not None:
            self.tell(f"on held-out experiments {left.excess:.3g} of the noise's power is left, p {left.p:.2g}")
            slight = left.excess < form(best) ** 2 * np.clip(drawn.excess, 0.0, WIDE)
            fits = fits and (left.p > STRICT or slight or (shrunk is not None and self._tolerated(shrunk)))
        if shrunk is not None and shrunk.explained is not None:
            removed = shrunk.explained
        else:
            gap = gap_power(baseline.fitted, best.fitted, self.drawn.adequacy.power)
            removed = 1.0 - last.power / max(gap, 1e-12)
        complete = best.fitted.fraction == 1.0
        fits = fits and len(best.candidates) <= SURE and not (climb.large or climb.names_a_remainder(best, enough))
        nearly = removed >= (MOST_OF_IT if self._led(best) else OF_MANY) and complete
        return "identified" if fits and complete else "approximate" if nearly else "unknown"

    def _led(self, best: Cause) -> bool:
        """Whether one effect alone explains most of the fitted gap: what two or more do together only, as a viscous
        friction with an offset does what a one-way damper does, may be the work of one that the library lacks.
        """
        alone = (self.search.tried.get((c.name,)) for c in best.candidates)
        whole = [c.fitted for c in alone if c is not None and c.fitted.fraction == 1.0]
        shares = (fitted_share(self.subject, self.drawn.cause.fitted, fitted, self.scale) for fitted in whole)
        return len(best.candidates) < 2 or max(shares, default=0.0) >= MOST_OF_IT

    def _tolerated(self, shrunk: Shrinkage) -> bool:
        """What is left on held-out experiments is smaller than the user minds."""
        return self.tolerance_m is not None and shrunk.excess_upper < self.tolerance_m

    def _reported(self, verdict: Verdict, best: Cause, enough: bool, after: tuple[Test, ...]) -> Diagnosis:
        """Probabilities, pictures' material and the report."""
        self.tell("weighing the explanations")
        shrunk = self._shrunk(after)
        exact = verdict == "none" or (verdict == "identified" and enough)
        soft = 1.0 if exact else softness(scaled(best.fitted, self.scale))
        wide = self.scale / np.sqrt(soft)
        causes = [c for c in self.search.tried.values() if c.candidates and c.fitted.fraction == best.fitted.fraction]
        law, model_free = self._unknown(best, exact, wide)
        belief = self._belief(best, causes, exact, soft, model_free)
        verdict = _weighed(verdict, exact, enough, belief, shrunk, self._led(best))
        free = shares(model_free)
        if law is not None and verdict != "none" and belief.unknown > DOUBTED:
            free = whereabouts(law, model_free, self.scale)
        missing, following, also = None, None, {}
        if verdict != "none":
            at = locations(belief, free)[0].at if belief.causes or free else ""
            drawn, latent, unknown = self.drawn.cause.fitted, self.drawn.latent, verdict == "unknown"
            missing = trace(self.subject, drawn, latent, at, free, self.scale, unknown)
            also = self._aliases(belief, causes, wide)
            self.tell("choosing the next experiment")
            following = next_experiment(self.subject, belief, wide, at if unknown and free else "")
        guessed = told(self.study.mechanism, best.fitted.choice.parameters)
        said, spent_s = [*guessed, *inconclusive(self.subject, verdict, shrunk)], time.perf_counter() - self.began
        made = make_report(
            verdict, self.subject, self.drawn.cause, best, enough, belief, self.drawn.about, also, free, missing,
            shrunk, self.scale, soft, self.drawn.p, following, said, self.tolerance_m, spent_s,
            {c.names: c for c in causes},
        )  # fmt: skip
        return Diagnosis(
            made, self.subject, self.drawn.cause, best, belief, free, missing, self.drawn.tests, after, self.scale
        )

    def _unknown(self, best: Cause, exact: bool, wide: float) -> tuple[Unknown | None, dict[str, float]]:
        """What is unknown instead of the causes, about the motion of theirs that leaves it likeliest, and its log
        evidence by place; without causes, that of the drawing alone.
        """
        if not best.candidates:
            return None, self.drawn.model_free
        about = [self._unknown_about(c) for c in (best, *self._on_the_way(best, exact))]
        weighed = [(u, u.log_z(wide)) for u in about]
        return max(weighed, key=lambda pair: log_mean(list(pair[1].values())))

    def _unknown_about(self, cause: Cause) -> Unknown:
        """Laws of unknown form, to first order about a cause's motion."""
        subject, raw = cause.fitted.subject, forces(cause.fitted.subject, cause.fitted, SAME)
        return unknown_about(cause.fitted, responses(subject, cause.fitted, raw), raw)

    def _on_the_way(self, best: Cause, exact: bool) -> list[Cause]:
        """Smaller sets on the way to one that does not fit: where several effects at once imitate something, what they
        do together is far from linear, and a law of unknown form may be told from them about fewer of them only.
        """
        parts = [
            c for c in self.search.tried.values()
            if c.candidates and set(c.names) < set(best.names) and c.fitted.fraction == best.fitted.fraction
            and c.fitted.subject is best.fitted.subject
        ]  # fmt: skip
        return [] if exact or len(best.candidates) <= SURE else sorted(parts, key=lambda c: -c.log_z)[:ON_THE_WAY]

    def _belief(self, best: Cause, causes: list[Cause], exact: bool, soft: float, model_free) -> Belief:
        """How probable each set of causes is, beside nothing amiss and something unknown."""
        same = self.drawn.cause if self.drawn.cause.fitted.fraction == best.fitted.fraction else None
        unknown = log_mean(list(model_free.values())) if model_free else None
        if unknown is not None and exact and best.candidates:
            unknown -= overpromise(best, causes, self.scale)
        weighed = partial(
            weigh, same, causes, len(self.subject.library.candidates), scale=self.scale, softness=soft,
            unknown_log_z=unknown, one_motion=one_motion(causes) if best.candidates else (),
        )  # fmt: skip
        belief = weighed()
        if not (exact and best.candidates):  # where no form is right, held-out experiments judge by what all lack
            return belief
        near = [c for c, z in zip(belief.causes, belief.log_z, strict=True) if z > belief.log_z[0] - NEAR][:CLOSE]
        return weighed(foretold={c.names: self.search.foretold(c, self.scale) for c in near})

    def _aliases(self, belief: Belief, causes: Sequence[Cause], wide: float) -> dict[tuple[str, ...], list[list[str]]]:
        """What these data cannot tell from each cause that they leave standing."""
        fitted = {c.names: c for c in causes}
        standing = [belief.causes[i] for i in belief.reported]
        return {
            cause.names: aliases(self.drawn.about, cause, self.subject.library.candidates, fitted, wide)
            for cause in standing
            if cause.fitted.subject is self.subject
        }


def held_out(cause: Cause, scale: float, tell: Callable[[str], None]) -> tuple[Test, ...]:
    """Tests on the held-out experiments, under values frozen."""
    tell("testing on held-out experiments")
    return tuple(held_out_tests(cause.fitted, scale))


def _weighed(
    verdict: Verdict, exact: bool, enough: bool, belief: Belief, shrunk: Shrinkage | None, led: bool
) -> Verdict:
    """A verdict after what is unknown and other causes were weighed beside the best. led: by one of its members."""
    explained = None if shrunk is None else shrunk.explained
    nearly_all = explained is not None and explained > NEARLY_ALL and led
    doubtful = verdict == "identified" or (verdict == "approximate" and not nearly_all)
    if belief.unknown > DOUBT and verdict == "identified" and not enough:
        # The form is a little wrong, so that laws of any form follow what is left better.
        nearly = explained is None or explained >= (MOST_OF_IT if led else OF_MANY)
        verdict = "approximate" if nearly else "unknown"
    elif doubtful and belief.unknown > (LIKELIER if exact else DOUBT):
        verdict = "unknown"
    if verdict == "identified" and (len(belief.reported) > 1 or belief.unknown > max(belief.probability)):
        verdict = "ambiguous"
    return verdict


def inconclusive(subject: Subject, verdict: Verdict, shrunk: Shrinkage | None) -> list[str]:
    """What cannot be concluded from this study, and why."""
    said = []
    if shrunk is None and subject.held_out:
        said.append(
            "No held-out experiment holds a sample after its release that could tell a gap: how far it shrinks is "
            "not tested, only fitted. Record their motions too, and check their release times."
        )
    elif shrunk is None:
        said.append(
            "No experiment was held out: how far the gap shrinks is not tested, only fitted. Mark at least two "
            'runs "use": "held_out".'
        )
    elif verdict == "none" and shrunk.excess_upper > 2.0 * shrunk.noise and shrunk.explained is not None:
        said.append(
            "The drawing explains the fitted experiments but not the held-out ones: there is a gap outside the "
            "range of motion that was fitted. Fit experiments like the held-out ones."
        )
    if len(subject.fit) == 1:
        said.append(
            "One experiment was fitted: effects that differ only in how they grow with amplitude cannot be told "
            "apart by it. Add releases from other poses."
        )
    return said


def gap_power(drawn: Fitted, best: Fitted, followed: float) -> float:
    """What the drawing leaves of as much of the records as the best cause explains [noise variances a sample].

    followed: what it leaves of the part that it follows, which is little where a blow comes after that.
    """
    return followed if drawn.fraction == best.fraction else mean_square(drawn, best.fraction) - 1.0
