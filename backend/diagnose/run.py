"""Diagnose a study: is there a gap, where, which effect, how far does it shrink, what to do next."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import jax
import numpy as np

from backend.diagnose.adequacy import adequacy
from backend.diagnose.belief import NONE, ODDS, log_prior
from backend.diagnose.cause import Cause
from backend.diagnose.climb import Climb
from backend.diagnose.closer import allowing_for_walls, closer, coming_up
from backend.diagnose.diagnosis import Diagnosis, Drawn
from backend.diagnose.fitted import SHARES, as_noise, mean_square
from backend.diagnose.heard import heard
from backend.diagnose.judgement import CLEAR, MOST_OF_IT, Judgement, held_out
from backend.diagnose.kept import Kept
from backend.diagnose.library import SMOOTH, library
from backend.diagnose.screen import library_slopes
from backend.diagnose.standards import TRIFLE
from backend.diagnose.step_error import ORDERLY, apart, orderly, step_error, step_errors
from backend.diagnose.subject import prepare
from backend.diagnose.where import beyond_doubt, place_evidence
from backend.diagnose.which import LEADERS, PARTNERS, REFITS, Search
from backend.fit.fit_study import default_step
from backend.mechanism.apart import set_apart
from backend.mechanism.study import Study, driven_effects
from backend.model.build import build

UNUSUAL = 0.05  # p below which causes are weighed against nothing amiss: how often one may be named where nothing is
STEP_ERROR = 1.0  # sum of squared sigmas that the error of the step may be wrong by: a cause that is named gains nine
ROUGH = 25.0  # the same of an error of no order, little of which is like any cause
FINER = 2  # times the step is halved for it
AHEAD = 0.25  # of what was done: what an estimate of the time left allows for once more was done than planned

Progress = Callable[[float, str], None]


def diagnose_study(
    study: Study,
    *,
    tolerance_m: float | None = None,
    without: frozenset[str] = frozenset(),
    step_s: float | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    seed: int = 0,
    kept: Kept | None = None,
) -> Diagnosis:
    """Diagnose the gap between a study's drawing and its experiments.

    tolerance_m: what may remain and still count as explained [m, or rad where only encoders measured]. without: kinds
    of effects to leave out of the library. progress(fraction, words). kept: ends of fits, on disk as they end, so that
    a search that was cut off goes on where it was. Raises ValueError naming the experiment or part
    and the remedy.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError("A diagnosis needs float64. Set JAX_ENABLE_X64=1 before JAX starts.")
    if not study.fit:
        raise ValueError('No experiment may be fitted: give at least one of them "use": "fit".')
    inquiry = _Inquiry(study, tolerance_m, without, step_s, progress, cancelled, seed, kept)
    return inquiry.conclude()


class _Inquiry:
    """The steps of one diagnosis, in order, and what each found."""

    def __init__(self, study: Study, tolerance_m, without, step_s, progress, cancelled, seed, kept):
        driven = driven_effects(study)
        study = replace(study, mechanism=set_apart(study.mechanism, driven))
        self.began, self.study, self.tolerance_m = time.perf_counter(), study, tolerance_m
        self.progress, self.cancelled = progress or (lambda fraction, words: None), cancelled or (lambda: False)
        self.rng, self.done, self.planned = np.random.default_rng(seed), 0, 4.0 + REFITS + 2.0 * LEADERS * PARTNERS
        self.without = without
        self.about_cause = False  # whether the error of the step is that of a cause's motion, not of the drawing's
        self.tell("building the library of effects")
        self.known = library(study.mechanism, SMOOTH, study.tolerances, without, driven)
        self.refinements = FINER if step_s is None else 0
        step = step_s or default_step(study, build(study.mechanism))
        self.subject = prepare(study, self.known, step, kept=kept)
        self.search = Search(self.subject, self.tell, self.cancelled)

    def tell(self, words: str) -> None:
        """One more piece of work begins; past what was planned a quarter of what was done is taken to lie ahead."""
        self.progress(self.done / max(self.planned, (1.0 + AHEAD) * self.done), words)
        self.done += 1

    def conclude(self) -> Diagnosis:
        """All steps."""
        found = self.found()
        self.progress(1.0, "done")
        return found

    def found(self) -> Diagnosis:
        """From the drawing as it is to causes, as far as the data ask for any, and what is to be held of them."""
        baseline = self.fine_enough()
        while True:
            drawn, scale = self.as_drawn(baseline)
            judgement = Judgement(
                self.study, self.tolerance_m, self.search, drawn, scale, self.rng, self.tell, self.began
            )
            if drawn.p > UNUSUAL and drawn.whole:
                self.search.level([baseline], REFITS, least=self.hint(scale))
                return judgement.nothing()
            place = beyond_doubt(drawn.model_free)
            singles = self.shaped(self.search.level([baseline], REFITS, place=place))
            if (again := self.step_about_cause(baseline, singles)) is None:
                break
            baseline = again
        if drawn.p > CLEAR and drawn.whole and judgement.doubtful(singles):
            return judgement.nothing()
        climb = Climb(
            self.search, baseline, drawn.adequacy, scale, self.tolerance_m, self.study, self.rng, self.without
        )
        best, last = pair = climb.smooth(singles)
        if not self.cancelled():
            best, last = climb.larger(*climb.switching(best, last), *pair)
        best, last = climb.confirmed(*climb.plain(best, last))
        best = allowing_for_walls(climb.searches[id(best.fitted.subject)], best)
        if best.candidates:
            self.search.tried[best.names] = best
        judgement.scale = climb.scale
        return judgement.of(best, last, climb)

    def fine_enough(self) -> Cause:
        """The drawing fitted, with a step whose error could not be taken for a cause."""
        self.tell("fitting the drawing as it is")
        baseline = self.search.baseline()
        while self.refinements and (error := step_error(self.subject, baseline)) > mattering(STEP_ERROR, baseline):
            self.refinements -= 1
            coarse = self.subject, self.search, baseline
            baseline = self.begin_again("with half the step", 0.5)
            if step_error(self.subject, baseline) > 0.5 * error:  # it is not the step's
                (self.subject, self.search, baseline), self.refinements = coarse, 0
        return baseline

    def as_drawn(self, baseline: Cause) -> tuple[Drawn, float]:
        """What the drawing's own fit says, and the scale of all sigmas by what it leaves."""
        loudness = np.linalg.norm(library_slopes(baseline.fitted), axis=0)
        self.subject.library = heard(self.subject.library, loudness)
        about, latent = self.search.screen(baseline), self.search.latent
        found = adequacy(baseline.fitted, latent, self.rng)
        scale = max(1.0, found.noise if baseline.fitted.fraction == 1.0 and found.noise < 1.5 else 1.0)
        # Of the omnibus tests and the largest gain in the library, Bonferroni.
        directed = about.rescaled(scale).p_value(self.subject.library.candidates, self.rng)
        p = min(1.0, 2.0 * min(found.p, directed))
        model_free = place_evidence(baseline.fitted, latent, scale)
        tests = held_out(baseline, scale, self.tell)
        return Drawn(baseline, about, latent, found, p, model_free, tests), scale

    def hint(self, scale: float) -> float:
        """What a single cause must gain to first order, or it has less than one in twenty of the odds that nothing is
        amiss has, whichever of its sizes before any data it is given.
        """
        single = log_prior(1, len(self.subject.library.candidates)) - np.log(len(SHARES))
        return float(2.0 * scale**2 * (np.log(NONE) - single - ODDS))

    def shaped(self, singles: list[Cause]) -> list[Cause]:
        """Single causes, the likeliest with what of its shape is freed late, and so others of its kind that could come
        up with it so; as they are where the likeliest leaves no more than noise.
        """
        if not singles:
            return singles
        leader = max(singles, key=lambda c: (c.fitted.fraction, c.log_z))
        if leader.fitted.fraction == 1.0 and as_noise(leader.fitted):
            return singles
        better = closer(self.search, leader)
        found = {c.names: c for c in (better, *coming_up(self.search, leader, better, singles))}
        return [found.get(c.names, c) for c in singles]

    def begin_again(self, how: str, step: float, errors: Sequence[np.ndarray] = ()) -> Cause:
        """The drawing fitted anew, with this share of the step and these errors of it put back."""
        self.tell(f"fitting the drawing as it is, {how}")
        ended = {c.fitted.choice.name: c.fitted.x for c in self.search.tried.values() if c.fitted.fraction == 1.0}
        before, coarse = self.subject, round(self.subject.coarse / step)
        self.subject = prepare(self.study, self.known, step * before.step_s, kept=before.kept, coarse=coarse)
        if errors:
            self.subject.put_back(errors)
        self.search = Search(self.subject, self.tell, self.cancelled, begun=ended)
        return self.search.baseline()

    def step_about_cause(self, baseline: Cause, singles: list[Cause]) -> Cause | None:
        """The drawing anew where the step errs about the motion of a cause that explains most of a gap by more than
        could be taken for another: with that error put back, or with half the step where the error is of no order, as
        of dry friction that holds and lets go; None where nothing was to be done.
        """
        leader = max((c for c in singles if c.fitted.fraction == 1.0), key=lambda c: c.log_z, default=None)
        if leader is None:
            return None
        if baseline.fitted.fraction == 1.0 and leader.fitted.chi2 > (1.0 - MOST_OF_IT) * baseline.fitted.chi2:
            return None
        errors = step_errors(self.subject, leader.fitted)
        once, twice = zip(*errors, strict=True)
        known = [
            0.0 * e if p.correction is None else p.correction for p, e in zip(self.subject.fit, once, strict=False)
        ]
        if (off := apart(self.subject, once, known)) < STEP_ERROR:
            return None
        if apart(self.subject, once, twice) > ORDERLY * off:
            if not self.refinements or off < mattering(ROUGH, baseline):
                return None
            self.refinements -= 1
            return self.begin_again("with half the step", 0.5)
        if self.about_cause:
            return None
        self.about_cause = True
        how = f"with the error of the step about {' + '.join(leader.names)}"
        return self.begin_again(how, 1.0, orderly(errors))


def mattering(least: float, baseline: Cause) -> float:
    """Sum of squared sigmas from which an error of the step matters: never less than what bears no name of the gap,
    over whole records unless the drawing's motion does not reach their end.
    """
    drawn, whole = baseline.fitted, np.inf
    if drawn.fraction < 1.0:
        whole = mean_square(drawn, 1.0) * drawn.r.size / drawn.fraction
    return max(least, TRIFLE**2 * (whole if np.isfinite(whole) else drawn.chi2))
