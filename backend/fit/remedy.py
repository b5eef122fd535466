"""What would tell a value that the data leave open: a longer record, another load or another release.

Each is simulated at the values found, as if filmed with the same noise beside what there is already.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from backend.effects.shapes import AbstractBodyForce, AbstractJointEffort, AbstractStrut
from backend.fit.identifiability import CORRELATED, Uncertainty
from backend.fit.measured import Measured
from backend.fit.prediction import Setting, look
from backend.fit.residual import Residuals
from backend.fit.run import Run
from backend.fit.secant import FAR, MOST, secants
from backend.fit.solve import Solution
from backend.model.model import Address

LONGER = (2.0, 4.0)  # times the record
STRONGER = (0.5, 2.0)  # times a load
REACHES = (-0.6, -0.3, 0.3, 0.6)  # rad, or mechanism lengths, from the release that was made
LOADS, DIRECTIONS = 3, 2  # of a mechanism, that are tried
UNITS = ("N", "N m", "N/m", "N m/rad")  # of what loads a mechanism
HELPS = 0.5  # of a deviation, that a remedy may leave at most
UNSEEN = 1e-12  # of the largest square, of a direction that no sample depends on
NAMED = 3  # values that are spoken of, and remedies for each


@dataclass(frozen=True)
class Remedy:
    """A record to be made, and the standard deviation that every parameter would have with it."""

    words: str
    sd: Float[np.ndarray, " p"]


def left_open(u: Uncertainty, x: Float[np.ndarray, " x"], p: int) -> list[int]:
    """Which of the first p values are not told from zero, or not from another; those known least come first."""
    sd, rho = u.sd[:p], np.abs(u.correlation[:p, :p]) - np.eye(p)
    wide = sd / np.maximum(np.abs(x[:p]), 1e-300)
    open_ = (wide > 1.0) | np.any(rho > CORRELATED, axis=0)
    return [int(i) for i in np.argsort(-wide, kind="stable") if open_[i]]


def remedies(
    residuals: Residuals, solution: Solution, u: Uncertainty, joints: Sequence[str], tell: Callable[[str], None]
) -> list[Remedy]:  # fmt: skip
    """Of all records that are tried, those whose motion is not lost: the first experiment, made otherwise.

    joints: as drawn, to name a pose by. tell: which comes next; it may raise, to end the trials.
    """
    p, run = len(residuals.parameters), residuals.runs[0]
    now = np.sqrt(solution.weights)[:, None] * solution.jacobian
    before, found = _deviations(now)[:p], []
    mine = residuals.own(np.arange(solution.x.size), 0)
    fitted = {address for parameter in residuals.parameters for address in parameter.addresses}
    for varied, own, words in _varied(run, solution.x[mine], joints, fitted):
        tell(words[-1][1])
        memory = {key: a for key, a in residuals.memory.items() if key[0] == 0}
        single = replace(residuals, runs=[varied], memory=memory)
        J, since = _slopes(single, np.concatenate([solution.x[:p], own]), u.sd[[*range(p), *mine]])
        if not np.all(np.isfinite(J)):
            continue
        for until, said in words:
            more = J[since <= until + 1e-9]
            # Its start is an unknown of its own; values and the camera's numbers are those of the others.
            both = np.zeros((len(now) + len(more), solution.x.size + run.unknowns))
            both[: len(now), : solution.x.size] = now
            both[len(now) :, [*range(p), *range(solution.x.size, both.shape[1]), *mine[run.unknowns :]]] = more
            after = _deviations(both)[:p]
            known = np.isfinite(u.sd[:p]) & (before > 0)
            ratio = after / np.where(before > 0, before, 1.0)
            found.append(Remedy(said, np.where(known, u.sd[:p] * ratio, u.spread * after)))
    return found


def sentences(residuals: Residuals, solution: Solution, u: Uncertainty, tried: Sequence[Remedy]) -> Iterator[str]:
    """For the values known least, what would tell them and how well, the best first."""
    left = left_open(u, solution.x, len(residuals.parameters))
    for i in left[:NAMED]:
        parameter, sd = residuals.parameters[i], u.sd[i]
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        known = f"+- {sd:.2g}{unit}" if np.isfinite(sd) else "unknown"
        best = sorted((r for r in tried if r.sd[i] < HELPS * sd), key=lambda r: r.sd[i])
        if best:
            told = "; ".join(f"{r.words} (+- {r.sd[i]:.2g})" for r in best[:NAMED])
            yield f"What would tell {parameter.name} (now {known}), besides these data: {told}."
        elif tried:
            yield (
                f"{parameter.name} (now {known}): no record up to {LONGER[-1]:g} times as long, no load between half "
                "and twice the drawn one and no other release that was tried tells it twice as well. Measure "
                "something else that it moves, or more closely."
            )
    if more := [residuals.parameters[i].name for i in left[NAMED:]]:
        yield f"Left open, too: {', '.join(more)}."


def _varied(
    run: Run, own: np.ndarray, joints: Sequence[str], fitted: set[Address]
) -> Iterator[tuple[Run, np.ndarray, list[tuple[float, str]]]]:
    """The experiment made otherwise, its own unknowns, and how long of it [s] is what."""
    whole, times = run.duration_s, max(LONGER)
    if run.experiment.inputs is None:  # nobody knows how a recorded drive goes on
        words = [(k * whole, f"a record of {k * whole:.3g} s instead of {whole:.3g} s") for k in LONGER]
        yield replace(run, data=_longer(run.data, times), _last=None, _seen=None), own, words
    for address, value, unit in _loads(run, fitted)[:LOADS]:
        for k in STRONGER:
            said = f"{'.'.join(address)} of {k * value:.3g} {unit} instead of {value:.3g} {unit}"
            yield run.holding([address], k * value), own, [(whole, said)]
    for direction in range(min(run.mobility, DIRECTIONS)):
        for reach in REACHES:
            moved = own.copy()
            moved[direction] += reach
            rest = "at the same speed" if run.moving else "from rest"
            words = f"a release with {pose_words(run.setting, moved[: run.mobility], joints)} {rest}"
            yield run, moved, [(whole, words)]


def _longer(data: Measured, times: float) -> Measured:
    """The same samples, repeated after the last one until the record is so many times as long."""
    last, parts = float(data.time_s.max()), []
    shift = last - data.release_s + float(np.median(np.diff(np.unique(data.time_s))))
    for c in range(len(data.channels)):
        rows = data.of(c)
        again = rows[~data.still[rows]]
        time = np.concatenate([data.time_s[rows], *(data.time_s[again] + k * shift for k in range(1, int(times)))])
        parts.append((time, np.concatenate([rows, np.tile(again, int(times) - 1)])))
    rows = np.concatenate([part[1] for part in parts])
    return replace(
        data, time_s=np.concatenate([part[0] for part in parts]), value=data.value[rows], sigma=data.sigma[rows],
        channel=data.channel[rows],
    )  # fmt: skip


def _loads(run: Run, fitted: set[Address]) -> list[tuple[Address, float, str]]:
    """What drives or holds the mechanism by a force of its own, and is not among the values asked for."""
    ids = {
        id
        for kind in (AbstractBodyForce, AbstractJointEffort, AbstractStrut)
        for placed in run.model.of(kind)
        for id in placed.ids
    }
    return [
        (address, row.value, row.declaration.unit)
        for address, row in run.model.parameters.items()
        if address[0] in ids and address not in fitted and row.declaration.unit in UNITS
        if isinstance(row.value, float) and row.value != 0.0
    ]


def _slopes(
    single: Residuals, x: np.ndarray, sd: np.ndarray
) -> tuple[Float[np.ndarray, "n x"], Float[np.ndarray, " n"]]:
    """Of one experiment's samples in all that they depend on, and when each was taken; -1 while held still."""
    run = single.runs[0]
    if single.strikes:
        problem = single.alone()
        reach = np.minimum(FAR * sd, MOST * np.maximum(np.abs(x), problem.scale))
        J = secants(problem, x, problem.residual(x), reach, range(x.size)).slopes
    else:
        J = single.evaluate(x)[1]
    since, still = run.since_release_s, run.data.still
    when = np.concatenate([since[~still], np.full(still.sum(), -1.0)])
    return J[: when.size], when


def _deviations(J: Float[np.ndarray, "n x"]) -> Float[np.ndarray, " x"]:
    """Of white noise alone; infinite for what no sample depends on."""
    columns = np.linalg.norm(J, axis=0)
    D = np.where(columns > 0, columns, 1.0)
    w, V = np.linalg.eigh((J / D).T @ (J / D))
    variance = np.sum(V**2 / np.maximum(w, UNSEEN * w.max()), axis=1)
    return np.where(columns > 0, np.sqrt(variance) / D, np.inf)


def pose_words(setting: Setting, coordinates: Float[np.ndarray, " mobility"], joints: Sequence[str]) -> str:
    """A pose in the user's words: the coordinates of as many of these joints as it takes."""
    at, slope = look(setting.model, setting.reference, setting.motions)
    topology = setting.model.topology
    q = np.asarray(at)[: len(topology.joint_ids)]
    q = q + np.asarray(slope)[: q.size] @ coordinates
    words = [
        f"{id} at {1e3 * q[i]:.0f} mm" if kind == "prismatic" else f"{id} at {np.degrees(q[i]):.0f} deg"
        for i, (id, kind) in enumerate(zip(topology.joint_ids, topology.joint_types, strict=True))
        if id in joints
    ]
    return ", ".join(words[: max(coordinates.size, 1)])
