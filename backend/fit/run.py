"""One experiment ready to be compared with the model: its data, its start, and its whitened residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from backend.effects.shapes import AbstractClock, AbstractShutter
from backend.fit.measured import Measured, measured
from backend.fit.noise import calm, quantum
from backend.fit.pose import Found, find_start
from backend.fit.prediction import Addresses, Setting, foreseen, linearised, roomy, strikes, traced_back
from backend.fit.price import step_s
from backend.fit.solve import LeastSquares, solve
from backend.mechanism.study import Experiment
from backend.model.model import Address, Model
from backend.model.system import system
from backend.simulate.record import beginning, on_steps, series_of

SPARED, ROOM = 32, 8  # slopes that repay another program; that it has room for, or a multiple of it
CLOCK_ROOM = 1.3  # longer rollouts where the clock itself may be wrong


@dataclass
class Run:
    """One experiment. Its own unknowns: `mobility` start coordinates, and as many rates if it starts moving.

    ties: from the values that are fitted to those at `addresses`, where some share one; None: they are the same.
    """

    experiment: Experiment
    data: Measured
    model: Model
    found: Found
    addresses: Addresses
    step_s: float
    ties: Float[np.ndarray, "all few"] | None = None
    _last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = field(default=None, repr=False)
    _seen: tuple[np.ndarray, np.ndarray] | None = field(default=None, repr=False)

    @classmethod
    def of(cls, experiment: Experiment, model: Model, addresses: Addresses, step_s: float) -> Self:
        """Read the tables and find the start. ValueError names the experiment."""
        values = model.overridden(experiment.overrides)
        free = {(effect, name.partition("[")[0]) for group in addresses for effect, name in group}
        if clash := sorted(set(values) & free):
            raise ValueError(
                f"experiment '{experiment.id}' overrides {'.'.join(clash[0])}, which is also free. "
                "Drop the override, or do not free it."
            )
        model = model.with_parameters({a: jnp.asarray(v) for a, v in values.items()}) if values else model
        model = beginning(model, series_of(experiment))
        data = measured(experiment, model)
        try:
            found = find_start(model, data, experiment.release)
        except ValueError as error:
            raise ValueError(f"experiment '{experiment.id}': {error}") from None
        return cls(experiment, data, model, found, addresses, step_s)

    @property
    def moving(self) -> bool:
        """Whether it starts in motion, so that rates are unknown too."""
        return not self.experiment.release.at_rest

    @property
    def mobility(self) -> int:
        """Number of start coordinates."""
        return self.found.motions.shape[-1]

    @property
    def unknowns(self) -> int:
        """Number of its own unknowns."""
        return self.mobility * (2 if self.moving else 1)

    @property
    def start(self) -> Float[np.ndarray, " unknowns"]:
        """Where the search for them begins."""
        zero = np.zeros(self.mobility)
        return np.concatenate([zero, self.found.rates]) if self.moving else zero

    @property
    def duration_s(self) -> float:
        """From the release to the last sample."""
        return float(self.data.time_s.max() - self.data.release_s)

    @property
    def since_release_s(self) -> Float[np.ndarray, " n"]:
        """When each sample was taken, as stated, counted from the release."""
        return self.data.time_s - self.data.release_s

    def within(self, fraction: float) -> np.ndarray:
        """Samples (indices) of the first fraction of the record, static frames included."""
        return np.flatnonzero(self.since_release_s <= fraction * self.duration_s)

    @cached_property
    def setting(self) -> Setting:
        """The rollout of the whole record. Records of similar length share one compiled program, with room for half the
        step where parts strike.
        """
        steps, samples = self.frame
        return self.framed(2 * steps if self.strikes else steps, samples)

    @property
    def frame(self) -> tuple[int, int]:
        """Steps and samples that the rollout of the whole record has room for."""
        clocks = bool(self.model.of(AbstractClock) or self.model.of(AbstractShutter))
        steps = int(np.ceil(self.duration_s * (CLOCK_ROOM if clocks else 1.0) / self.step_s)) + 1
        return roomy(steps), roomy(self.asked[0].size)

    @property
    def asked(self) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"]]:
        """When (since the release, as stated) and which columns of the rollout are asked for."""
        return self.since_release_s, self.data.column

    def reported(self, value: np.ndarray, slope: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the data would say, and its slope in (values, own), from what was asked of the rollout."""
        return value, slope

    def framed(self, steps: int, samples: int) -> Setting:
        """The rollout with room for so many steps and samples: one frame for all is one compiled program."""
        since, asked = self.asked
        column, time = np.zeros(samples, int), np.zeros(samples)
        column[: since.size], time[: since.size] = asked, since
        record = None
        if series := series_of(self.experiment):
            # A node's velocity needs the step that follows it: `on_steps` gives one more than asked.
            record = on_steps(self.model, series, self.step_s, steps, self.data.release_s)
        return Setting(
            self.model, self.found.reference, jnp.asarray(self.found.motions), jnp.asarray(time),
            jnp.asarray(column), jnp.asarray(self.found.turns), record, steps,
        )  # fmt: skip

    def apart(self) -> Self:
        """The same experiment, and the same compiled program, with a memory of its own."""
        return replace(self, _last=None, _seen=None)

    def first(self, fraction: float) -> Self:
        """The same experiment, and the same compiled program, whose samples after its first fraction are taken at its
        end: no time is spent on what follows.
        """
        if fraction >= 1.0:
            return self
        made = self.apart()
        since = jnp.minimum(self.setting.since_release_s, fraction * self.duration_s)
        made.__dict__["setting"] = replace(self.setting, since_release_s=since)
        return made

    def tied(self, ties: Float[np.ndarray, "all few"]) -> Run:
        """The same experiment, and the same compiled program, for values of which some are shared."""
        return replace(self, ties=ties, _last=None, _seen=None)

    def stepping(self, step_s: float) -> Run:
        """The same experiment, simulated with another step, by the same compiled program where that has room for it."""
        made, own = replace(self, step_s=step_s, _last=None, _seen=None), self.setting
        if made.frame[0] <= own.steps:
            made.__dict__["setting"] = made.framed(own.steps, own.column.size)
        return made

    def holding(self, addresses: Sequence[Address], value: float) -> Run:
        """The same experiment, and the same compiled program, with parameters of the model at another value."""
        given = dict.fromkeys(addresses, jnp.asarray(value))
        return replace(self, model=self.model.with_parameters(given), _last=None, _seen=None)

    def every(self, values: Float[np.ndarray, " few"]) -> Float[np.ndarray, " all"]:
        """The value at every address."""
        return values if self.ties is None else self.ties @ values

    @cached_property
    def strikes(self) -> bool:
        """Whether its parts may strike each other, so that there is no derivative backwards in time."""
        return strikes(jax.eval_shape(system, self.model))

    @property
    def rollout_s(self) -> float:
        """What simulating it once usually takes."""
        return self.frame[0] * step_s(self.model.topology.slots, self.strikes)

    def predict(self, values: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predicted samples and their derivative in (values, own); NaN from where the motion is lost."""
        x = self._moved_by(values, own)
        key = np.concatenate([x, own[self.unknowns :]])
        last = self._last  # read once: others may ask at the same time
        if last is not None and np.array_equal(last[0], key):
            return last[1]
        directions, mixed = self._directions(x.size, values.size)
        seen, slope, lost = linearised(
            self.setting, self.addresses, self.step_s, jnp.asarray(x), jnp.asarray(directions)
        )
        n = self.asked[0].size
        J = np.asarray(slope[:n])
        J = J if mixed is None else J @ mixed
        made = self.reported(np.where(np.asarray(lost[:n]), np.nan, np.asarray(seen[:n])), J, own)
        self._last = key, made
        return made

    def foresee(self, values: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Predicted samples alone; NaN from where the motion is lost."""
        value = self._foreseen(self._moved_by(values, own))
        return self.reported(value, np.zeros((value.size, 0)), own)[0]

    def trace_back(self, values: np.ndarray, own: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J' weight in (values, own), J the derivative of the predicted samples; nothing may strike."""
        x = self._moved_by(values, own)
        asked, by_camera = self.handed_back(self._foreseen(x), own, weight)
        room = np.zeros(self.setting.column.size)
        room[: asked.size] = asked
        slope = np.asarray(traced_back(self.setting, self.addresses, self.step_s, jnp.asarray(x), jnp.asarray(room)))
        p = slope.size - 2 * self.mobility
        by_value = slope[:p] if self.ties is None else slope[:p] @ self.ties
        return by_value, np.concatenate([slope[p : p + self.unknowns], by_camera])

    def handed_back(self, value: np.ndarray, own: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of what was asked of the rollout from those of what the data would say, and the camera's share."""
        return weight, np.zeros(0)

    def _directions(self, size: int, few: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Directions in x along which slopes are taken, and how those in (values, own) are mixed from them.

        Where values are shared by many, along what they share, with room for more; else everywhere, since naming
        what deviates takes those too and one program serves both.
        """
        p = size - 2 * self.mobility
        every = np.eye(p + self.unknowns, size)
        if self.ties is None:
            return every, None
        mixed = np.eye(p + self.unknowns, few + self.unknowns, few - p)
        mixed[:p, :few] = self.ties
        if p - few < SPARED:
            return every, mixed
        k = few + self.unknowns
        along = np.zeros((-(-k // ROOM) * ROOM, size))
        along[:k] = mixed.T @ every
        return along, np.eye(len(along), k)

    def _foreseen(self, x: np.ndarray) -> np.ndarray:
        """What is asked of the rollout; NaN from where the motion is lost."""
        last = self._seen
        if last is not None and np.array_equal(last[0], x):
            return last[1]
        seen, lost = foreseen(self.setting, self.addresses, self.step_s, jnp.asarray(x))
        n = self.asked[0].size
        made = np.where(np.asarray(lost[:n]), np.nan, np.asarray(seen[:n]))
        self._seen = x, made
        return made

    def _moved_by(self, values: np.ndarray, own: np.ndarray) -> np.ndarray:
        """What decides its motion: the value at every address, start coordinates, start rates."""
        rates = own[self.mobility : self.unknowns] if self.moving else np.zeros(self.mobility)
        return np.concatenate([self.every(values), own[: self.mobility], rates])

    def settle(self, values: np.ndarray) -> np.ndarray:
        """Its own unknowns from its static frames, or its first window, alone: `values` stay as given.

        This is all that a held-out experiment may learn from itself.
        """
        early = self._early
        only_joints = all(c.coordinate == "q" for c in self.data.channels)
        if not self.start.size or (only_joints and not self.moving):
            return self.start  # nothing to find, or the static mean is already the best answer
        p, last = len(values), {}

        def linearise(own: np.ndarray):
            if last.get("own") is None or not np.array_equal(last["own"], own):
                seen, slope = self.predict(values, own)
                sigma = self.data.sigma[early]
                r = (seen - self.data.value)[early] / sigma
                last.update(own=own.copy(), r=r, J=slope[early][:, p:] / sigma[:, None])
            return last["r"], last["J"]

        lower, upper = self.bounds()
        problem = LeastSquares(
            [f"start {i}" for i in range(self.unknowns)], lambda y: linearise(y)[0], linearise,
            lower, upper, np.ones(self.unknowns),
        )  # fmt: skip
        return solve(problem, self.start, max_iterations=12, ftol=1e-6).x

    @cached_property
    def _early(self) -> Bool[np.ndarray, " n"]:
        """Samples of the first window, or static frames without those far off the rest of their channel."""
        since, data = self.since_release_s, self.data
        early = since <= self.experiment.release.window_s if self.moving else data.still.copy()
        for c in () if self.moving else range(len(data.channels)):
            rows = np.flatnonzero((data.channel == c) & early)
            if rows.size:
                away = np.abs(data.value[rows] - np.median(data.value[rows]))
                early[rows] = calm(away, away, quantum(data.value[data.channel == c]))
        return early if np.any(early) else since <= since.min()

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Start coordinates stay near the pose that was found; rates are free."""
        upper = np.full(self.unknowns, np.inf)
        upper[: self.mobility] = 0.7  # rad, or mechanism lengths
        return -upper, upper

    def own_names(self) -> list[str]:
        """Names of its own unknowns."""
        kinds = ["coordinate"] * self.mobility + ["rate"] * self.mobility
        return [f"start:{self.experiment.id}.{k}{i % self.mobility + 1}" for i, k in enumerate(kinds[: self.unknowns])]
