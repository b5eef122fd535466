"""Diagnose a study: is there a gap, where, which effect, how far does it shrink, what to do next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import numpy as np

from backend.diagnose.adequacy import Adequacy, adequacy, scaled
from backend.diagnose.belief import Belief, aliases, weigh
from backend.diagnose.cause import Cause
from backend.diagnose.climb import NEAR, Climb
from backend.diagnose.closer import closer, coming_up
from backend.diagnose.ends import one_motion
from backend.diagnose.finer import WORLD, base_response, finer_responses
from backend.diagnose.fitted import Fitted, mean_square
from backend.diagnose.kept import Kept
from backend.diagnose.latent import Latent, forces, log_mean, responses
from backend.diagnose.library import SMOOTH, heard, library
from backend.diagnose.next_experiment import next_experiment
from backend.diagnose.overpromise import overpromise
from backend.diagnose.screen import Screen, library_slopes
from backend.diagnose.shrink import Shrinkage, Test, held_out_tests, shrinkage
from backend.diagnose.softness import softness
from backend.diagnose.standards import STRICT, SURE, WIDE, form
from backend.diagnose.step_error import ORDERLY, apart, orderly, step_error, step_errors
from backend.diagnose.subject import SAME, Subject, prepare
from backend.diagnose.switched import CHANCE
from backend.diagnose.unknown import Unknown, unknown_about
from backend.diagnose.verdict import fitted_share, make_report
from backend.diagnose.where import Trace, locations, missing_force, missing_motion, place_evidence, shares
from backend.diagnose.which import LEADERS, PARTNERS, REFITS, Search
from backend.fit.fit_study import default_step
from backend.fit.guess import told
from backend.mechanism.apart import set_apart
from backend.mechanism.gap_report import GapReport
from backend.mechanism.study import Study, driven_effects
from backend.model.build import build

UNUSUAL = 0.05  # p below which causes are weighed against nothing amiss: how often one may be named where nothing is
CLEAR = 1e-4  # p below which a gap is there whatever was believed before
CLOSE = 8  # explanations that held-out experiments are asked about
MOST_OF_IT = 0.9  # of the held-out gap: what a form that is a little wrong has to remove
OF_MANY = 0.99  # the same of three effects and more none of which does that alone: they imitate nine tenths of anything
NEARLY_ALL = 0.999  # of the held-out gap: a law that removes so much keeps its name, though its form is not the last
ON_THE_WAY = 2  # smaller sets about whose motion laws of unknown form are weighed, too
DOUBT = 0.9  # probability of an unknown law beyond which a cause that nearly fits is not named
LIKELIER = 0.5  # the same of one that fits
DOUBTED = 0.05  # the same beyond which it is worth to look where it lies, with a base that moves among the places
JOINTS = 2  # likeliest ones whose forces are taken as fine as the motion of the base
STEP_ERROR = 1.0  # sum of squared sigmas that the error of the step may be wrong by: a cause that is named gains nine
ROUGH = 25.0  # the same of an error of no order, little of which is like any cause
FINER = 2  # times the step is halved for it

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Diagnosis:
    """The report and what its pictures are drawn from. before, after: held-out tests (or none)."""

    report: GapReport
    subject: Subject
    baseline: Cause
    best: Cause
    belief: Belief
    model_free: dict[str, float]
    missing: Trace | None
    before: tuple[Test, ...]
    after: tuple[Test, ...]
    scale: float


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
        self.warnings: list[str] = []
        self.without = without
        self.about_cause = False  # whether the error of the step is that of a cause's motion, not of the drawing's
        self.tell("building the library of effects")
        self.known = library(study.mechanism, SMOOTH, study.tolerances, without, driven)
        self.refinements = FINER if step_s is None else 0
        step = step_s or default_step(study, build(study.mechanism))
        self.subject = prepare(study, self.known, step, kept=kept)
        self.search = Search(self.subject, self.tell, self.cancelled)

    def tell(self, words: str) -> None:
        """One more piece of work begins."""
        self.progress(min(self.done / self.planned, 0.99), words)
        self.done += 1

    def conclude(self) -> Diagnosis:
        """All steps."""
        self.tell("fitting the drawing as it is")
        baseline = self.search.baseline()
        while self.refinements and (error := step_error(self.subject, baseline)) > STEP_ERROR:
            self.refinements -= 1
            coarse = self.subject, self.search, baseline
            baseline = self.begin_again("with half the step", 0.5)
            if step_error(self.subject, baseline) > 0.5 * error:  # it is not the step's
                (self.subject, self.search, baseline), self.refinements = coarse, 0
        while True:
            loudness = np.linalg.norm(library_slopes(baseline.fitted), axis=0)
            self.subject.library = heard(self.subject.library, loudness)
            about = self.search.screen(baseline)
            latent = self.search.latent
            at_base = adequacy(baseline.fitted, latent, self.rng)
            whole = baseline.fitted.fraction == 1.0
            self.scale = max(1.0, at_base.noise if whole and at_base.noise < 1.5 else 1.0)
            p = self.p_gap(about, at_base)
            model_free = place_evidence(baseline.fitted, latent, self.scale)
            first = self.held_out(baseline)
            if p > UNUSUAL and whole:
                return self.report(
                    "none", baseline, baseline, False, about, latent, at_base, p, model_free, first, first
                )
            singles = self.shaped(self.search.level([baseline], REFITS))
            if (again := self.step_about_cause(baseline, singles)) is None:
                break
            baseline = again
        if p > CLEAR and baseline.fitted.fraction == 1.0 and self.doubtful(baseline, singles):
            return self.report("none", baseline, baseline, False, about, latent, at_base, p, model_free, first, first)
        climb = Climb(self.search, baseline, at_base, self.scale, self.tolerance_m, self.study, self.rng, self.without)
        best, last = climb.confirmed(*climb.plain(*climb.switching(*climb.smooth(singles))))
        self.scale = climb.scale
        return self.judge(baseline, best, last, about, latent, at_base, p, model_free, first, climb)

    def shaped(self, singles: list[Cause]) -> list[Cause]:
        """Single causes, the likeliest with what of its shape is freed late, and so others of its kind that could come
        up with it so; as they are where the likeliest leaves no more than noise.
        """
        if not singles:
            return singles
        leader = max(singles, key=lambda c: (c.fitted.fraction, c.log_z))
        rows = leader.fitted.r.size
        if leader.fitted.fraction == 1.0 and leader.fitted.chi2 < rows + CHANCE * np.sqrt(2.0 * rows):
            return singles
        better = closer(self.search, leader)
        found = {c.names: c for c in (better, *coming_up(self.search, leader, better, singles))}
        return [found.get(c.names, c) for c in singles]

    def begin_again(self, how: str, step: float, errors: Sequence[np.ndarray] = ()) -> Cause:
        """The drawing fitted anew, with this share of the step and these errors of it put back."""
        self.tell(f"fitting the drawing as it is, {how}")
        ended = {c.fitted.choice.name: c.fitted.x for c in self.search.tried.values() if c.fitted.fraction == 1.0}
        self.subject = prepare(self.study, self.known, step * self.subject.step_s, kept=self.subject.kept)
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
            if not self.refinements or off < ROUGH:
                return None
            self.refinements -= 1
            return self.begin_again("with half the step", 0.5)
        if self.about_cause:
            return None
        self.about_cause = True
        how = f"with the error of the step about {' + '.join(leader.names)}"
        return self.begin_again(how, 1.0, orderly(errors))

    def doubtful(self, baseline: Cause, causes: list[Cause]) -> bool:
        """Whether nothing amiss is likelier than all named causes together, and no unknown law beyond doubt, though a
        test found the data unusual.
        """
        z = unknown_about(baseline.fitted, self.search.latent, self.search.raw).log_z(self.scale)
        count = len(self.subject.library.candidates)
        belief = weigh(baseline, causes, count, scale=self.scale, unknown_log_z=log_mean(list(z.values())))
        return belief.unknown < DOUBT and belief.none > np.sum(belief.probability)

    def p_gap(self, about: Screen, at_base: Adequacy) -> float:
        """Of the omnibus tests and the largest gain in the library, Bonferroni."""
        directed = about.rescaled(self.scale).p_value(self.subject.library.candidates, self.rng)
        return min(1.0, 2.0 * min(at_base.p, directed))

    def held_out(self, cause: Cause) -> tuple[Test, ...]:
        """Tests on the held-out experiments, under values frozen."""
        self.tell("testing on held-out experiments")
        return tuple(held_out_tests(cause.fitted, self.scale))

    def judge(
        self, baseline, best: Cause, last: Adequacy, about, latent, at_base, p, model_free, first, climb: Climb
    ) -> Diagnosis:
        """The verdict, from adequacy here and on the held-out experiments."""
        after = self.held_out(best)
        shrunk = shrinkage(first, after, self.rng) if first else None
        enough = climb.enough(last)
        fits = enough or climb.slight(best, last)
        left, drawn = self.search.left(best, self.scale), self.search.left(baseline, self.scale)
        if left is not None and drawn is not None:
            self.tell(f"on held-out experiments {left.excess:.3g} of the noise's power is left, p {left.p:.2g}")
            slight = left.excess < form(best) ** 2 * np.clip(drawn.excess, 0.0, WIDE)
            fits = fits and (left.p > STRICT or slight or (shrunk is not None and self.tolerated(shrunk)))
        if shrunk is not None and shrunk.explained is not None:
            removed = shrunk.explained
        else:
            removed = 1.0 - last.power / max(gap_power(baseline.fitted, best.fitted, at_base.power), 1e-12)
        complete = best.fitted.fraction == 1.0
        fits = fits and len(best.candidates) <= SURE and not (climb.large or climb.names_a_remainder(best, enough))
        nearly = removed >= (OF_MANY if self.of_many(baseline, best) else MOST_OF_IT) and complete
        verdict = "identified" if fits and complete else "approximate" if nearly else "unknown"
        if verdict == "unknown" and p > CLEAR and baseline.fitted.fraction == best.fitted.fraction == 1.0:
            tried = [c for c in self.search.tried.values() if c.candidates and c.fitted.fraction == 1.0]
            if self.doubtful(baseline, tried):
                verdict, best, enough, after = "none", baseline, False, first
        return self.report(verdict, baseline, best, enough, about, latent, at_base, p, model_free, first, after)

    def of_many(self, baseline: Cause, best: Cause) -> bool:
        """Whether three effects and more are needed, none of which explains most of the gap alone."""
        alone = (self.search.tried.get((c.name,)) for c in best.candidates)
        whole = [c.fitted for c in alone if c is not None and c.fitted.fraction == 1.0]
        shares = (fitted_share(self.subject, baseline.fitted, fitted, self.scale) for fitted in whole)
        return len(best.candidates) > SURE and max(shares, default=0.0) < MOST_OF_IT

    def tolerated(self, shrunk: Shrinkage) -> bool:
        """What is left on held-out experiments is smaller than the user minds."""
        return self.tolerance_m is not None and shrunk.excess_upper < self.tolerance_m

    def report(
        self, verdict, baseline: Cause, best: Cause, enough: bool, about: Screen, latent: Latent, at_base, p,
        model_free, first, after,
    ) -> Diagnosis:  # fmt: skip
        """Probabilities, pictures' material and the report."""
        self.tell("weighing the explanations")
        exact = verdict == "none" or (verdict == "identified" and enough)
        soft = 1.0 if exact else softness(scaled(best.fitted, self.scale))
        causes = [c for c in self.search.tried.values() if c.candidates and c.fitted.fraction == best.fitted.fraction]
        same = baseline if baseline.fitted.fraction == best.fitted.fraction else None
        count = len(self.subject.library.candidates)
        law = None
        if best.candidates:
            about_causes = [self.unknown_about(c) for c in (best, *self.on_the_way(best, exact))]
            weighed_about = [(u, u.log_z(self.scale / np.sqrt(soft))) for u in about_causes]
            law, model_free = max(weighed_about, key=lambda pair: log_mean(list(pair[1].values())))
        unknown = log_mean(list(model_free.values())) if model_free else None
        if unknown is not None and exact and best.candidates:
            unknown -= overpromise(best, causes, self.scale)
        weighed = partial(
            weigh, same, causes, count, scale=self.scale, softness=soft, unknown_log_z=unknown,
            one_motion=one_motion(causes) if best.candidates else (),
        )  # fmt: skip
        belief = weighed()
        if exact and best.candidates:  # where no form is right, held-out experiments judge by what all of them lack
            near = [c for c, z in zip(belief.causes, belief.log_z, strict=True) if z > belief.log_z[0] - NEAR][:CLOSE]
            foretold = {c.names: self.search.foretold(c, self.scale) for c in near}
            belief = weighed(foretold=foretold)
        shrunk = shrinkage(first, after, self.rng) if first else None
        explained = None if shrunk is None else shrunk.explained
        nearly_all = explained is not None and explained > NEARLY_ALL
        doubtful = verdict == "identified" or (verdict == "approximate" and not nearly_all)
        if belief.unknown > DOUBT and verdict == "identified" and not enough:
            # The form is a little wrong, so that laws of any form follow what is left better.
            verdict = "approximate" if explained is None or explained >= MOST_OF_IT else "unknown"
        elif doubtful and belief.unknown > (LIKELIER if exact else DOUBT):
            verdict = "unknown"
        if verdict == "identified" and (len(belief.reported) > 1 or belief.unknown > max(belief.probability)):
            verdict = "ambiguous"
        free = shares(model_free)
        if law is not None and verdict != "none" and belief.unknown > DOUBTED:
            free = self.whereabouts(law, model_free)
        missing = None if verdict == "none" else self.trace(verdict, baseline.fitted, latent, belief, free)
        also: dict[tuple[str, ...], list[list[str]]] = {}
        fitted = {c.names: c for c in causes}
        if verdict != "none":
            for i in belief.reported:
                cause = belief.causes[i]
                if cause.fitted.subject is self.subject:
                    also[cause.names] = aliases(
                        about, cause, self.subject.library.candidates, fitted, self.scale / np.sqrt(soft)
                    )
        following = None
        if verdict != "none":
            self.tell("choosing the next experiment")
            unknown_at = locations(belief, free)[0].at if verdict == "unknown" and free else ""
            following = next_experiment(self.subject, belief, self.scale / np.sqrt(soft), unknown_at)
        guessed = told(self.study.mechanism, best.fitted.choice.parameters)
        said, spent_s = [*guessed, *self.warnings_of(verdict, shrunk)], time.perf_counter() - self.began
        made = make_report(
            verdict, self.subject, baseline, best, enough, belief, about, also, free, missing, shrunk, self.scale, soft,
            p, following, said, self.tolerance_m, spent_s, fitted,
        )  # fmt: skip
        self.progress(1.0, "done")
        return Diagnosis(
            made, self.subject, baseline, best, belief, free, missing, tuple(first), tuple(after), self.scale
        )

    def trace(
        self, verdict: str, drawn: Fitted, latent: Latent, belief: Belief, free: Mapping[str, float]
    ) -> Trace | None:
        """What the drawing misses against time: where a cause is named at a joint, a force there, because in a linkage
        of one freedom a force at any joint does nearly the same; where something unknown lies in the world, a motion of
        the base.
        """
        named = locations(belief, free)[0].at if belief.causes or free else ""
        if named == WORLD and verdict == "unknown":
            moved = base_response(self.subject, drawn)
            if moved.any():
                return missing_motion(self.subject, drawn, moved, self.scale)
        if not latent.forces:
            return None
        at = named if named in latent.forces else max(latent.forces, key=lambda place: free.get(place, 0.0))
        return missing_force(self.subject, drawn, latent, at, self.scale)

    def unknown_about(self, cause: Cause) -> Unknown:
        """Laws of unknown form, to first order about a cause's motion."""
        subject, raw = cause.fitted.subject, forces(cause.fitted.subject, cause.fitted, SAME)
        return unknown_about(cause.fitted, responses(subject, cause.fitted, raw), raw)

    def whereabouts(self, unknown: Unknown, log_z: Mapping[str, float]) -> dict[str, float]:
        """How probably what is unknown lies at each place, among them a base that moves, in units of what the place
        that explains most leaves: a named cause far off would blur them all.
        """
        fitted = unknown.fitted
        likeliest = sorted((at for at in log_z if at.startswith("joint:")), key=lambda at: -log_z[at])[:JOINTS]
        joints = [at.partition(":")[2] for at in likeliest]
        finer = unknown.finer(finer_responses(fitted.subject, fitted, joints))
        return shares(finer.log_z(self.scale / np.sqrt(finer.softness())))

    def on_the_way(self, best: Cause, exact: bool) -> list[Cause]:
        """Smaller sets on the way to one that does not fit: where several effects at once imitate something, what they
        do together is far from linear, and a law of unknown form may be told from them about fewer of them only.
        """
        parts = [
            c for c in self.search.tried.values()
            if c.candidates and set(c.names) < set(best.names) and c.fitted.fraction == best.fitted.fraction
            and c.fitted.subject is best.fitted.subject
        ]  # fmt: skip
        return [] if exact or len(best.candidates) <= SURE else sorted(parts, key=lambda c: -c.log_z)[:ON_THE_WAY]

    def warnings_of(self, verdict: str, shrunk: Shrinkage | None) -> list[str]:
        """What cannot be concluded from this study, and why."""
        said = list(self.warnings)
        if shrunk is None and self.subject.held_out:
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
        if len(self.subject.fit) == 1:
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
