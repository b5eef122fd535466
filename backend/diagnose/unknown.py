"""How probable it is that something outside the library causes the gap: a law of unknown form at one place.

At a joint, a force that depends on where the joint is, how fast it moves and how fast it speeds up, the same in every
experiment; of a marker or the whole picture, a shift that depends on where it is seen, a flutter, or a clock that runs
unevenly; of the whole rig, a kick at the release; or, with no law at all, forces and shifts against time. Each is a
handful of columns with sizes that are not known beforehand, and pays for them in evidence as every cause does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from backend.diagnose.adequacy import scaled
from backend.diagnose.bumps import bumps_at
from backend.diagnose.fitted import Fitted
from backend.diagnose.flutter import flutters, waves
from backend.diagnose.latent import Beside, Latent, evidence, log_mean, markers_and_axes, warp
from backend.diagnose.screen import library_slopes
from backend.diagnose.seer import Seer
from backend.diagnose.softness import softness
from backend.diagnose.subject import SAME, Subject

CREEP = 0.05  # of the fastest speed: where a law may turn over as dry friction does
CLOCK = 3  # powers of time by which a clock may run wrong
CLOCKS = ("time_offset", "frame_rate_error")  # effects that are the first of these
RIDGE = 1e-6
SILENT = 1e-9  # of all columns together: what moves so little says nothing
SPANS = 1e-7  # of the largest eigenvalue: what columns of unit length span
NAMED = {0: "effort_offset", 1: "torsion_spring", 4: "viscous_friction", 6: "coulomb_friction", 8: "rotor_inertia"}
"""Effects that are one of a joint's powers: see `_forms`. Where a joint slides, what goes with its acceleration is a
mass."""
ASIDE = "marker_offset"  # a marker's shift that is the same everywhere, as long as its body turns little
HATS = 10  # bumps over what a joint passes through, or over its speeds


@dataclass(frozen=True)
class Way:
    """In which something unknown may act at a place: whitened responses to what it is made of.

    law: whether it is a law of a few terms, and not against time; few: a law that may have a few of its terms alone;
    named: terms of which alone it would be effects of the library, and nothing unknown.
    """

    L: Float[np.ndarray, "n terms"]
    law: bool = False
    few: bool = False
    named: frozenset[int] = frozenset()

    def evidence(self, bare: Fitted, scale: float) -> float:
        """Log evidence of it beside a fit, had all sigmas been larger by `scale`."""
        L = self.L / np.maximum(np.linalg.norm(self.L, axis=0), 1e-300)
        if self.law:
            return _law_evidence(bare, L, self.few, self.named)
        return log_mean(evidence(bare, self.L / (scale * float(np.median(np.linalg.norm(self.L, axis=0))))))


@dataclass(frozen=True)
class Unknown:
    """What is unknown, place by place, to first order about a fit. bare: that fit, with its causes' share put back."""

    fitted: Fitted
    bare: Fitted
    ways: dict[str, list[Way]]

    def log_z(self, scale: float) -> dict[str, float]:
        """Log evidence of something unknown at each place instead of the fit's causes, by place."""
        bare = scaled(self.bare, scale)
        return {at: log_mean([way.evidence(bare, scale) for way in ways]) for at, ways in self.ways.items()}

    def finer(self, more: Mapping[str, Float[np.ndarray, "n bumps"]]) -> Unknown:
        """With further ways against time."""
        ways = {at: list(self.ways.get(at, [])) for at in (*self.ways, *more)}
        for at, L in more.items():
            if (moves := np.linalg.norm(L, axis=0) > SILENT * np.linalg.norm(L)).any():
                ways[at].append(Way(L[:, moves]))
        return replace(self, ways={at: some for at, some in ways.items() if some})

    def softness(self) -> float:
        """Weight of the likelihood where even the way that leaves least leaves more than noise: see `softness`."""
        return max((softness(self._left(way)) for ways in self.ways.values() for way in ways), default=1.0)

    def _left(self, way: Way) -> Fitted:
        """What a way leaves, its terms as free as the fit."""
        A = np.concatenate([self.bare.J, way.L], 1)
        A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        w, V = np.linalg.eigh(A.T @ A)
        good = w > SPANS * w.max()
        taken = A @ (V[:, good] @ ((V[:, good].T @ (A.T @ self.bare.r)) / w[good]))
        return replace(self.bare, r=self.bare.r - taken, x=np.zeros(min(int(good.sum()), self.bare.r.size - 1)))


def unknown_about(fitted: Fitted, latent: Latent, raw: Sequence[Float[np.ndarray, "samples joints waves"]]) -> Unknown:
    """Every way in which something unknown may act, about a fit. The causes' share of the motion is put back, to first
    order about that motion, and the unknown has to account for it. raw: responses to forces about the fit's own motion.
    """
    ways = {
        at: [Way(L, True, few, _named(fitted.subject, at, L.shape[1]) if few else frozenset()) for few, L in laws]
        for at, laws in laws_of(fitted, raw).items()
    }
    for at, L in latent.places.items():
        ways.setdefault(at, []).append(Way(L))
    return Unknown(fitted, without_causes(fitted), {at: some for at, some in ways.items() if some})


def _named(subject: Subject, at: str, count: int) -> frozenset[int]:
    """Terms that an effect of the library is: of a joint's powers; of the picture's `count` terms, which end with a
    clock's powers of time; of a marker's shifts, as many, those that are the same everywhere.
    """
    if at == "camera":
        held = {c.kind for c in subject.library.candidates}
        return frozenset(count - CLOCK + power for power, kind in enumerate(CLOCKS) if kind in held)
    if at.startswith("marker:"):
        axes = {c.coordinate for p in subject.fit for c in p.data.channels if c.at == at}
        aside = any(c.kind == ASIDE and at in c.places for c in subject.library.candidates)
        return frozenset(range(0, count, max(count // len(axes), 1))) if aside else frozenset()
    if not at.startswith("joint:"):
        return frozenset()
    joint, topology = at.partition(":")[2], subject.model.topology
    slides = topology.joint_types[topology.joint_ids.index(joint)] == "prismatic"
    held = {c.kind for c in subject.library.candidates if joint in c.on}
    held |= {"rotor_inertia"} if slides and any(c.kind == "mass_error" for c in subject.library.candidates) else set()
    return frozenset(term for term, kind in NAMED.items() if kind in held)


def _law_evidence(bare: Fitted, L: Float[np.ndarray, "n terms"], few: bool, named: frozenset[int]) -> float:
    """Of a law of all terms, each of unit length; few: or of one of them, or of two, unless all of these are named."""
    terms = range(L.shape[1])
    beside = Beside.of(bare, L)
    ways = [[list(terms)]]
    if few:
        ways += [[list(some) for some in combinations(terms, k) if not named.issuperset(some)] for k in (1, 2)]
    return log_mean([log_mean([log_mean(beside.evidence(some)) for some in way]) for way in ways if way])


def without_causes(fitted: Fitted) -> Fitted:
    """The same motion and slopes, with what the causes do left unexplained: of no size, they have no shape either."""
    own, choice = fitted.choice.own, fitted.subject.choose()
    kept = [p.name for p in choice.parameters]
    names = [p.name for p in fitted.choice.parameters]
    shift = np.where(fitted.choice.sizes, fitted.values[:own] - fitted.choice.start[:own], 0.0)
    r, rest = fitted.r + fitted.J[:, :own] @ shift, fitted.J[:, own:]
    x, precision, held = fitted.x[own:], fitted.precision[own:], fitted.held[own:]
    if missing := [i for i, n in enumerate(kept) if n not in names[own:]]:  # tolerances that a cause had taken
        slopes = library_slopes(fitted, SAME, fitted.choice.candidates)
        takes = [take for c in fitted.choice.candidates for take in c.takes]
        for i in missing:
            own_index = next(k for k, p in enumerate(fitted.subject.library.parameters) if p.name == kept[i])
            j = next(number for number, take in enumerate(takes) if own_index in take)
            column = slopes[:, own_index]
            r = r - column * shift[j]
            rest, x = np.insert(rest, i, column, axis=1), np.insert(x, i, fitted.x[j])
            precision, held = np.insert(precision, i, choice.prior_sd[i] ** -2.0), np.insert(held, i, fitted.held[j])
    return replace(fitted, choice=choice, x=x, r=r, J=rest, precision=precision, held=held)


def laws_of(
    fitted: Fitted, raw: Sequence[Float[np.ndarray, "samples joints waves"]]
) -> dict[str, list[tuple[bool, Float[np.ndarray, "n terms"]]]]:
    """Whitened responses to the terms of laws at each place, and whether a law may have a few of them alone."""
    subject, probes = fitted.subject, fitted.probes
    seer = Seer(subject, probes, fitted.fraction)
    made: dict[str, list[tuple[bool, np.ndarray]]] = {}
    paths = [_path(fitted, i) for i in range(len(probes))]
    for j, id in enumerate(subject.joints):
        forms = _forms([t for t, _ in paths], [q[:, j] for _, q in paths])
        for few, shapes in forms:
            columns = []
            for p, white, (time, _), shape, response in zip(probes, seer.white, paths, shapes, raw, strict=True):
                B = bumps_at(time, p.duration_s, p.bumps.shape[1])
                G = B.T @ B
                sizes = np.linalg.solve(G + RIDGE * np.trace(G) / len(G) * np.eye(len(G)), B.T @ shape)
                columns.append(white(response[:, j] @ sizes))
            made.setdefault(f"joint:{id}", []).append((few, np.concatenate(columns)))
    made["world"] = [(False, kick) for kick in _kicks(fitted, seer)]
    markers, axes = markers_and_axes(fitted)
    if markers:
        made["camera"] = [(True, np.concatenate([warp(fitted, seer, axes), _clock(fitted, seer)], 1))]
        if len(markers) > 1:
            made |= {m: [(True, warp(fitted, seer, axes, m))] for m in markers}
        for marker, hz in flutters(fitted, markers).items():
            law = np.asarray(block_diag(*waves(fitted, marker, hz)))
            made[marker if len(markers) > 1 else "camera"].append((False, law))
    return {k: [(few, L) for few, L in forms if L.shape[1] and np.linalg.norm(L) > 0] for k, forms in made.items()}


def _path(fitted: Fitted, i: int) -> tuple[Float[np.ndarray, " times"], Float[np.ndarray, "times joints"]]:
    probe, subject = fitted.probes[i], fitted.subject
    q = probe.coordinates(fitted.values, fitted.own(i))
    ids = subject.model.topology.joint_ids
    return np.linspace(0.0, probe.duration_s, len(q)), q[:, [ids.index(j) for j in subject.joints]]


def _forms(
    times: Sequence[np.ndarray], q: Sequence[np.ndarray]
) -> list[tuple[bool, list[Float[np.ndarray, "times terms"]]]]:
    """Terms of four kinds of law, in units of their own reach over the experiments: a few powers of position, speed
    and acceleration; any smooth function of position; any of speed; friction that is of another size at every place.
    """
    v = [np.gradient(x, t) for t, x in zip(times, q, strict=True)]
    a = [np.gradient(x, t) for t, x in zip(times, v, strict=True)]
    every = np.concatenate(q)
    middle = 0.5 * (float(every.max()) + float(every.min()))
    reach = [max(float(np.abs(np.concatenate(u) - m).max()), 1e-300) for u, m in ((q, middle), (v, 0.0), (a, 0.0))]
    powers, place, speed, rough = [], [], [], []
    for x, y, z in zip(q, v, a, strict=True):
        x, y, z = (x - middle) / reach[0], y / reach[1], z / reach[2]
        powers.append(np.stack([x**0, x, x**2, x**3, y, y * np.abs(y), np.tanh(y / CREEP), x * y, z], 1))
        place.append(_hats(x))
        speed.append(np.concatenate([_hats(y), np.tanh(y / CREEP)[:, None]], 1))
        rough.append(_hats(x) * np.tanh(y / CREEP)[:, None])
    return [(True, powers), (False, place), (False, speed), (False, rough)]


def _hats(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n hats"]:
    """Bumps over -1 to 1, as in time."""
    return bumps_at(x + 1.0, 2.0, HATS)


def _kicks(fitted: Fitted, seer: Seer) -> list[Float[np.ndarray, "n kicks"]]:
    """Responses to rates that the release gives, the same in every experiment or of each by itself."""
    found = []
    for i, (p, white) in enumerate(zip(fitted.rough, seer.white, strict=True)):
        found.append(white(np.nan_to_num(p.kick_slopes(fitted.gliding, fitted.own(i)))))
    return [np.concatenate(found), np.asarray(block_diag(*found))]


def _clock(fitted: Fitted, seer: Seer) -> Float[np.ndarray, "n powers"]:
    """Shifts along the motion by powers of time."""
    columns = []
    for i, (p, white) in enumerate(zip(fitted.probes, seer.white, strict=True)):
        value = np.nan_to_num(p.predict(fitted.values, fitted.own(i))[0])
        rate = np.zeros_like(value)
        for c in range(len(p.data.channels)):
            rows = np.flatnonzero(p.data.channel == c)
            if rows.size > 1:
                rate[rows] = np.gradient(value[rows], p.data.time_s[rows])
        rate[p.data.still] = 0.0
        share = p.since_release_s / p.duration_s
        columns.append(white(rate[:, None] * share[:, None] ** np.arange(CLOCK)))
    return np.concatenate(columns)
