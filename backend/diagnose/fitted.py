"""A choice of causes fitted to a study: values, what is left over, and how probable the data are under it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import logsumexp
from scipy.stats import norm

from backend.diagnose.independent import independent_of
from backend.diagnose.kept import name_of
from backend.diagnose.library import RUBBING
from backend.diagnose.probe import Probe
from backend.diagnose.seer import Seer
from backend.diagnose.settled import aside
from backend.diagnose.subject import ALIKE, Choice, Subject
from backend.fit.solve import LeastSquares, Solution, solve

GAIN = 0.1  # in log evidence, by as much of it as counts where the form is wrong: a step that brings less is the last
AT_BOUND = 1e-6  # of a number's natural size
UNSETTLED = 1e-3  # p of how far frames before the release lie aside
COARSE = 0.02  # of what is left: once a step gains less, a fit is seen through unless it is far behind another
CHANCE = 3.0  # sd by which noise alone may exceed its mean square
BEHIND = 4.0  # times what another leaves: so far behind it
LARGE = 4.0  # noise variances a sample, left by a fit: beyond, first order holds for a while only
LONGER = (4, 2)  # steps that one may stand for where a fit leaves as much
ERRING = 0.01  # of what a fit leaves, in squares: error of longer steps, put back, beyond which they are not taken
REFUSALS = 5  # in a row: where friction sticks, a slope promises what no step brings
RUBBED = 6  # iterations at most where walls rub: each costs as many motions as there are numbers, twice


@dataclass(frozen=True)
class Fitted:
    """x: values of the choice's parameters, then each run's start. r = whitened (measured - predicted) and
    J = d(predicted): data rows alone, run by run as `rows` says; precision: prior of x. probes: as far as was fitted.
    held: what the data press against a bound.
    """

    subject: Subject
    choice: Choice
    probes: tuple[Probe, ...]
    x: Float[np.ndarray, " x"]
    r: Float[np.ndarray, " n"]
    J: Float[np.ndarray, "n x"]
    rows: tuple[slice, ...]
    precision: Float[np.ndarray, " x"]
    held: Bool[np.ndarray, " x"]
    status: str
    fraction: float
    miss: float
    """Rms of (measured - predicted) in radians or mechanism lengths, outliers left out."""
    log_width: float = 0.0
    """What it costs in log evidence that frames before the release may lie off."""

    @cached_property
    def whole(self) -> tuple[Probe, ...]:
        """The experiments to their ends."""
        return tuple(self.subject.chosen(p, self.choice) for p in self.subject.fit)

    @cached_property
    def rough(self) -> tuple[Probe, ...]:
        """As far as was fitted, in steps that slopes about the motion need."""
        if self.subject.coarse == 1:
            return self.probes
        return tuple(self.subject.chosen(p, self.choice).first(self.fraction) for p in self.subject.rough)

    @cached_property
    def longer(self) -> Subject | None:
        """The experiments in longer steps, with their error about this motion put back, where what it leaves is far
        beyond noise and that error: what joins it is fitted in these, until it leads. None elsewhere.
        """
        if self.fraction < 1.0 or not self.chi2 > LARGE * self.r.size:
            return None
        subject, every = self.subject, range(len(self.subject.fit))
        if any(p.loose for p in subject.fit):
            return None
        white = Seer(subject, self.probes).white
        own = self.whole if self.in_longer_steps else self.probes
        fine = subject.over(lambda i: own[i].predict(self.values, self.own(i))[0], every)
        for times in LONGER:
            plain = subject.put_right(times * subject.coarse, [np.zeros(p.data.time_s.size) for p in subject.fit])
            moved = [subject.chosen(p, self.choice) for p in plain.fit]
            seen = subject.over(lambda i, moved=moved: moved[i].seen(self.values, self.own(i)), every)
            errors = [one - other for one, other in zip(fine, seen, strict=True)]
            if sum(float(np.sum(w(e) ** 2)) for w, e in zip(white, errors, strict=True)) < ERRING * self.chi2:
                return subject.put_right(times * subject.coarse, [np.nan_to_num(e) for e in errors])
        return None

    def slope_probes(self, within: float) -> tuple[Sequence[Probe], str]:
        """Experiments for slopes about this motion that hold for others which lie within this share, and in which steps
        they go: longer ones tell slopes that are to first order only as well.
        """
        if within < ALIKE or self.longer is None:
            return self.rough, ""
        return [self.longer.chosen(p, self.choice) for p in self.longer.fit], " in longer steps"

    @property
    def in_longer_steps(self) -> bool:
        """Whether it was fitted in longer steps than its subject's."""
        return self.probes[0].step_s > self.subject.step_s

    @property
    def count(self) -> int:
        """Number of the choice's parameters."""
        return len(self.choice.parameters)

    @property
    def values(self) -> np.ndarray:
        """Of the choice's parameters."""
        return self.x[: self.count]

    @property
    def gliding(self) -> np.ndarray:
        """The same with loose pins that do not rub: exact slopes about such a motion stay bounded."""
        rubs = np.array([p.parameter == RUBBING for p in self.choice.parameters], bool) & self.choice.rubs
        return np.where(rubs, 0.0, self.values)

    def own(self, run: int) -> np.ndarray:
        """The start of one run."""
        ends = self.count + np.cumsum([0, *[p.unknowns for p in self.probes]])
        return self.x[ends[run] : ends[run + 1]]

    @property
    def information(self) -> np.ndarray:
        """J'J and the prior."""
        return self.J.T @ self.J + np.diag(self.precision)

    @property
    def free(self) -> Float[np.ndarray, "n x"]:
        """J of what may still move: a number that is held at its bound takes nothing off what is left."""
        return np.where(self.held, 0.0, self.J)

    @property
    def plain(self) -> Bool[np.ndarray, " own"]:
        """Numbers of a shape that the data press to nothing, as of friction that gives not at all before it slides."""
        own = slice(self.choice.own)
        from_nothing = np.array([p.lower == 0.0 for p in self.choice.parameters], bool)[own]
        nothing = self.values[own] < AT_BOUND * self.choice.prior_sd[own]
        return self.held[own] & ~self.choice.sizes & from_nothing & nothing

    @property
    def pressed(self) -> bool:
        """Whether the data ask what is there for more than its range: something else may be beside it."""
        own = slice(self.choice.own)
        return bool(np.any(self.held[own] & ~self.plain & (self.values[own] != self.choice.start[own])))

    @property
    def covariance(self) -> np.ndarray:
        """Of x, for noise alone."""
        return np.linalg.pinv(self.information, hermitian=True)

    @property
    def chi2(self) -> float:
        """Sum of squares of the data rows."""
        return float(self.r @ self.r)

    @property
    def strain(self) -> float:
        """What the tolerances pay for where they are: the sum of squares of their shifts, in their own sds."""
        shift = (self.values - self.choice.start) / self.choice.prior_sd
        return float(np.sum(shift[self.choice.own :] ** 2))

    @property
    def unsettled(self) -> bool:
        """Whether frames before the release lie aside by more than noise, or what is missed after it, lets them."""
        white = Seer(self.subject, self.probes, self.fraction).white
        still = [p.data.still[w.keep] for p, w in zip(self.probes, white, strict=True)]
        channel = [p.data.channel[w.keep] for p, w in zip(self.probes, white, strict=True)]
        return aside([self.r[rows] for rows in self.rows], still, channel) < UNSETTLED

    @property
    def rms(self) -> float:
        """Of the data rows, in sigmas."""
        return float(np.sqrt(np.mean(self.r**2)))


def start_of(subject: Subject, choice: Choice, known: Mapping[str, float] | None = None) -> np.ndarray:
    """Where a search begins: as drawn, or where something else left off (by name)."""
    values = [(known or {}).get(p.name, p.start) for p in choice.parameters]
    return np.concatenate([values, *[p.start for p in subject.fit]])


def fit(
    subject: Subject,
    choice: Choice,
    *,
    start: Float[np.ndarray, " x"] | None = None,
    fractions: Sequence[float] = (1.0,),
    max_iterations: int = 12,
    cancelled: Callable[[], bool] | None = None,
    ahead: float | None = None,
    coarse: bool = False,
) -> Fitted:
    """Most probable values under the prior, over growing shares of the records.

    ahead: sum of squares that another fit leaves of as much; one that stays far behind it ends early. coarse: so does
    any, as one that only leads on to longer records.
    """
    x = start_of(subject, choice) if start is None else start
    max_iterations = min(max_iterations, RUBBED) if choice.rubs else max_iterations
    for fraction in fractions:
        made = _fit(subject, choice, x, fraction, max_iterations, cancelled, ahead, coarse)
        x = made.x
    return made


def _fit(subject, choice: Choice, x, fraction, max_iterations, cancelled, ahead, coarse) -> Fitted:
    probes = [subject.chosen(p, choice).first(fraction) for p in subject.fit]
    seer = Seer(subject, probes, fraction)
    few = len(choice.parameters)
    begin = choice.start
    bounds = [p.bounds() for p in probes]
    lower = np.concatenate([[p.lower for p in choice.parameters], *[b[0] for b in bounds]])
    upper = np.concatenate([[p.upper for p in choice.parameters], *[b[1] for b in bounds]])
    scale = np.concatenate([choice.prior_sd, *[np.ones(p.unknowns) for p in probes]])
    weight = np.eye(few, x.size) / choice.prior_sd[:, None]
    last: dict[str, np.ndarray] = {}

    def residual(x: np.ndarray):
        return np.concatenate([-seer.left(x), (x[:few] - begin) / choice.prior_sd]) if choice.rubs else linearise(x)[0]

    def linearise(x: np.ndarray):
        if last.get("x") is None or not np.array_equal(last["x"], x):
            r, J = seer(x)
            J = seer.across(x, J, choice.prior_sd, lower, upper) if choice.rubs else J
            last.update(
                x=x.copy(),
                r=np.concatenate([-r, (x[:few] - begin) / choice.prior_sd]),
                J=np.concatenate([J, weight]),
            )
        return last["r"], last["J"]

    names = [p.name for p in choice.parameters] + [f"start {i}" for i in range(x.size - few)]
    what = f"{subject.library.family}|{choice.name}|{max_iterations}"
    numbers = [fraction, subject.step_s, choice.settled_m, ahead or 0.0, float(coarse), *choice.prior_sd, *x]
    key = subject.kept.asked(name_of(what, numbers))
    known = subject.kept.end_of(key)
    if known is None:
        problem = LeastSquares(names, residual, linearise, lower, upper, scale, seer.count)

        def solved(x: np.ndarray, iterations: int, ftol: float) -> Solution:
            return solve(problem, x, max_iterations=iterations, ftol=ftol, refusals=REFUSALS, cancelled=cancelled)

        solution = solved(x, max_iterations, COARSE)
        missed, rest = solution.residual[: seer.count], max_iterations - len(solution.history) + 1
        early = coarse or (ahead is not None and missed @ missed > BEHIND * ahead)
        if solution.status == "converged" and rest > 0 and not early:
            solution = solved(solution.x, rest, 2.0 * GAIN / max(independent_of(missed, seer.rows), 1.0))
        known, full, slopes = (solution.x, solution.status), solution.residual, solution.jacobian
        if not (cancelled is not None and cancelled()):
            subject.kept.note(key, *known)
    else:
        full, slopes = linearise(known[0])
    end, status = known
    r, J = -full[: seer.count], slopes[: seer.count]
    precision = np.concatenate([choice.prior_sd**-2.0, np.zeros(x.size - few)])
    pull = J.T @ r
    pull[:few] -= precision[:few] * (end[:few] - begin)
    room = AT_BOUND * scale
    held = ((end - lower < room) & (pull < 0.0)) | ((upper - end < room) & (pull > 0.0))
    return Fitted(
        subject, choice, tuple(probes), end, r, J, seer.rows, precision, held, status, fraction, seer.miss(end),
        sum(w.log_width for w in seer.white),
    )  # fmt: skip


def as_noise(fitted: Fitted, scale: float = 1.0) -> bool:
    """Whether a fit leaves no more than noise may. scale: of all sigmas."""
    rows = fitted.r.size
    return fitted.chi2 < scale**2 * (rows + CHANCE * float(np.sqrt(2.0 * rows)))


def mean_square(fitted: Fitted, fraction: float) -> float:
    """What a fit leaves of the first fraction of its records, in variances of the noise; infinite where it is lost."""
    r, _ = Seer(fitted.subject, [p.first(fraction) for p in fitted.probes], fraction)(fitted.x)
    return float(np.nan_to_num(np.mean(r**2), nan=np.inf))


START_SD = 10.0  # rad or mechanism lengths, and the same for rates: what any start may lie off
PLAIN = 0.5  # belief that a number of a shape that may be nothing is
SHARES = 10.0 ** np.linspace(-3.0, 0.5, 8)  # of what an effect's file expects: nobody knows the size of a flaw


def log_evidence(fitted: Fitted) -> float:
    """Laplace approximation, up to a constant that all choices for the same rows share.

    The sd of a size before any data is any of `SHARES` of what the effect's file expects, each as likely: one for each
    of two effects, a common one for more. A number that cannot be negative has twice the density on half of the line.
    Of one of a shape that may be nothing, as how far friction gives before it slides, half of the belief is that it is.
    What slopes still promise where the fit ended counts for nothing: where friction sticks, no step brings it.
    """
    few, own = fitted.count, fitted.choice.own
    plain = np.zeros(fitted.x.size, bool)
    plain[:own] = fitted.plain
    shift = np.where(plain[:few], 0.0, fitted.values - fitted.choice.start)
    J = np.where(plain, 0.0, fitted.J)
    JJ, Jr, chi2 = J.T @ J, J.T @ fitted.r, fitted.chi2
    starts = np.full(fitted.x.size - few, START_SD**-2.0)

    def towards_best(sd: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """(information, step, fall of the cost) under a prior of such deviations."""
        H, b = JJ + np.diag(np.concatenate([sd**-2.0, starts])), Jr.copy()
        b[:few] -= shift * sd**-2.0
        step = np.linalg.lstsq(H, b, rcond=1e-14)[0]
        return H, step, float(b @ step)

    promised = towards_best(fitted.choice.prior_sd)[2]
    members = [len(c.parameters) for c in fitted.choice.candidates]
    apart = len(members) <= 2
    found = []
    for share in product(SHARES, repeat=len(members) if apart else 1):
        sd = fitted.choice.prior_sd.copy()
        sd[:own] *= np.where(fitted.choice.sizes, np.repeat(share, members) if apart else share[0], 1.0)
        H, step, fall = towards_best(sd)
        cost = chi2 + float(np.sum((shift / sd) ** 2)) - max(fall - promised, 0.0)
        z = -0.5 * cost - float(np.sum(np.log(sd))) - 0.5 * float(np.linalg.slogdet(H)[1])
        wide = np.sqrt(np.maximum(np.diag(np.linalg.pinv(H, hermitian=True))[:few], 1e-300))
        for i, p in enumerate(fitted.choice.parameters):
            if p.lower >= p.start:
                z += float(norm.logcdf((shift[i] + step[i]) / wide[i]) + np.log(2.0))
        found.append(z)
    known = plain.sum() * np.log(PLAIN) - fitted.log_width
    return float(logsumexp(found) - np.log(len(found)) + known)
