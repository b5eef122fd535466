"""All experiments of a fit as one least-squares problem: whitened residuals, static frames and priors.

Rows: samples in motion, divided by their sigma and by `spread`; then static frames; then tolerances. `spread`
is the misfit in sigmas (1 for a model that fits): with it a wrong law may not outvote what static frames and
tolerances say.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from backend.fit.filmed_run import FilmedRun
from backend.fit.free import FreeParameter
from backend.fit.noise import lag_one, whiten_ar1, whiten_ar1_transposed
from backend.fit.price import Way, cheapest
from backend.fit.prior import GaussianPrior
from backend.fit.run import Run
from backend.fit.solve import LeastSquares
from backend.model.model import Address

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Rows:
    """Experiment (-1: a prior) and instant of each row, and how many leading rows are samples in motion."""

    run: Int[np.ndarray, " n"]
    instant: Int[np.ndarray, " n"]
    motion: int


@dataclass
class Residuals:
    """The residual function of a study.

    x = (values of the parameters, own unknowns of each run, numbers of each camera, which runs may share). memory:
    AR(1) coefficient by (run, channel), empty for white noise. way: of taking derivatives, None for what costs least.
    profiles: whether likelihood intervals will be asked for.
    """

    parameters: Sequence[FreeParameter]
    scale: Float[np.ndarray, " p"]
    runs: Sequence[Run]
    spread: float = 1.0
    memory: dict[tuple[int, int], float] = field(default_factory=dict)
    way: Way | None = None
    profiles: bool = False

    def __post_init__(self):
        p = len(self.parameters)
        ends = p + np.cumsum([0, *[r.unknowns for r in self.runs]])
        self.cameras = {r.camera.source: r.camera for r in self.runs if isinstance(r, FilmedRun)}
        z = dict(
            zip(self.cameras, _blocks(int(ends[-1]), [c.root.shape[1] for c in self.cameras.values()]), strict=True)
        )
        self._own = [
            np.concatenate([np.arange(a, b), *([z[r.camera.source]] if isinstance(r, FilmedRun) else [])])
            for r, a, b in zip(self.runs, ends[:-1].tolist(), ends[1:].tolist(), strict=True)
        ]
        self._z = z
        self._first: dict[float, Sequence[Run]] = {}
        self._calibrated = np.concatenate([np.zeros(0, int), *z.values()])
        sd = {f.name: (f.start, f.prior_sd) for f in self.parameters if f.prior_sd is not None}
        self.prior = GaussianPrior.of([f.name for f in self.parameters], sd) if sd else GaussianPrior.none()

    @property
    def strikes(self) -> bool:
        """Whether parts may strike each other in any run."""
        return any(run.strikes for run in self.runs)

    @cached_property
    def derivatives(self) -> Way:
        """How they are taken: as asked, or as costs least."""
        if self.way == "adjoint" and self.strikes:
            raise ValueError(
                "Parts that may strike each other have no derivatives backwards in time: leave `derivatives` out, or "
                "ask for forward ones."
            )
        profiled = len(self.parameters) if self.profiles else 0
        return self.way or cheapest(len(self.names), profiled, sum(run.rollout_s for run in self.runs), self.strikes)

    @property
    def names(self) -> list[str]:
        """Names of all unknowns."""
        own = [n for run in self.runs for n in run.own_names()]
        cameras = [
            f"camera:{at.stem}{k + 1}.{i + 1}" for k, (at, z) in enumerate(self._z.items()) for i in range(z.size)
        ]
        return [f.name for f in self.parameters] + own + cameras

    @property
    def start(self) -> Float[np.ndarray, " x"]:
        """Declared or drawn values, and the starts found."""
        calibrated = [np.zeros(z.size) for z in self._z.values()]
        return np.concatenate([[f.start for f in self.parameters], *[run.start for run in self.runs], *calibrated])

    def own(self, x: np.ndarray, run: int) -> np.ndarray:
        """The own unknowns of one run, and those of its camera."""
        return x[self._own[run]]

    def filmed(self, source: Path) -> list[Run]:
        """The runs that one camera took."""
        return [r for r in self.runs if isinstance(r, FilmedRun) and r.camera.source == source]

    def camera_numbers(self, x: np.ndarray) -> dict[Path, np.ndarray]:
        """How far each camera is from its calibration, in deviations along the axes of its covariance."""
        return {source: x[z] for source, z in self._z.items()}

    def holding(self, addresses: Sequence[Address], value: float) -> Residuals:
        """The same with parameters of the model, not free ones, at another value."""
        return replace(self, runs=[run.holding(addresses, value) for run in self.runs])

    def apart(self) -> Residuals:
        """The same for another thread: a run remembers what it simulated last."""
        return replace(self, runs=[run.apart() for run in self.runs])

    def problem(self, fraction: float = 1.0, anchor: np.ndarray | None = None) -> LeastSquares:
        """Least squares over the first fraction of every record.

        anchor: values that the parameters keep as far as the data do not speak: a row each, one for a change by its
        own size, or by its natural size where it is zero.
        """
        bounds = [run.bounds() for run in self.runs]
        beyond = np.full(sum(z.size for z in self._z.values()), np.inf)
        lower = np.concatenate([[f.lower for f in self.parameters], *[b[0] for b in bounds], -beyond])
        upper = np.concatenate([[f.upper for f in self.parameters], *[b[1] for b in bounds], beyond])
        scale = np.concatenate([self.scale, np.ones(lower.size - self.scale.size)])
        last = None
        held = np.zeros((0, scale.size))
        if anchor is not None:
            p = len(self.parameters)
            held = np.eye(p, scale.size) / np.where(anchor[:p] == 0.0, self.scale, np.abs(anchor[:p]))[:, None]

        def with_anchor(r: np.ndarray, x: np.ndarray) -> np.ndarray:
            return r if anchor is None else np.concatenate([r, held @ (x - anchor)])

        def linearise(x: np.ndarray):
            # The value comes with the derivative for twice its price, and most trial steps are accepted.
            nonlocal last
            known = last
            if known is None or not np.array_equal(known[0], x):
                r, J = self.evaluate(x, fraction)
                known = last = x.copy(), with_anchor(r, x), np.concatenate([J, held])
            return known[1:]

        def trace_back(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
            data, of_anchor = np.split(weight, [weight.size - len(held)])
            return self.traced_back(x, data, fraction) + of_anchor @ held

        plain = lower, upper, scale, self.rows(fraction).motion
        if self.derivatives == "together":
            return LeastSquares(self.names, lambda x: linearise(x)[0], linearise, *plain)
        return LeastSquares(
            self.names, lambda x: with_anchor(self.residual(x, fraction), x), linearise, *plain,
            trace_back if self.derivatives == "adjoint" else None,
        )  # fmt: skip

    def alone(self, fraction: float = 1.0) -> LeastSquares:
        """The same, simulated without derivatives beside it where none are asked for."""
        return replace(self.problem(fraction), residual=lambda x: self.residual(x, fraction, alone=True))

    def evaluate(self, x: np.ndarray, fraction: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """(r, J) at x, rows as `rows` says."""
        p = len(self.parameters)
        seen = self._each(lambda i, run, own: run.predict(x[:p], own), x, fraction)
        slopes = []
        for (_, slope), own in zip(seen, self._own, strict=True):
            slopes.append(np.zeros((slope.shape[0], x.size)))
            slopes[-1][:, :p], slopes[-1][:, own] = slope[:, :p], slope[:, p:]
        J = [*self._whitened(slopes, fraction), self.prior.jacobian(x.size), np.eye(x.size)[self._calibrated]]
        return self._beside_data([prediction for prediction, _ in seen], x, fraction), np.concatenate(J)

    def residual(self, x: np.ndarray, fraction: float = 1.0, alone: bool = False) -> np.ndarray:
        """r of `evaluate`; alone: without derivatives, which come along where compiling for that is not worth it."""
        return self._beside_data(self._predictions(x, fraction, alone), x, fraction)

    def traced_back(self, x: np.ndarray, weight: np.ndarray, fraction: float = 1.0) -> np.ndarray:
        """J' weight, backwards in time: no more than a few rollouts however many unknowns there are."""
        p = len(self.parameters)
        weights = [np.zeros(run.data.time_s.size) for run in self.runs]
        for held in (False, True):
            for i, run in enumerate(self.runs):
                keep = run.within(fraction)
                keep = keep[run.data.still[keep] == held]
                given, weight = np.split(weight, [keep.size])
                if not held:
                    given = self._remember(i, run.data.channel[keep], given, whiten_ar1_transposed) / self.spread
                weights[i][keep] = given / run.data.sigma[keep]
        of_prior, of_cameras = np.split(weight, [self.prior.index.size])
        gradient = self.prior.jacobian(x.size).T @ of_prior
        gradient[self._calibrated] += of_cameras
        traced = self._each(lambda i, run, own: run.trace_back(x[:p], own, weights[i]), x, fraction)
        for (by_value, by_own), own in zip(traced, self._own, strict=True):
            gradient[:p] += by_value
            gradient[own] += by_own
        return gradient

    def _predictions(self, x: np.ndarray, fraction: float, alone: bool = False) -> list[np.ndarray]:
        """What every run would show."""
        p = len(self.parameters)
        if self.derivatives == "together" and not alone:
            return self._each(lambda i, run, own: run.predict(x[:p], own)[0], x, fraction)
        return self._each(lambda i, run, own: run.foresee(x[:p], own), x, fraction)

    def _each(self, ask: Callable[[int, Run, np.ndarray], Answer], x: np.ndarray, fraction: float) -> list[Answer]:
        """Ask every run, with its own unknowns, at the same time; none is simulated past the first fraction of it."""
        if fraction not in self._first:
            self._first[fraction] = [run.first(fraction) for run in self.runs]
        runs = self._first[fraction]
        with ThreadPoolExecutor(max_workers=min(len(runs), os.cpu_count() or 1)) as pool:
            return list(pool.map(lambda i: ask(i, runs[i], self.own(x, i)), range(len(runs))))

    def _beside_data(self, predictions: Sequence[np.ndarray], x: np.ndarray, fraction: float) -> np.ndarray:
        off = [prediction - run.data.value for prediction, run in zip(predictions, self.runs, strict=True)]
        return np.concatenate([*self._whitened(off, fraction), self.prior.residual(x), x[self._calibrated]])

    def _whitened(self, samples: Sequence[np.ndarray], fraction: float) -> list[np.ndarray]:
        """What each run's samples (first axis) say, in the order and the units of the rows: those of motion, then the
        static ones.
        """
        motion, still = [], []
        for i, (run, each) in enumerate(zip(self.runs, samples, strict=True)):
            keep = run.within(fraction)
            rows = (each[keep].T / run.data.sigma[keep]).T
            held = run.data.still[keep]
            motion.append(self._remember(i, run.data.channel[keep][~held], rows[~held], whiten_ar1) / self.spread)
            still.append(rows[held])
        return [*motion, *still]

    def _remember(
        self, run: int, channel: np.ndarray, rows: np.ndarray, whiten: Callable[[np.ndarray, float], np.ndarray]
    ) -> np.ndarray:
        rows = rows.copy()
        for c in np.unique(channel) if self.memory else ():
            if a := self.memory.get((run, int(c)), 0.0):
                rows[channel == c] = whiten(rows[channel == c], a)
        return rows

    def miss(self, x: np.ndarray, fraction: float = 1.0) -> float:
        """Rms of how far parts are from where they were seen, in radians or mechanism lengths; 0 where only forces or
        pixels were measured, infinite where the motion is lost.
        """
        off = [np.zeros(0)]
        for prediction, run in zip(self._predictions(x, fraction), self.runs, strict=True):
            keep = run.within(fraction)
            size = {"rad": 1.0, "m": float(run.model.scale.length_m)}
            unit = np.array([size.get(c.unit, np.inf) for c in run.data.channels])[run.data.channel[keep]]
            off.append(((prediction - run.data.value)[keep] / unit)[np.isfinite(unit)])
        squares = np.concatenate(off) ** 2
        return float(np.nan_to_num(np.sqrt(np.mean(squares)), nan=np.inf)) if squares.size else 0.0

    def misfit(self, x: np.ndarray, fraction: float = 1.0) -> float:
        """Rms of the samples in motion at x, in sigmas; infinite where the motion is lost."""
        r = self.residual(x, fraction)
        rms = self.spread * float(np.sqrt(np.mean(r[: self.rows(fraction).motion] ** 2)))
        return rms if np.isfinite(rms) else np.inf

    def learn_spread(self, x: np.ndarray, fraction: float = 1.0) -> float:
        """Take the misfit at x, at least 1, as the spread; returns it."""
        rms = self.misfit(x, fraction)
        self.spread = max(rms, 1.0) if np.isfinite(rms) else self.spread
        return self.spread

    def learn_memory(self, x: np.ndarray) -> None:
        """Take the AR(1) coefficient of every channel from its residuals at x."""
        self.memory = {}
        r, _ = self.evaluate(x)
        at = 0
        for i, run in enumerate(self.runs):
            channel = run.data.channel[~run.data.still]
            for c in np.unique(channel):
                self.memory[(i, int(c))] = lag_one(r[at : at + channel.size][channel == c])
            at += channel.size

    def rows(self, fraction: float = 1.0) -> Rows:
        """Bookkeeping of the rows."""
        run, instant = [], []
        for held in (False, True):
            for i, each in enumerate(self.runs):
                rows = each.within(fraction)
                rows = rows[each.data.still[rows] == held]
                _, order = np.unique(each.data.time_s[rows], return_inverse=True)
                # Static frames are taken at their word, like priors.
                run.append(np.full(rows.size, -1 if held else i))
                instant.append(order)
        motion = sum(part.size for part in run[: len(self.runs)])
        priors = self.prior.index.size + sum(z.size for z in self._z.values())
        return Rows(
            np.concatenate([*run, np.full(priors, -1)]),
            np.concatenate([*instant, np.zeros(priors, int)]),
            motion,
        )


def _blocks(start: int, sizes: Sequence[int]) -> list[Int[np.ndarray, " k"]]:
    """Consecutive indices from `start` on, so many at a time."""
    ends = start + np.cumsum([0, *sizes])
    return [np.arange(a, b) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
