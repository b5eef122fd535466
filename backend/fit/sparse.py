"""A fit in which most places share a value: shared by all at first, then by all but those that stand out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from backend.fit.alike import Alike, tied
from backend.fit.deviants import Deviants, deviants, projected
from backend.fit.identifiability import Uncertainty
from backend.fit.residual import Residuals
from backend.fit.run import Run
from backend.fit.search import Search
from backend.fit.secant import MOST, secants
from backend.fit.solve import Solution
from backend.mechanism.fit_report import Deviation

SHARES = (0.0, 0.25, 0.5, 1.0)  # of the way to what was named: where the fit goes on from is the best of them
KEPT = 0.5  # of what a name brings, that another place must lose to be ruled out
ROUNDS = 6  # of naming and fitting; names that still change then are said to


@dataclass
class Sparse:
    """The same experiments with every value free (`full`) and with groups tied but for those apart (`few`)."""

    full: Residuals
    groups: Sequence[Alike]
    few: Residuals = field(init=False)
    matrix: Float[np.ndarray, "all few"] = field(init=False)
    named: Deviants | None = None
    settled: bool = True

    def __post_init__(self):
        self.tie(())

    def tie(self, apart: Sequence[int]) -> None:
        """Give these parameters values of their own, and all others of their groups a shared one."""
        few, self.matrix = tied(self.full.parameters, self.groups, apart)
        first = np.argmax(self.matrix, axis=0)
        runs = [run.tied(self.matrix) for run in self.full.runs]
        self.few = Residuals(few, self.full.scale[first], runs, way=self.full.way, profiles=self.full.profiles)

    def seek(self, search: Search, solution: Solution) -> Solution:
        """From the fit of shared values, name what deviates and fit again, until the names stay. A fit that ended
        before it converged is named by, too: what deviates may be why.
        """
        apart, abandoned = (), set[tuple[int, ...]]()
        for _ in range(ROUNDS):
            if solution.status == "cancelled":
                self.settled = False
                return solution
            if self.full.strikes:
                solution = search.over_distance(solution)
                search.pace.step("slopes of each place over half its value")
            self.named = self._name(solution, apart)
            if self.named.apart in abandoned:  # where a linear estimate would lead back to
                self.named = replace(self.named, apart=apart, instead=dict.fromkeys(apart, ()))
            if self.named.apart == apart and self.full.strikes:
                search.pace.step("what is named, tried at every other place")
                self.named = self._tried(self._full(solution.x), self.named)
                abandoned |= {apart} - {self.named.apart}
            self.settled = self.named.apart == apart
            if self.settled:
                return solution
            apart = self.named.apart
            begins = list(self._begins(solution.x))
            history = [self._full(step.parameters) for step in search.history]
            spread, memory = self.few.spread, self.few.memory
            self.tie(apart)
            self.few.spread, self.few.memory = spread, memory
            search.residuals = self.few
            search.history[:] = [
                replace(step, parameters=self._few(x)) for step, x in zip(search.history, history, strict=True)
            ]
            begin = min((self._few(x) for x in begins), key=self._objective)
            solution = search.at_full_length(begin, "fitting what deviates")
        return solution

    def _tried(self, x: np.ndarray, named: Deviants) -> Deviants:
        """The names after each was tried at every other place of its group, with the value that it has: a linear
        estimate cannot tell neighbours apart where parts strike. A place that explains the data better takes the name;
        one that keeps more than half of what the name brings could be it, too.
        """
        candidates, instead = self._candidates(), dict(named.instead)
        here = self._left(x)
        for i in named.apart:
            without = x.copy()
            without[i] = x[self._mate(i)]
            brought = self._left(without) - here
            places = [j for g in self.groups if i in g.members for j in g.members if j not in named.apart]
            moved = {j: np.where(np.arange(x.size) == j, x[i], without) for j in places}
            lost = {j: self._left(moved[j]) - here for j in places}
            best = min(places, key=lambda j: lost[j])
            if lost[best] < 0.0:
                apart = tuple(sorted(best if k == i else k for k in named.apart))
                return replace(named, apart=apart, instead=dict.fromkeys(apart, ()), values=moved[best][candidates])
            near = {candidates.index(j) for j in places if lost[j] < KEPT * brought}
            instead[i] = tuple(sorted(near.union(instead[i])))
        return replace(named, instead=instead)

    def _left(self, x: np.ndarray) -> float:
        """Sum of squares, every place with its own value."""
        r = self.full.residual(x)
        return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def _begins(self, x: np.ndarray) -> Iterator[np.ndarray]:
        """All values where they are, and on the way to where what was named would take them."""
        here = self._full(x)
        there, problem = here.copy(), self.full.problem()
        if self.named is not None:
            there[self._candidates()] = self.named.values
        for share in SHARES:
            yield np.clip(here + share * (there - here), problem.lower, problem.upper)

    def _objective(self, x: np.ndarray) -> float:
        r = self.few.residual(x)
        return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def run(self, run: Run) -> Run:
        """An experiment that was not fitted, tied alike."""
        return run.tied(self.matrix)

    def deviations(self, solution: Solution, u: Uncertainty) -> Iterator[Deviation]:
        """What deviates, by how much from the value that the others share, and where else it could be."""
        if self.named is None:
            return
        places, candidates = self.full.parameters, self._candidates()
        for i in self.named.apart:
            j, k = self._column(i), self._column(self._mate(i))
            variance = u.covariance[j, j] + u.covariance[k, k] - 2.0 * u.covariance[j, k]
            known = not (u.unidentified[j] or u.unidentified[k])
            yield Deviation(
                name=self.few.names[j], others=self.few.names[k], difference=float(solution.x[j] - solution.x[k]),
                sd=float(np.sqrt(variance)) if known else None, unit=places[i].unit,
                could_be=tuple(places[candidates[c]].on[0] for c in self.named.instead[i]),
            )  # fmt: skip

    def sentences(self, solution: Solution) -> Iterator[str]:
        """What a reader should know of the search for deviations besides what it found."""
        if self.named is None:
            return
        if not self.settled:
            yield f"Which values deviate still changed after {ROUNDS} rounds: take the names as candidates."
        candidates = self._candidates()
        for group in self.groups:
            rest = [i for i in group.members if i not in self.named.apart]
            shared = abs(float(solution.x[self._column(rest[0])]))
            least = {i: self.named.least[candidates.index(i)] for i in rest}
            doubted = {candidates[c] for instead in self.named.instead.values() for c in instead}
            unseen = [i for i in rest if not least[i] < 10.0 * shared and i not in doubted]
            blind = [self.full.parameters[i].on[0] for i in unseen]
            if blind:
                yield (
                    f"A {self.full.parameters[rest[0]].parameter} ten times that of the others would not show at "
                    f"{', '.join(blind)}: these data cannot tell whether it deviates there."
                )

    def _name(self, solution: Solution, apart: Sequence[int]) -> Deviants:
        self.full.spread, self.full.memory = self.few.spread, self.few.memory
        x, candidates = self._full(solution.x), self._candidates()
        places, own = len(self.full.parameters), range(len(self.few.parameters), solution.x.size)
        others = [*(self._column(i) for i in range(places) if i not in candidates), *own]
        root = np.sqrt(solution.weights)
        r, common = root * solution.residual, root[:, None] * solution.jacobian[:, others]
        each = root[:, None] * self._slopes(x, solution.residual)
        group = np.repeat(np.arange(len(self.groups)), [len(g.members) for g in self.groups])
        shared = np.array([float(solution.x[self._column(self._mate(i))]) for i in candidates])
        lower, upper = np.array([(self.full.parameters[i].lower, self.full.parameters[i].upper) for i in candidates]).T
        rows = self.full.rows()
        found = deviants(
            projected(
                r, each, group, common, x[candidates] - shared, x[candidates],
                (lower, upper), rows.run, rows.instant,
            ),
            1.0 / self.full.spread,
            [candidates.index(i) for i in apart],
        )  # fmt: skip
        instead = {candidates[c]: v for c, v in found.instead.items()}
        return replace(found, apart=tuple(candidates[c] for c in found.apart), instead=instead)

    def _slopes(self, x: np.ndarray, r: np.ndarray) -> Float[np.ndarray, "n c"]:
        """Of the residuals in each candidate; over half its value where parts may strike each other: a deviation that
        is worth naming is no smaller, and at a point they are rough.
        """
        candidates = self._candidates()
        if not self.full.strikes:
            return self.full.evaluate(x)[1][:, candidates]
        problem = replace(self.full.problem(), residual=self.full.residual)  # no derivatives beside it
        reach = MOST * np.where(x == 0.0, problem.scale, np.abs(x))
        return secants(problem, x, r, reach, candidates)[0]

    def _candidates(self) -> list[int]:
        return [i for group in self.groups for i in group.members]

    def _mate(self, i: int) -> int:
        """A parameter that holds the shared value of i's group."""
        group = next(g for g in self.groups if i in g.members)
        return max(group.members, key=lambda k: self.matrix[:, self._column(k)].sum())

    def _column(self, i: int) -> int:
        return int(np.argmax(self.matrix[i]))

    def _full(self, x: np.ndarray) -> np.ndarray:
        few = len(self.few.parameters)
        return np.concatenate([self.matrix @ x[:few], x[few:]])

    def _few(self, x: np.ndarray) -> np.ndarray:
        """Shared values are the median of what is tied."""
        p = len(self.full.parameters)
        return np.concatenate([[np.median(x[:p][column > 0]) for column in self.matrix.T], x[p:]])
