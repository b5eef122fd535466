"""The course of a fit: which part of the records is fitted when, in which weights, from which start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count

import numpy as np
from jaxtyping import Float

from backend.fit.checkpoint import Checkpoint
from backend.fit.loss import LossName
from backend.fit.pace import Pace
from backend.fit.residual import Residuals
from backend.fit.retrace import ON_THE_WAY, RETRACED, Part, astray, retrace, way_ahead
from backend.fit.secant import deviations, narrowed, smoothed
from backend.fit.solve import Iteration, LeastSquares, Optimiser, Solution, robust_weights, solve
from backend.fit.starts import at_once

FIRST_STEPS = 12  # spent on a part of the records at most: the whole of them decides
PART, WHOLE = 4.0, 10.0  # iterations that a part of the records, or the whole of them, usually takes
ROUND = 2.0  # iterations in whose time slopes are taken by differences, on every core at once
DISTANCE = 3.0 * ROUND  # until these settle
OVER_DISTANCE = "slopes over the distance that the data tell apart"
LOST, FOLLOWED = 0.12, 0.5  # rad or mechanism lengths, as a diagnosis has it; share of it that is still followed
BETWEEN, NEAREST = 6, 1.1  # parts more than asked at most; how much longer each is at least
REWEIGHED = 3  # times at most
SETTLED = 0.02  # change of the misfit that weighs the samples, beyond which they are fitted again


class Cancelled(Exception):
    """The fit is to end, in the midst of simulations that no solver asks for."""


class Search:
    """The stages of one fit, with one history; each is kept in the checkpoint as it goes.

    residuals may be replaced between stages.
    """

    def __init__(
        self, residuals: Residuals, optimiser: Optimiser, loss: LossName, max_iterations: int, kept: Checkpoint,
        pace: Pace, cancelled: Callable[[], bool] | None,
    ):  # fmt: skip
        self.residuals, self.max_iterations, self.kept = residuals, max_iterations, kept
        self.optimiser: Optimiser = optimiser
        self.loss: LossName = loss
        self.pace, self.cancelled = pace, cancelled
        self.history: list[Iteration] = []
        self.parts: list[tuple[float, np.ndarray]] = []  # of the records that were fitted last, and where each ended

    def from_starts(self, starts: Sequence[Float[np.ndarray, " x"]], horizons: Sequence[float]) -> Solution:
        """The likeliest end of the searches from several starts, and the weights that belong to it."""
        if len(starts) == 1:
            return self.through(starts[0], horizons)
        each = [self._beside(k) for k in range(len(starts))]
        ends = at_once([partial(search.through, x, horizons) for search, x in zip(each, starts, strict=True)])
        best = int(np.argmin([search._unlikelihood(end) for search, end in zip(each, ends, strict=True)]))
        self.residuals.spread, self.parts[:] = each[best].residuals.spread, each[best].parts
        self.history += [step for search in each for step in search.history]
        cut_off = next((end for end in ends if end.status == "cancelled"), None)
        return replace(ends[best], status="cancelled", message=cut_off.message) if cut_off else ends[best]

    def _beside(self, k: int) -> Search:
        """A search of its own, at the same time as others."""
        return Search(
            self.residuals.apart(), self.optimiser, self.loss, self.max_iterations, self.kept.branch(k), self.pace,
            self.cancelled,
        )  # fmt: skip

    def _unlikelihood(self, found: Solution) -> float:
        """The misfit divides what it weighs, so an objective alone says nothing of how large it was."""
        motion = self.residuals.rows().motion
        value = 0.5 * float(found.weights @ found.residual**2) + motion * np.log(self.residuals.spread)
        return value if np.isfinite(value) else np.inf

    def through(self, x: np.ndarray, horizons: Sequence[float], words: str = "fitting whole records") -> Solution:
        """Fit the first part of every record, then longer ones, then all."""
        ahead, done = [*horizons, 1.0], 0.0
        self.parts.clear()
        for _ in range(BETWEEN + len(horizons)):
            ahead = self._nearer(x, done, ahead)
            fraction = ahead.pop(0)
            if not ahead:
                break
            done = fraction
            self.pace.enter(PART)
            found = self.part(x, fraction, f"fitting the first {100 * fraction:.0f}%")
            if found.status == "cancelled":
                return self._reweighted(found)
            x = found.x if np.isfinite(found.objective) else x
            self.parts.append((fraction, x))
        return self.at_full_length(x, words)

    def retraced(self, found: Solution) -> Solution:
        """The better of this end and of the one that `retrace` leads to from the part fitted first, where whole
        records are missed by more than that.
        """
        if found.status == "cancelled" or not self.parts or np.any(found.weights != 1.0):
            return found
        missed, spread = self.residuals.misfit(found.x), self.residuals.spread
        fraction, end = self.parts[0]
        # Where values were set apart since that part was fitted, the end of the whole may explain it better.
        first = Part(fraction, min((end, found.x), key=lambda x: self.residuals.misfit(x, fraction)))
        if not astray(self.residuals, first, missed):
            return found

        def words(fraction: float) -> str:
            return f"following the first {100 * fraction:.0f}%"

        def tell(fraction: float) -> None:
            self.pace.enter(ROUND * ON_THE_WAY * fraction, words(fraction))

        def over(fraction: float) -> LeastSquares:
            return self.watched(self.residuals.alone(fraction), words(fraction), _half(found.x))

        self.pace.expect(ROUND * ON_THE_WAY * way_ahead(fraction))

        try:
            way = retrace(self.residuals, over, first, tell)
        except Cancelled:
            self.residuals.spread = spread
            return broken_off(found)
        if not way or not self.residuals.misfit(way[-1].x) < missed:
            self.residuals.spread = spread
            return found
        *before, end = way
        self.parts[:] = [(part.fraction, part.x) for part in before]
        self.residuals.learn_spread(end.x)
        return self._reweighted(replace(found, x=end.x, status="rough", message=RETRACED, roughness=end.roughness))

    def part(self, x: np.ndarray, fraction: float, words: str) -> Solution:
        """A few steps over the first part of every record; values of which it says nothing stay where they are."""
        return self._stage(x, fraction, words, FIRST_STEPS, 1e-3, anchor=x)

    def _nearer(self, x: np.ndarray, done: float, ahead: list[float]) -> list[float]:
        """The parts to fit next, the first one shorter where a motion that is followed so far is lost by its end:
        misfit from whole turns away leads into other minima.
        """
        if done and self.residuals.miss(x, done) < FOLLOWED * LOST:
            while ahead[0] > NEAREST**2 * done and self.residuals.miss(x, ahead[0]) > LOST:
                ahead = [float(np.sqrt(done * ahead[0])), *ahead]
        return ahead

    def at_full_length(self, x: np.ndarray, words: str = "fitting whole records") -> Solution:
        """Fit whole records until the misfit that weighs them stops changing."""
        found = None
        self.pace.enter(WHOLE)
        for ftol in (1e-3, 1e-6, 1e-6, 1e-6):
            found = self._stage(x, 1.0, words, self.max_iterations, ftol)
            x = found.x
            if found.status in ("cancelled", "not_finite_at_start"):
                break
            weighed = self.residuals.spread
            if abs(self.residuals.learn_spread(x) - weighed) < SETTLED * weighed and ftol < 1e-3:
                break
        return self._reweighted(found)

    def over_distance(self, solution: Solution) -> Solution:
        """Slopes over the distance that the data tell apart (see `secant`), and the end that they lead to, in weights
        that belong to it.
        """
        for _ in range(REWEIGHED):
            self.pace.enter(DISTANCE, OVER_DISTANCE)
            solution = self.smoothed(solution)
            if solution.status == "cancelled":
                break
            weighed = self.residuals.spread
            if abs(self.residuals.learn_spread(solution.x) - weighed) < SETTLED * weighed:
                self.residuals.spread = weighed
                break
            r, J = self.residuals.evaluate(solution.x)
            solution = replace(solution, residual=r, jacobian=J, objective=0.5 * float(r @ r))
        return solution

    def past_roughness(self, solution: Solution) -> Solution:
        """Where slopes over wide distances lead, then over narrow ones, in weights that belong to it."""
        self.pace.step("slopes over wide distances")
        try:
            solution = narrowed(self.watched(self.residuals.problem()), solution)
        except Cancelled:
            return broken_off(solution)
        self.residuals.learn_spread(solution.x)
        return self._reweighted(solution)

    def smoothed(self, solution: Solution) -> Solution:
        """As `secant.smoothed`, from what the first part of the records leaves open, over which a motion has hardly
        forked; as it was where the fit is cancelled meanwhile.
        """
        problem, at_first = self.watched(self.residuals.problem(), OVER_DISTANCE, _half(solution.x)), None
        if self.parts and self.residuals.strikes:
            J = self.residuals.evaluate(solution.x, self.parts[0][0])[1]
            at_first = deviations(problem, solution.x, J) if np.all(np.isfinite(J)) else None
        try:
            return smoothed(problem, solution, at_first)
        except Cancelled:
            return broken_off(solution)

    def heed(self) -> None:
        """Raise `Cancelled` where the fit is."""
        if self.cancelled is not None and self.cancelled():
            raise Cancelled

    def watched(self, problem: LeastSquares, words: str = "", half: float = 0.0) -> LeastSquares:
        """The same problem, whose simulations raise `Cancelled` once the fit is.

        half: simulations after which half of this piece of work is taken as done; each of them tells `words`.
        """
        done = count(1)

        def residual(x: np.ndarray) -> np.ndarray:
            self.heed()
            found = problem.residual(x)
            if half:
                number = next(done)
                self.pace.tell(number / (number + half), words)
            return found

        return replace(problem, residual=residual)

    def _reweighted(self, found: Solution | None) -> Solution:
        """The solution in the final weights, which differ by a few percent from those of its search."""
        if found is None:
            raise RuntimeError("no stage of the fit was run")
        r, J = self.residuals.evaluate(found.x)
        weights = robust_weights(self.loss, r, self.residuals.rows().motion)
        return replace(found, residual=r, jacobian=J, weights=weights)

    def _stage(
        self, x: np.ndarray, fraction: float, words: str, most: int, ftol: float, anchor: np.ndarray | None = None
    ) -> Solution:
        stage = self.kept.known() or self.kept.begin(self.residuals.learn_spread(x, fraction))
        self.residuals.spread = stage.spread
        self.history += stage.history
        if stage.end is not None:
            return stage.end
        done = len(stage.history)

        def advance(iteration: Iteration):
            if done and iteration.iteration == 0:
                return  # where the search was cut off; kept already
            step = stage.add(iteration)
            self.history.append(step)
            self.kept.write()
            self.pace.step(f"{words}, iteration {step.iteration}")

        found = solve(
            self.residuals.problem(fraction, anchor), stage.history[-1].parameters if done else x,
            optimiser=self.optimiser, loss=self.loss, max_iterations=max(most - max(done - 1, 0), 1), ftol=ftol,
            progress=advance, cancelled=self.cancelled,
        )  # fmt: skip
        if found.status != "cancelled":  # which may go on later
            stage.end = found
            self.kept.write()
        return found


def broken_off(solution: Solution) -> Solution:
    """The same end, of a fit that was to go on from there."""
    return replace(solution, status="cancelled", message="Cancelled while slopes over a distance were taken.")


def _half(x: np.ndarray) -> float:
    """Simulations after which half of the rounds are done that slopes by differences usually take to settle."""
    return 3.0 * x.size
