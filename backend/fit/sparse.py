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
from backend.fit.search import Cancelled, Search, broken_off
from backend.fit.secant import MOST, secants
from backend.fit.solve import Solution
from backend.fit.trial import SHARES, brought, trials
from backend.mechanism.fit_report import Deviation

KEPT = 0.5  # of what a name brings, that another place must lose to be ruled out
ASTRAY = 1.5  # sigmas rms, chi-square per sample 2.25: a fit that misses the data by more may have been led astray
HELPS = 0.25  # of what is missed beyond the noise, that a place found by trial must explain
FITTED = 4  # places that trials leave to be fitted
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

        Where the fit misses the data by far and slopes lead no further, a place is sought by trial.
        """
        apart, abandoned, hopeless = (), set[tuple[int, ...]](), set[tuple[int, ...]]()
        self.settled = False
        for _ in range(ROUNDS):
            if solution.status == "cancelled":
                self.settled = False
                return solution
            kept = solution, apart, self.named, self.few.spread
            try:
                if self.settled and apart not in hopeless and self._astray(solution.x):
                    hopeless.add(apart)
                    solution, apart = self._sought(search, solution, apart)
                    self.settled = apart == kept[1]
                if self.settled:
                    return solution
                if self.full.strikes:
                    solution = search.over_distance(solution)
                    search.pace.step("slopes of each place over half its value")
                self.named = self._name(search, solution, apart)
                if self.full.strikes and 0 < len(apart) < len(self.named.apart):
                    search.pace.step("what slopes would add, simulated")
                    self.named = self._weighed(search, solution, apart, self.named)
                if self.named.apart in abandoned:  # where a linear estimate would lead back to
                    self.named = replace(self.named, apart=apart, instead=dict.fromkeys(apart, ()))
                if self.named.apart == apart and self.full.strikes:
                    search.pace.step("what is named, tried at every other place")
                    self.named = self._tried(search, self._full(solution.x), self.named)
                    abandoned |= {apart} - {self.named.apart}
                self.settled = self.named.apart == apart
                if not self.settled:
                    begins = list(self._begins(solution.x))
                    self._retie(search, self.named.apart)
                    begin = min((self._few(x) for x in begins), key=lambda x: self._left(search, self.few, x))
                    solution, apart = search.at_full_length(begin, "fitting what deviates"), self.named.apart
            except Cancelled:
                solution, apart, self.named, spread = kept
                self._retie(search, apart)
                self.few.spread, self.settled = spread, False
                return broken_off(solution)
        return solution

    def _retie(self, search: Search, apart: Sequence[int]) -> None:
        """The search goes on with these apart, in the same weights."""
        history = [self._full(step.parameters) for step in search.history]
        parts = [(part, self._full(x)) for part, x in search.parts]
        spread, memory = self.few.spread, self.few.memory
        self.tie(apart)
        self.few.spread, self.few.memory = spread, memory
        search.residuals = self.few
        search.parts[:] = [(part, self._few(x)) for part, x in parts]
        search.history[:] = [
            replace(step, parameters=self._few(x)) for step, x in zip(search.history, history, strict=True)
        ]

    def _astray(self, x: np.ndarray, fraction: float = 1.0) -> bool:
        return not self.few.misfit(x, fraction) < ASTRAY

    def _sought(self, search: Search, solution: Solution, apart: tuple[int, ...]) -> tuple[Solution, tuple[int, ...]]:
        """The fit with one place more apart, which explains the data much better; as it was where none does."""
        missed, spread, parts = self.few.misfit(solution.x), self.few.spread, list(search.parts)
        begin, part = self.few.start, 1.0
        own = [self._column(i) for i in apart]
        begin[own] = solution.x[own]
        for part, end in [*parts, (1.0, solution.x)]:
            if self._astray(end, part):
                break
            begin = end
        self.full.spread, self.full.memory = self.few.learn_spread(begin, part), self.few.memory
        few, full = (search.watched(each.alone(part)) for each in (self.few, self.full))
        few_apart = [g for g in self.groups if 2 * len({*g.members} & {*apart}) + 2 <= len(g.members)]
        places = [i for g in few_apart for i in g.members if i not in apart]
        names = [f.on[0] for f in self.full.parameters]

        def tell(i: int):
            search.pace.step(f"another value tried at {names[i]}")

        ends: list[tuple[float, int, np.ndarray]] = []
        for trial in trials(few, begin, full, self._full, places, tell)[:FITTED]:
            self._retie(search, (*apart, trial.place))
            found = search.part(self._few(trial.moved), part, f"fitting a value at {names[trial.place]}")
            if found.status == "cancelled":
                raise Cancelled
            ends.append((self.few.misfit(found.x, part), trial.place, self._full(found.x)))
        if ends:
            _, place, x = min(ends, key=lambda end: end[0])
            more = tuple(sorted((*apart, place)))
            self._retie(search, more)
            later = [fraction for fraction, _ in parts if fraction >= part]
            better = search.through(self._few(x), later, "fitting what deviates")
            if self.full.strikes and better.status != "cancelled":
                better = search.past_roughness(better)
            if better.status == "cancelled":
                raise Cancelled
            if missed**2 - self.few.misfit(better.x) ** 2 > HELPS * (missed**2 - 1.0):
                return better, more
        self._retie(search, apart)
        self.few.spread, search.parts[:] = spread, parts
        return solution, apart

    def _weighed(self, search: Search, solution: Solution, apart: tuple[int, ...], named: Deviants) -> Deviants:
        """The names that were there, and of those that came to them the ones that take away, simulated, as much as they
        have to by a linear estimate.
        """
        few, full = (search.watched(each.alone()) for each in (self.few, self.full))
        values = dict(zip(self._candidates(), named.values, strict=True))
        more = [
            i for i in named.apart
            if i not in apart
            and brought(few, solution.x, solution.jacobian, full, self._full, i, values[i]) >= named.due[i]
        ]  # fmt: skip
        kept = tuple(sorted((*apart, *more)))
        return replace(named, apart=kept, instead={i: named.instead.get(i, ()) for i in kept})

    def _tried(self, search: Search, x: np.ndarray, named: Deviants) -> Deviants:
        """The names after each was tried at every other place of its group, with the value that it has: a linear
        estimate cannot tell neighbours apart where parts strike. A place that explains the data better takes the name;
        one that keeps more than half of what the name brings could be it, too.
        """
        candidates, instead = self._candidates(), dict(named.instead)
        here = self._left(search, self.full, x)
        for i in named.apart:
            without = x.copy()
            without[i] = x[self._mate(i)]
            brought = self._left(search, self.full, without) - here
            places = [j for g in self.groups if i in g.members for j in g.members if j not in named.apart]
            moved = {j: np.where(np.arange(x.size) == j, x[i], without) for j in places}
            lost = {j: self._left(search, self.full, moved[j]) - here for j in places}
            best = min(places, key=lambda j: lost[j])
            if lost[best] < 0.0:
                apart = tuple(sorted(best if k == i else k for k in named.apart))
                return replace(named, apart=apart, instead=dict.fromkeys(apart, ()), values=moved[best][candidates])
            near = {candidates.index(j) for j in places if lost[j] < KEPT * brought}
            instead[i] = tuple(sorted(near.union(instead[i])))
        return replace(named, instead=instead)

    def _left(self, search: Search, residuals: Residuals, x: np.ndarray) -> float:
        """Sum of squares, of every place with its own value or of shared ones."""
        search.heed()
        r = residuals.residual(x)
        return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def _begins(self, x: np.ndarray) -> Iterator[np.ndarray]:
        """All values where they are, and on the way to where what was named would take them."""
        here = self._full(x)
        there, problem = here.copy(), self.full.problem()
        if self.named is not None:
            there[self._candidates()] = self.named.values
        for share in (0.0, *SHARES):
            yield np.clip(here + share * (there - here), problem.lower, problem.upper)

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

    def _name(self, search: Search, solution: Solution, apart: Sequence[int]) -> Deviants:
        self.full.spread, self.full.memory = self.few.spread, self.few.memory
        x, candidates = self._full(solution.x), self._candidates()
        places, own = len(self.full.parameters), range(len(self.few.parameters), solution.x.size)
        others = [*(self._column(i) for i in range(places) if i not in candidates), *own]
        root = np.sqrt(solution.weights)
        r, common = root * solution.residual, root[:, None] * solution.jacobian[:, others]
        each = root[:, None] * self._slopes(search, x, solution.residual)
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
        instead, due = ({candidates[c]: v for c, v in each.items()} for each in (found.instead, found.due))
        return replace(found, apart=tuple(candidates[c] for c in found.apart), instead=instead, due=due)

    def _slopes(self, search: Search, x: np.ndarray, r: np.ndarray) -> Float[np.ndarray, "n c"]:
        """Of the residuals in each candidate; over half its value where parts may strike each other: a deviation that
        is worth naming is no smaller, and at a point they are rough.
        """
        candidates = self._candidates()
        if not self.full.strikes:
            return self.full.evaluate(x)[1][:, candidates]
        problem = search.watched(self.full.alone())
        reach = MOST * np.where(x == 0.0, problem.scale, np.abs(x))
        return secants(problem, x, r, reach, candidates).slopes

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
