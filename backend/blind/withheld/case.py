"""One withheld case: a mechanism at random, what is amiss with it, six experiments, and the sealed truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from backend.blind.withheld import library, outside, peers
from backend.blind.withheld.causes import KINDS, Cause, Rig, drawn_cause, scaled
from backend.blind.withheld.detectability import (
    ALIKE,
    WITHOUT_SLOPE,
    Distance,
    Record,
    Witness,
    confusion,
    distance,
    rivals_of,
)
from backend.blind.withheld.laws import Laws, as_drawn, changed
from backend.blind.withheld.linkage import Linkage
from backend.blind.withheld.measurement import Noise, noisy, seen
from backend.blind.withheld.mechanisms import DEVELOPED, UNSEEN
from backend.blind.withheld.motion import Motion, Stuck, move
from backend.blind.withheld.turning import with_other_hinges

STRATA = ("none",) * 4 + ("single",) * 7 + ("pair",) * 3 + ("left_out",) * 3 + ("never",) * 3
OUTSIDE = outside.__name__  # both catalogues enter their kinds when they are read
KNOWN = tuple(name for name, k in KINDS.items() if k.known)
UNKNOWN = tuple(name for name, k in KINDS.items() if not k.known)
STATIC_FRAMES = 20
FIT, HELD_OUT = 4, 2
SHARE_OF_PEERS = 0.25
SHARE_OF_FAINT = 0.25  # of single causes
UNSCALED = ("joint_stop", "base_motion")  # a smaller one is not the same one weaker
TOO_FAINT = 0.7  # of the draws that nobody could see are drawn again
LIVELY = 25.0  # rad/s: faster releases than a camera of 60 frames/s would be used for
TOUCHY = 12.0  # how much further apart than at the start two near releases may end
TRIES = 60


@dataclass(frozen=True)
class Case:
    """What is written for the diagnosis (linkage, tables, sigma_m where told) and what is kept (label)."""

    linkage: Linkage
    record: Record
    release_s: float
    places: np.ndarray
    noise: Noise
    fit: int
    label: dict[str, Any]


@dataclass(frozen=True)
class Limits:
    """What a check is limited to.

    mechanisms: the only ones to draw; none for all. without: kinds that are neither drawn nor known to the diagnosis.
    """

    mechanisms: tuple[str, ...] = ()
    without: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """As a sentence names them."""
        less = f" without {', '.join(self.without)}" if self.without else ""
        return f"{', '.join(self.mechanisms) or 'all mechanisms'}{less}"

    @property
    def stamp(self) -> dict[str, list[str]]:
        """As a file keeps them."""
        return {"mechanisms": sorted(self.mechanisms), "without": sorted(self.without)}


ALL = Limits()


def stratum_of(seed: int, index: int) -> str:
    """Strata in shuffled blocks of twenty, so that every run of 20 cases holds all of them."""
    block = np.random.default_rng([seed, 1_000_003, index // len(STRATA)]).permutation(STRATA)
    return str(block[index % len(STRATA)])


def draw_case(seed: int, index: int, *, unseen: bool = False, limits: Limits = ALL) -> Case:
    """Case `index` of a seed, the same every time.

    unseen: whether mechanisms kept for tests may be drawn.
    """
    stratum = stratum_of(seed, index)
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, index, attempt])
        try:
            if case := _attempt(rng, stratum, unseen, index, limits):
                return case
        except Stuck:
            continue
    raise RuntimeError(f"no case {index} of seed {seed} after {TRIES} tries; its mechanisms do not move: {stratum}")


def _attempt(rng: np.random.Generator, stratum: str, unseen: bool, index: int, limits: Limits) -> Case | None:
    families = UNSEEN if unseen and rng.random() < 0.25 else DEVELOPED
    if limits.mechanisms:
        families = {name: draw for name, draw in {**DEVELOPED, **UNSEEN}.items() if name in limits.mechanisms}
    linkage = families[str(rng.choice(list(families)))](rng)
    if not all(np.isfinite(pin.at) for pin in linkage.pins):
        return None
    alone = index % 12 == 7  # a study with a single experiment
    fit, held_out = (1, 0) if alone else (FIT, HELD_OUT)
    record, release_s = _record(rng)
    starts = _starts(rng, linkage, fit + held_out)
    rig = _rig(linkage, starts, record)
    if rig is None:
        return None
    causes = _causes(rng, rig, stratum, limits.without)
    if causes is None:
        return None
    noise = _noise(rng, linkage)
    engine = "own"
    if peers.knows(causes) and rng.random() < SHARE_OF_PEERS:
        # Exudyn takes 10 s for what MuJoCo does in one where there are many bodies.
        engine = str(rng.choice(peers.ENGINES)) if len(linkage.links) < 4 else peers.ENGINES[0]
    witness = Witness(linkage, starts[:fit], record, noise)
    if engine != "own" and _betrays_itself(engine, witness):
        engine = "own"
    clean = reality(linkage, causes, _laws(linkage, causes), starts, record, engine)
    if not np.isfinite(clean).all() or np.abs(clean).max() > 10 * linkage.size:
        return None
    if stratum == "single" and causes[0].kind not in UNSCALED and rng.random() < SHARE_OF_FAINT:
        # Most sizes stand out plainly; some are brought to where a careful eye just sees them.
        d2 = distance(witness, clean[:fit], []).d2
        wanted = float(np.exp(rng.uniform(np.log(1.2 * ALIKE), np.log(80.0))))
        if d2 > wanted:
            causes = [scaled(causes[0], float(np.sqrt(wanted / d2)))]
            clean = reality(linkage, causes, _laws(linkage, causes), starts, record, engine)
    # A draw that nobody could see says nothing; a few are kept, for the smallest sizes belong to the range.
    if causes and rng.random() < TOO_FAINT and distance(witness, clean[:fit], []).d2 < ALIKE:
        return None
    label = _label(witness, rig, causes, stratum, clean[:fit], limits.without)
    if stratum == "pair" and _are_one(label):
        return None
    tables = np.stack([noisy(one, noise, rng) for one in clean])
    label |= {"engine": engine, "family": linkage.family, "sigma_m": noise.sigma_m, "sigma_told": noise.told,
              "rho": noise.rho, "experiments": len(starts)}  # fmt: skip
    return Case(linkage, record, release_s, tables, noise, fit, label)


def _betrays_itself(engine: str, witness: Witness) -> bool:
    """Whether these data would show an engine's own error where nothing is amiss: a real gap, of no name."""
    linkage, starts = witness.linkage, witness.starts
    clean = reality(linkage, [], _laws(linkage, []), starts, witness.record, engine)
    return not np.isfinite(clean).all() or distance(witness, clean, []).d2 >= ALIKE


def _are_one(label: dict[str, Any]) -> bool:
    """Whether the data allow one of a pair to be named as the other: then together they are one cause, not two."""
    first, second = [{(e["kind"], *e["on"]) for e in group} for group in label["classes"]]
    truths = [(e["kind"], *e["on"]) for e in label["effects"]]
    return truths[0] in second or truths[1] in first


def _laws(linkage: Linkage, causes: Sequence[Cause]) -> Laws:
    laws = as_drawn(linkage)
    for cause in causes:
        laws = changed(laws, cause.changes)
    return laws


def _record(rng: np.random.Generator) -> tuple[Record, float]:
    rate, moving_s = float(rng.choice([60.0, 90.0, 120.0])), float(rng.uniform(1.0, 1.8))
    elapsed = np.arange(STATIC_FRAMES + round(moving_s * rate)) / rate
    release_s = float((STATIC_FRAMES - rng.uniform(0.1, 0.9)) / rate)
    return Record(elapsed - release_s, elapsed), release_s


def _starts(rng: np.random.Generator, linkage: Linkage, count: int) -> np.ndarray:
    """Poses (experiments, movers) spread over the reach, both ends of it among the first two."""
    low, high = np.array(linkage.reach).T
    share = rng.uniform(0.05, 0.95, (count, len(low)))
    share[0] = rng.uniform(0.05, 0.3, len(low))
    share[1:2] = rng.uniform(0.7, 0.95, len(low))
    return low + share * (high - low)


def _noise(rng: np.random.Generator, linkage: Linkage) -> Noise:
    """0.5, 1 or 2 mm on a rig of half a metre, less on a smaller one that the camera stands nearer to."""
    level = float(rng.choice([0.5e-3, 1e-3, 2e-3])) * linkage.size / 0.5
    return Noise(level, float(rng.choice([0.0, 0.2, 0.4])), 0.02, 0.01, bool(rng.random() < 0.5))


def _rig(linkage: Linkage, starts: np.ndarray, record: Record) -> Rig | None:
    """The scales of the ideal motion; None where it is too lively, too touchy, or goes nowhere."""
    count = len(starts)
    near = np.concatenate([starts, starts + 1e-4])
    motion = move(linkage, as_drawn(linkage, 2 * count), near, record.duration_s, tolerance=1e-6)
    n = motion.plant.n
    q, v = motion.state[..., :n], motion.state[..., n : 2 * n]
    if not np.isfinite(q).all() or np.abs(v).max() > LIVELY:
        return None
    times = np.broadcast_to(motion.time_s, (2 * count, len(motion.time_s)))
    p = motion.markers(times)
    apart = np.abs(p[count:] - p[:count]).max((1, 2)) / np.maximum(np.abs(p[count:, 0] - p[:count, 0]).max(1), 1e-12)
    if apart.max() > TOUCHY or np.abs(p[:count] - p[:count, :1]).max((1, 2)).max() < 0.08 * linkage.size:
        return None
    turned = q[:count] @ motion.plant.tree.turned.T
    return Rig(
        linkage,
        np.stack([turned.min((0, 1)), turned.max((0, 1))], 1),
        np.stack([turned[:, 0].min(0), turned[:, 0].max(0)], 1),
    )


def _causes(rng: np.random.Generator, rig: Rig, stratum: str, without: Sequence[str]) -> list[Cause] | None:
    if stratum == "none":
        return []
    names = UNKNOWN if stratum == "never" else [name for name in KNOWN if name not in without]
    count = 2 if stratum == "pair" else 1
    drawn = [drawn_cause(rig, str(name), rng) for name in rng.choice(names, count, replace=False)]
    if any(cause is None for cause in drawn):
        return None
    causes = [cause for cause in drawn if cause]
    loose = any(cause.kind == "clearance" for cause in causes)
    if loose and any(cause.kind in ("pin_friction", "late_release") for cause in causes):
        return None
    return causes


def reality(
    linkage: Linkage, causes: Sequence[Cause], laws: Laws, starts: np.ndarray, record: Record, engine: str = "own"
) -> np.ndarray:
    """Clean records (experiments, times, markers) of one row of laws; crisp friction and stops."""
    count = len(starts)
    rows = laws.repeated(count)
    if engine == "own":
        path: Motion | peers.PeerPath = move(linkage, rows, starts, record.duration_s, crisp=True)
    else:
        path = peers.peer_path(engine, linkage, causes, starts, record.duration_s)
    return seen(path, rows, linkage.size, *record.rows(count))


def _label(
    witness: Witness, rig: Rig, causes: list[Cause], stratum: str, clean: np.ndarray, never: Sequence[str]
) -> dict[str, Any]:
    """What is true, which names the data allow for it, and how visible it is. never: kinds that no diagnosis knows."""
    own = {k for c in causes for k in (c.kind, *library.EQUIVALENT.get(c.kind, ()))}
    without = sorted({*never, *(own if stratum == "left_out" else ())})
    if stratum == "pair":
        far = [_beside(witness, rig, causes, k, clean, without) for k in range(2)]
        d2 = min(one.d2 for one in far)
    else:
        far = [_distance(witness, rig, causes, without, clean)]
        # What no library holds is as far as the nearest known cause, for a near one is rightly named.
        d2 = min([far[0].d2, *(far[0].remainders if stratum == "never" else ())])
    named = stratum in ("single", "pair")
    classes = [_class(causes[k] if named else None, one) for k, one in enumerate(far)] if causes else []
    seen = "none" if not causes else "<9" if d2 < ALIKE else "9-100" if d2 < 100 else ">100"
    return {
        "stratum": stratum,
        "effects": [_effect(cause) for cause in causes],
        "classes": classes,
        "without": without,
        "d2": d2,
        "bin": seen,
    }


def _class(truth: Cause | None, far: Distance) -> list[dict[str, Any]]:
    """The names that the data allow, the truth's first where the library knows it."""
    names = {(r.kind, r.on): r.places for r in far.alike}
    first = {(truth.kind, truth.on): truth.places} if truth else {}
    return [{"kind": k, "on": list(on), "places": list(at)} for (k, on), at in {**first, **names}.items()]


def _beside(
    witness: Witness, rig: Rig, causes: list[Cause], k: int, clean: np.ndarray, without: Sequence[str]
) -> Distance:
    """How visible one of a pair is beside the other."""
    rest = [cause for i, cause in enumerate(causes) if i != k]
    laws = _laws(rig.linkage, rest)
    record = reality(rig.linkage, rest, laws, witness.starts, witness.record)
    truth, rivals = causes[k], rivals_of(rig, [causes[k]], without)
    if truth.kind in WITHOUT_SLOPE:
        far = distance(witness, clean, rivals, (laws, record))
        return with_other_hinges(far, witness, rig, truth, laws, clean, partial(_crisp, witness))
    return confusion(witness, truth, rivals, laws, distance(witness, clean, [], (laws, record)).d2, rest)


def _distance(witness: Witness, rig: Rig, causes: list[Cause], without: Sequence[str], clean: np.ndarray) -> Distance:
    """How visible a single cause is, and how near its rivals come."""
    rivals = rivals_of(rig, causes, without) if causes else []
    if not causes or causes[0].kind in (*WITHOUT_SLOPE, *UNKNOWN):
        far, drawn = distance(witness, clean, rivals), as_drawn(rig.linkage)
        if not causes or causes[0].kind in without:
            return far
        return with_other_hinges(far, witness, rig, causes[0], drawn, clean, partial(_crisp, witness))
    return confusion(witness, causes[0], rivals, as_drawn(rig.linkage), distance(witness, clean, []).d2)


def _crisp(witness: Witness, laws: Laws) -> np.ndarray:
    """Clean records of a row of laws, moved by this generator's own engine."""
    return reality(witness.linkage, (), laws, witness.starts, witness.record)


def _effect(cause: Cause) -> dict[str, Any]:
    return {
        "kind": cause.kind,
        "on": list(cause.on),
        "places": list(cause.places),
        "parameters": {name: float(value) for name, value in cause.parameters.items()},
    }
