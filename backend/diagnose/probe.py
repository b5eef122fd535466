"""One experiment under any choice of candidates, without compiling anew: few numbers move, the library stands still.

Slopes are taken forward, a fixed number of directions at a time, so that one compiled program serves the baseline,
every candidate, every pair and the unknown forces alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from backend.diagnose.bumps import bumps
from backend.diagnose.calibration import Misplaced
from backend.fit.prediction import Addresses, Overrides, Setting, predict
from backend.fit.run import Run
from backend.simulate.record import Record
from backend.simulate.shelf import shelved

AT_ONCE = 4  # directions, or a multiple of it: of a small mechanism four more cost half as much as a motion with four
# Iterations a step beyond which a motion is given up: with every pin loose and rubbing some six are usual. Of hundreds
# of motions that a search tries one may bind or chatter, and cost more than all others together.
PATIENCE = 30
PER_BUMP = 8  # places of a joint looked at, for each bump in time: fewer lose what a force of its speed does in one


@shelved("addresses")
def sensitivities(
    setting: Setting,
    bumps: Float[Array, "steps waves"],
    addresses: Addresses,
    step_s: Float[Array, ""],
    x: Float[Array, " x"],
    directions: Float[Array, "k x"],
    waves: Float[Array, "k waves drives"],
) -> tuple[Float[Array, " samples"], Float[Array, "samples k"], Array]:
    """Prediction at x, its derivative along k directions of x and of unknown drives, and the samples it was lost for.

    bumps: shapes in time of the drives; `waves` says how much of each enters which drive.
    """

    def seen(x, wave):
        if setting.record is None:
            return predict(setting, addresses, step_s, x, patience=PATIENCE)
        values = setting.record.values + bumps @ wave
        record = eqx.tree_at(lambda r: r.values, setting.record, values)
        return predict(eqx.tree_at(lambda s: s.record, setting, record), addresses, step_s, x, patience=PATIENCE)

    def along(direction, wave):
        return jax.jvp(seen, (x, jnp.zeros_like(wave)), (direction, wave))

    (value, lost), (slope, _) = jax.vmap(along, out_axes=((None, None), (1, None)))(directions, waves)
    return value, slope, lost


@shelved("addresses")
def motion(
    setting: Setting, addresses: Addresses, step_s: Float[Array, ""], x: Float[Array, " x"]
) -> tuple[Float[Array, " samples"], Array]:
    """Prediction at x alone, and the samples it was lost for."""
    return predict(setting, addresses, step_s, x, patience=PATIENCE)


@dataclass
class Probe(Run):
    """An experiment in which `few` numbers are tied to the library's parameters, which otherwise keep `neutral`.

    bumps: (steps, waves) of the unknown drives, the last columns of the setting's record. correction: what the error of
    the step takes from every sample, put back. misplaced: what the library's last numbers, those of the cameras, do
    to samples. lying: ways in which samples before the release may be off, by one deviation each (see `settled`).
    loose: whether pins are, so that motions take so long that a program of their own is worth compiling. at_once: how
    many directions the compiled program takes. overrides: of what the library may free.
    """

    neutral: Float[np.ndarray, " all"] = field(default_factory=lambda: np.zeros(0))
    bumps: Float[np.ndarray, "steps waves"] = field(default_factory=lambda: np.zeros((0, 0)))
    correction: Float[np.ndarray, " samples"] | None = None
    misplaced: Misplaced | None = None
    lying: Float[np.ndarray, "samples ways"] | None = None
    loose: bool = False
    at_once: int = AT_ONCE
    overrides: Overrides | None = None

    def framed(self, steps: int, samples: int) -> Setting:
        """The rollout with room for so many steps and samples, and what the experiment sets otherwise."""
        return replace(super().framed(steps, samples), overrides=self.overrides)

    def choose(self, ties: Float[np.ndarray, "all few"], neutral: Float[np.ndarray, " all"] | None = None) -> Probe:
        """The same experiment with other numbers free."""
        neutral = self.neutral if neutral is None else neutral
        made = replace(self, ties=ties, neutral=np.where(ties.any(1), 0.0, neutral), _last=None)
        made.__dict__["setting"] = self.setting
        return made

    def put_right(self, error: Float[np.ndarray, " samples"]) -> Probe:
        """The same experiment with this error of the step put back."""
        made = replace(self, correction=error, _last=None)
        made.__dict__["setting"] = self.setting
        return made

    def every(self, values: np.ndarray) -> np.ndarray:
        """The value at every address."""
        return self.neutral if self.ties is None else self.neutral + self.ties @ values

    def predict(self, values: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predicted samples and their derivative in (values, own); NaN from where the motion is lost."""
        x = self._x(values, own)
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1]
        ties = np.zeros((self.neutral.size, 0)) if self.ties is None else self.ties
        few = ties.shape[1]
        directions = np.zeros((few + self.unknowns, x.size))
        directions[:few, : ties.shape[0]] = ties.T
        directions[few:, ties.shape[0] :] = np.eye(self.unknowns, x.size - ties.shape[0])
        made = self.along(x, directions)
        self._last = x, made
        return made

    def seen(self, values: np.ndarray, own: np.ndarray) -> Float[np.ndarray, " samples"]:
        """Predicted samples alone."""
        x, n = self._x(values, own), self.data.time_s.size
        if not self.loose:
            return self.along(x, np.zeros((0, x.size)))[0]
        step, of_motion = jnp.asarray(self.step_s), jnp.asarray(self._of_motion(x))
        made, lost = (np.array(v[:n]) for v in motion(self.setting, self.addresses, step, of_motion))
        return np.where(lost, np.nan, self._measured(made, x))

    def slopes(self, values: np.ndarray, own: np.ndarray, directions: Float[np.ndarray, "k all"]) -> np.ndarray:
        """(samples, k): derivative along directions in the library's parameters."""
        x = self._x(values, own)
        wide = np.zeros((directions.shape[0], x.size))
        wide[:, : directions.shape[1]] = directions
        return self.along(x, wide)[1]

    def kick_slopes(self, values: np.ndarray, own: np.ndarray) -> np.ndarray:
        """(samples, mobility): response to the rates at which the mechanism is let go."""
        x = self._x(values, own)
        return self.along(x, np.eye(x.size)[x.size - self.mobility :])[1]

    def drive_slopes(
        self, values: np.ndarray, own: np.ndarray, drives: Sequence[int],
        shapes: Float[np.ndarray, "steps waves"] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """(samples, drives, waves): response to unknown drives, which are these columns of the record.

        shapes: theirs in time, at most as many as there are bumps, instead of the bumps.
        """
        x, room = self._x(values, own), self.bumps.shape[1]
        every = self.setting.record.values.shape[1] if self.setting.record is not None else 0
        shapes = self.bumps if shapes is None else shapes
        waves = shapes.shape[1]
        wave = np.zeros((len(drives) * waves, room, every))
        for i, drive in enumerate(drives):
            wave[i * waves + np.arange(waves), np.arange(waves), drive] = 1.0
        filled = np.pad(shapes, ((0, 0), (0, room - waves)))
        made = self.along(x, np.zeros((len(drives) * waves, x.size)), wave, filled)[1]
        return made.reshape(made.shape[0], len(drives), waves)

    def coordinates(self, values: np.ndarray, own: np.ndarray) -> Float[np.ndarray, "times joints"]:
        """q of every joint along the motion, at even times, through the program that predicts samples."""
        room = self.setting.column.size
        joints = max(len(self.model.topology.joint_ids), 1)
        times = max(min(PER_BUMP * self.bumps.shape[1], room // joints), 2)
        column, since = np.zeros(room, int), np.zeros(room)
        column[: times * joints] = np.tile(np.arange(joints), times)
        since[: times * joints] = np.repeat(np.linspace(0.0, self.duration_s, times), joints)
        asked = replace(self.setting, column=jnp.asarray(column), since_release_s=jnp.asarray(since))
        x = self._of_motion(self._x(values, own))
        record = asked.record
        none = np.zeros((self.at_once, self.bumps.shape[1], 0 if record is None else record.values.shape[1]))
        seen, _, _ = sensitivities(
            asked, jnp.asarray(self.bumps), self.addresses, jnp.asarray(self.step_s), jnp.asarray(x),
            jnp.zeros((self.at_once, x.size)), jnp.asarray(none),
        )  # fmt: skip
        return np.asarray(seen)[: times * joints].reshape(times, joints)

    def along(
        self, x: np.ndarray, directions: np.ndarray, waves: np.ndarray | None = None, shapes: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(samples), (samples, k): prediction and slopes, `at_once` directions at a time.

        shapes: of the drives in time, instead of the bumps.
        """
        n, k = self.data.time_s.size, directions.shape[0]
        record = self.setting.record
        none = np.zeros((k, self.bumps.shape[1], 0 if record is None else record.values.shape[1]))
        waves = none if waves is None else waves
        seen, lost, slopes = np.zeros(n), np.zeros(n, bool), np.zeros((n, k))
        bumps, step = jnp.asarray(self.bumps if shapes is None else shapes), jnp.asarray(self.step_s)
        motion, ways = self._of_motion(x), self._of_motion(directions)
        for first in range(0, max(k, 1), self.at_once):
            part = slice(first, min(first + self.at_once, k))
            d, w = np.zeros((self.at_once, motion.size)), np.zeros((self.at_once, *waves.shape[1:]))
            d[: part.stop - first], w[: part.stop - first] = ways[part], waves[part]
            value, slope, gone = sensitivities(
                self.setting, bumps, self.addresses, step, jnp.asarray(motion), jnp.asarray(d), jnp.asarray(w)
            )
            seen, lost = np.asarray(value[:n]), np.asarray(gone[:n])
            slopes[:, part] = np.asarray(slope[:n])[:, : part.stop - first]
        if self.misplaced is not None:
            slopes += self.misplaced.slopes(self._in_place(seen)) @ directions[:, self._z].T
        return np.where(lost, np.nan, self._measured(seen, x)), slopes

    def _in_place(self, seen: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
        """Samples with the error of the step put back."""
        return seen if self.correction is None else seen + self.correction

    def _measured(self, seen: Float[np.ndarray, " samples"], x: np.ndarray) -> Float[np.ndarray, " samples"]:
        """The same as the cameras see them."""
        seen = self._in_place(seen)
        return seen if self.misplaced is None else seen + self.misplaced.slopes(seen) @ x[self._z]

    def step_error(self, values: np.ndarray, own: np.ndarray) -> Float[np.ndarray, "two samples"]:
        """What the error of the step adds to every sample of a motion, to be put back into predictions; and the same
        as steps twice as long tell it, which agrees where the error is of second order.

        A step of twice the length is off by four times as much (Richardson 1911), and the program that is compiled
        takes it as it is. A frame rate off by 1e-5 would otherwise be seen in a clean record.
        """
        one, two, four = (self._in_steps(times * self.step_s, values, own) for times in (1, 2, 4))
        error = np.nan_to_num((one - two) / 3.0)
        return np.stack([error, np.where(np.isfinite(two - four), (two - four) / 12.0, error)])

    def _in_steps(self, step_s: float, values: np.ndarray, own: np.ndarray) -> Float[np.ndarray, " samples"]:
        made = self.in_steps(step_s)
        made.correction = None
        return made.predict(values, own)[0]

    def in_steps(self, step_s: float) -> Probe:
        """The same experiment in other steps, by the same program; of the whole record."""
        frame = self.bumps.shape
        made = replace(self, step_s=step_s, bumps=bumps(frame[0] - 1, step_s, self.duration_s, frame[1]), _last=None)
        setting, record = self.setting, self.setting.record
        if step_s != self.step_s:
            setting = made.framed(setting.steps, setting.column.size)
            if record is not None:
                driven = record.addresses[0 if setting.record is None else len(setting.record.addresses) :]
                setting = replace(setting, record=with_drives(setting.record, setting.steps, driven))
        made.__dict__["setting"] = setting
        return made

    @property
    def _z(self) -> slice:
        """The cameras' numbers, which no program that moves the mechanism knows."""
        return slice(len(self.addresses), self.neutral.size)

    def _of_motion(self, x: Float[np.ndarray, "*k x"]) -> Float[np.ndarray, "*k few"]:
        return np.delete(x, self._z, axis=-1)

    def _x(self, values: np.ndarray, own: np.ndarray) -> np.ndarray:
        rates = own[self.mobility :] if self.moving else np.zeros(self.mobility)
        return np.concatenate([self.every(values), own[: self.mobility], rates])


def with_drives(record: Record | None, steps: int, addresses: tuple[tuple[str, str], ...]) -> Record:
    """A record that also drives `addresses`, by nothing yet; a path that is on record by that once more, in whose
    place it stands.
    """
    if record is None:
        return Record(jnp.zeros((steps + 1, len(addresses))), addresses)
    none = jnp.zeros(record.values.shape[0])
    told = dict(zip(record.addresses, record.values.T, strict=True))
    values = [record.values, *(told.get(a, none)[:, None] for a in addresses)]
    return Record(jnp.concatenate(values, 1), (*record.addresses, *addresses))
