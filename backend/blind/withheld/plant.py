"""The differential equations of a planar linkage under a set of laws: many realities as the rows of one batch.

M q̈ = Q + Jφᵀ λ with the loops' φ(q) = 0 held by φ̈ = -2 α φ̇ - α² φ (Baumgarte 1972); M from the Jacobians of the
centres of mass (Kane and Levinson 1985, ch. 6).  The force a tree pin carries follows from the bodies it carries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.blind.withheld import contact, forces
from backend.blind.withheld.laws import Laws
from backend.blind.withheld.linkage import GRAVITY, Linkage, Pin
from backend.blind.withheld.plane import Points, Tree, Turned, gap, points, turned

BACK_PER_S = 60.0  # α: loops drift by rounding only, and the release never shows it
GAUSS = np.polynomial.legendre.leggauss(5)  # exact for |v| v while a link does not turn about a point of its own


@dataclass(frozen=True)
class _Acting:
    """All that acts but dry friction: mass matrix, generalised force, and what the pins' loads follow from."""

    M: np.ndarray
    smooth: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    yielding: np.ndarray
    sloshing: np.ndarray
    J: np.ndarray
    rest: np.ndarray
    fall: np.ndarray
    outside: np.ndarray


class Plant:
    """A linkage under laws (rows of them).  crisp: friction by LuGre's bristles; else a smooth sign.

    State (rows, width): q, q̇, bristles of each pin, hysteresis of each pin, and four numbers of each sloshing load.
    """

    def __init__(self, linkage: Linkage, laws: Laws, crisp: bool = False):
        self.linkage, self.laws = linkage, laws
        loose = np.flatnonzero(np.any(laws.play > 0, 0)) if laws.has("play") else ()
        self.tree = tree = Tree(linkage, [int(j) for j in loose])
        self.n, self.pins = tree.n, len(linkage.pins)
        links = linkage.links
        self.rubs = laws.has("coulomb", "rub", "bump")
        self.bristles = crisp and laws.has("coulomb", "rub", "bump")
        self.yields, self.sloshes = laws.has("yielding"), laws.has("slosh")
        self.mass = np.array([link.mass for link in links]) * (1 + laws.heavier)
        inertia = np.array([link.inertia for link in links]) * (1 + laws.heavier) * (1 + laws.inertia)
        self.inertia = inertia * (1 + laws.stretch) ** 2
        moving = list(range(1, len(links) + 1))
        centre = np.stack([tree.stretched(k, links[k - 1].centre, laws) for k in moving], 1) + laws.centre
        self.centres = points(tree, moving, centre, laws)
        at = [linkage.pins[j] for j in tree.closing]
        self.loops = gap(self._pins(at, "a"), self._pins(at, "b"))
        at = [linkage.pins[j] for j in tree.loose]
        self.holes = gap(self._pins(at, "b"), self._pins(at, "a"))
        ends = [[s.a, s.p_A] for s in linkage.springs], [[s.b, s.p_B] for s in linkage.springs]
        self.struts = gap(*(self._points([b for b, _ in side], [p for _, p in side]) for side in ends))
        self.tied = np.zeros((len(linkage.springs), len(links)))
        for k, s in enumerate(linkage.springs):
            for end, sign in ((s.a, 1.0), (s.b, -1.0)):
                if end:
                    self.tied[k, end - 1] += sign
        stations = np.array([0.5 * (e[0] + e[1]) + 0.5 * (e[1] - e[0]) * GAUSS[0] for e in (ln.ends for ln in links)])
        self.lengths = np.array([ln.ends[1] - ln.ends[0] for ln in links])
        self.air = self._points(np.repeat(moving, len(GAUSS[0])).tolist(), list(stations.ravel().astype(complex)))
        self.turning = np.array([pin.slide is None for pin in linkage.pins])
        self.rotary = np.einsum("rk,kn,km->rnm", self.inertia, tree.T[1:], tree.T[1:])
        self.rotary = self.rotary + np.einsum("rj,jn,jm->rnm", laws.rotor, tree.turned, tree.turned)
        # The rig turns z towards x about world y, so in its own axes gravity turns back.
        self.gravity = GRAVITY * (np.sin(laws.tilt) - 1j * np.cos(laws.tilt))

    def _points(self, bodies: list[int], inside: list[complex]) -> Points:
        at = [self.tree.stretched(b, p, self.laws) for b, p in zip(bodies, inside, strict=True)]
        table = np.stack(at, 1) if at else np.zeros((self.laws.rows, 0), complex)
        return points(self.tree, bodies, table, self.laws)

    def _pins(self, pins: list[Pin], side: str) -> Points:
        bodies = [getattr(pin, side) for pin in pins]
        return self._points(bodies, [self.linkage.inside(b, pin.at) for b, pin in zip(bodies, pins, strict=True)])

    @property
    def width(self) -> int:
        """Numbers in a row of the state."""
        return 2 * self.n + self.pins * (self.bristles + self.yields) + 4 * len(self.linkage.links) * self.sloshes

    def split(self, state: np.ndarray) -> tuple[np.ndarray, ...]:
        """q, q̇, bristles, hysteresis and slosh of a state (rows, width)."""
        cuts = np.cumsum([self.n, self.n, self.pins * self.bristles, self.pins * self.yields])
        return tuple(np.split(state, cuts, 1))

    def slope(self, time_s: float, state: np.ndarray) -> np.ndarray:
        """d state / dt (rows, width)."""
        q, v, bristle, yielded, slosh = self.split(state)
        now = turned(self.tree, q, v)
        return self._solve(time_s, now, bristle, yielded, slosh)

    def joint_angles(self, q: np.ndarray) -> np.ndarray:
        """Each pin's own coordinate (rows, joints) [rad or m]."""
        return q @ self.tree.turned.T

    def _solve(self, time_s: float, now: Turned, bristle: np.ndarray, yielded: np.ndarray, slosh: np.ndarray):
        laws, tree = self.laws, self.tree
        rows, n = now.q.shape
        on = self._acting(time_s, now, yielded, slosh)
        K, right = self._closed(on.M, now)
        full = np.zeros((rows, K.shape[-1]))
        bristling, load, a = np.zeros_like(bristle), np.zeros_like(on.rate), on.smooth
        passes = 1 + 2 * laws.has("rub")  # the load depends on the friction it makes, weakly: pins are thin
        for k in range(passes):
            total = on.smooth
            if self.rubs:
                bent = bristle if self.bristles else None
                rub, bending = forces.friction(laws, on.angle, on.rate, load, bent, self.turning)
                total = on.smooth + rub @ tree.turned
                bristling = bending if self.bristles else bristling
            full[:, :n], full[:, n:] = total, right
            solved = np.linalg.solve(K, full[..., None])[..., 0]
            a = solved[:, :n]
            if k + 1 < passes:
                load = np.abs(self._carried(on, a, solved[:, n:]))
        return np.concatenate([now.v, a, bristling, on.yielding, on.sloshing], 1)

    def _acting(self, time_s: float, now: Turned, yielded: np.ndarray, slosh: np.ndarray) -> _Acting:
        laws, tree = self.laws, self.tree
        p, J, rest = now.motion(self.centres)
        angle, rate = now.q @ tree.turned.T, now.v @ tree.turned.T
        fall = self.gravity[:, None]
        if laws.has("sway"):
            fall = fall - forces.base_acceleration(laws, time_s)[:, None]
        outside = np.zeros_like(p)  # what acts at the centres beside weight
        speed = (J @ now.v[:, :, None])[..., 0]
        sloshing, yielding = np.zeros_like(slosh), np.zeros_like(yielded)
        if laws.has("slow"):
            outside = outside - laws.slow * speed
        if laws.has("gust"):
            outside = outside + forces.gust(laws, time_s)[:, None] * self.lengths
        if self.sloshes:
            pull, sloshing = forces.slosh(laws, self.mass, p, speed, fall, slosh)
            outside = outside + pull
        M = np.real(np.conj(J.transpose(0, 2, 1)) @ (self.mass[:, :, None] * J)) + self.rotary
        Q = _along(J, self.mass * (fall - rest) + outside)
        if laws.has("drag"):
            Q += self._drag(now)
        if self.linkage.springs:
            gap_, Jg, _ = now.motion(self.struts)
            tension = forces.strut(self.linkage, laws, gap_, (Jg @ now.v[:, :, None])[..., 0])
            Q += _along(Jg, tension)
            outside = outside + tension @ self.tied
        effort = forces.joint_effort(laws, time_s, angle, rate)
        if self.yields:
            torque, yielding = forces.hysteresis(laws, rate, yielded)
            effort = effort + torque
        if tree.loose:
            off, Jh, _ = now.motion(self.holes)
            leaving = (Jh @ now.v[:, :, None])[..., 0]
            Q += _along(Jh, contact.in_hole(off, leaving, laws.play[:, list(tree.loose)], self.mass.sum(1)))
        smooth = Q + effort @ tree.turned
        return _Acting(M, smooth, angle, rate, yielding, sloshing, J, rest, fall, outside)

    def _closed(self, M: np.ndarray, now: Turned) -> tuple[np.ndarray, np.ndarray]:
        """The bordered matrix, and what the loops' rows ask for."""
        rows, n = now.q.shape
        m = 2 * len(self.loops.bodies)
        if not m:
            return M, np.zeros((rows, 0))
        phi, Jc, rest = now.motion(self.loops)
        A = np.concatenate([np.real(Jc), np.imag(Jc)], 1)
        K = np.zeros((rows, n + m, n + m))
        K[:, :n, :n], K[:, :n, n:], K[:, n:, :n] = M, A.transpose(0, 2, 1), A
        speed = (Jc @ now.v[:, :, None])[..., 0]
        want = -rest - 2 * BACK_PER_S * speed - BACK_PER_S**2 * phi
        return K, np.concatenate([np.real(want), np.imag(want)], 1)

    def _carried(self, on: _Acting, a: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """The force each pin puts on its body b (rows, joints), complex [N]; the air's share is left out."""
        tree = self.tree
        needed = self.mass * ((on.J @ a[:, :, None])[..., 0] + on.rest - on.fall) - on.outside
        carried = needed @ tree.below[:, 1:].T
        count = len(tree.closing)
        # K x = (Q; ...) has + Aᵀ x: the multipliers stand for minus the force on body a.
        pull = -(multipliers[:, :count] + 1j * multipliers[:, count:])
        for k, j in enumerate(tree.closing):
            pin = self.linkage.pins[j]
            carried -= np.outer(pull[:, k], tree.below[:, pin.a]) - np.outer(pull[:, k], tree.below[:, pin.b])
            carried[:, j] = -pull[:, k]
        return carried

    def _drag(self, now: Turned) -> np.ndarray:
        """Quadratic drag across each link, summed over its length by Gauss's rule (rows, n)."""
        _, J, _ = now.motion(self.air)
        v = (J @ now.v[:, :, None])[..., 0]
        along = now.E[:, self.air.bodies]
        across = np.imag(v * np.conj(along))
        weight = np.repeat(self.laws.drag * self.lengths, len(GAUSS[0]), 1) * np.tile(0.5 * GAUSS[1], len(self.lengths))
        force = -weight * np.abs(across) * across * 1j * along
        return _along(J, force)


def _along(J: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Generalised force (rows, n) of forces at points (rows, points) with Jacobians J."""
    return np.real(np.conj(J) * force[:, :, None]).sum(1)
