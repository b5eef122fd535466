"""Kinematics of a planar linkage in tree coordinates: positions, Jacobians and centripetal terms of its points.

A spanning tree carries one coordinate per joint; a loose pin carries three (its turn and two offsets in its hole); the
joints left over close loops.  A point is a sum of fixed vectors of the links on its way to the ground, each turned
by its link, so in complex numbers p = Σ_k E_k D_k with E = exp(i θ) and θ = θ_drawn + T q, and slides add s E u.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from backend.blind.withheld.laws import Laws
from backend.blind.withheld.linkage import Linkage


@dataclass(frozen=True)
class Slide:
    """A coordinate that moves bodies along a direction fixed in body `parent`."""

    coordinate: int
    parent: int
    direction: complex
    carried: frozenset[int]


class Tree:
    """Which coordinate moves what.  loose: pins that run free in their holes.

    T (bodies, n): bodies by coordinates that turn them, body 0 the ground.  slides: the coordinates that shift.
    turned (joints, n): the rate of each pin's own coordinate, loop pins too.  closing: pins that close loops.
    below (joints, bodies): the bodies a tree pin carries.
    """

    def __init__(self, linkage: Linkage, loose: Collection[int] = ()):
        self.linkage, self.loose = linkage, tuple(sorted(loose))
        pins, bodies = linkage.pins, len(linkage.links) + 1
        path: dict[int, list[tuple[int, int, int]]] = {0: []}  # body -> (pin, from, to) on its way from the ground
        order: list[int] = []
        grew = True
        while grew:
            grew = False
            ready = [j for j, pin in enumerate(pins) if j not in order and (pin.a in path) != (pin.b in path)]
            # Slides stay in the tree, for a loop is closed by a pin's two equations; loose pins stay out if they can.
            ready.sort(key=lambda j: (j in self.loose, pins[j].slide is None, j))
            for j in ready[:1]:
                here, there = (pins[j].a, pins[j].b) if pins[j].a in path else (pins[j].b, pins[j].a)
                path[there] = [*path[here], (j, here, there)]
                order.append(j)
                grew = True
        self.path, self.closing = path, [j for j in range(len(pins)) if j not in order and j not in self.loose]
        self.ghosts = [j for j in self.loose if j not in order]  # loose pins of loops: nothing but their contact
        count = 0
        self.slides: list[Slide] = []
        turns: dict[int, int] = {}
        self.offsets: dict[int, tuple[int, int]] = {}
        columns: list[tuple[int, float, frozenset[int]]] = []
        for j in order:
            carried = frozenset(body for body, way in path.items() if any(step[0] == j for step in way))
            parent = next(step[1] for way in path.values() for step in way if step[0] == j)
            forward = 1.0 if parent == pins[j].a else -1.0
            slide = pins[j].slide
            if slide is not None:
                direction = slide * np.conj(linkage.axes(parent)) * forward
                self.slides.append(Slide(count, parent, complex(direction), carried))
            else:
                columns.append((count, forward, carried))
            turns[j] = count
            count += 1
            if j in self.loose:
                for k, direction in enumerate((1.0, 1j)):
                    self.slides.append(Slide(count + k, parent, direction * forward, carried))
                self.offsets[j] = (count, count + 1)
                count += 2
        self.n = count
        self.T = np.zeros((bodies, count))
        for column, sign, carried in columns:
            self.T[sorted(carried), column] = sign
        self.turned = np.zeros((len(pins), count))
        for j, pin in enumerate(pins):
            if pin.slide is not None:
                self.turned[j, turns[j]] = 1.0
            else:
                self.turned[j] = self.T[pin.b] - self.T[pin.a]
        self.coordinate = turns
        self.below = np.zeros((len(pins), bodies))
        for j in order:
            pin = pins[j]
            carried = [body for body, way in path.items() if any(step[0] == j for step in way)]
            self.below[j, carried] = 1.0 if pin.b in carried else -1.0
        self.drawn_angles = np.array([0.0, *(link.angle for link in linkage.links)])

    def points(self, bodies: list[int], inside: np.ndarray, laws: Laws) -> np.ndarray:
        """D (rows, points, bodies) of points given in the axes of their bodies (rows, points)."""
        linkage, rows = self.linkage, len(inside)
        D = np.zeros((rows, len(bodies), self.T.shape[0]), complex)
        for i, body in enumerate(bodies):
            for j, here, there in self.path[body]:
                D[:, i, here] += self.stretched(here, linkage.inside(here, linkage.pins[j].at), laws)
                D[:, i, there] -= self.stretched(there, linkage.inside(there, linkage.pins[j].at), laws)
            D[:, i, body] += inside[:, i]
        return D

    def stretched(self, body: int, point: complex | np.ndarray, laws: Laws) -> np.ndarray:
        """A point in its body's axes once the body is longer along x (rows,)."""
        stretch = laws.stretch[:, body - 1] if body else np.zeros(laws.rows)
        return np.real(point) * (1 + stretch) + 1j * np.imag(point)

    def shifts(self, bodies: list[int]) -> np.ndarray:
        """U (points, slides): how a unit of each slide moves each point, in the slide's parent."""
        return np.array(
            [[s.direction if body in s.carried else 0j for s in self.slides] for body in bodies], complex
        ).reshape(len(bodies), len(self.slides))


@dataclass(frozen=True)
class Turned:
    """The bodies of all rows at an instant: E (rows, bodies) their directions, ω (rows, bodies) their rates."""

    tree: Tree
    q: np.ndarray
    v: np.ndarray
    E: np.ndarray
    w: np.ndarray

    def place(self, points: Points) -> np.ndarray:
        """(rows, points) [m]."""
        return self._spokes(points).sum(-1)

    def _spokes(self, points: Points) -> np.ndarray:
        """(rows, points, bodies): what each body's turn sweeps."""
        spokes = points.D * self.E[:, None, :]
        for k, s in enumerate(self.tree.slides):
            spokes[:, :, s.parent] += (self.q[:, s.coordinate] * self.E[:, s.parent])[:, None] * points.U[:, k]
        return spokes

    def motion(self, points: Points) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places p, Jacobian J (rows, points, n) and what p̈ has beside J q̈ (rows, points)."""
        spokes = self._spokes(points)
        J = 1j * (spokes @ self.tree.T)
        rest = -(spokes @ (self.w**2)[:, :, None])[..., 0]
        for k, s in enumerate(self.tree.slides):
            along = self.E[:, s.parent, None] * points.U[:, k]
            J[:, :, s.coordinate] += along
            rest += 2j * (self.v[:, s.coordinate] * self.w[:, s.parent])[:, None] * along
        return spokes.sum(-1), J, rest


@dataclass(frozen=True)
class Points:
    """Points of bodies: D (rows, points, bodies) and U (points, slides), see Tree."""

    bodies: list[int]
    D: np.ndarray
    U: np.ndarray


def points(tree: Tree, bodies: list[int], inside: np.ndarray, laws: Laws) -> Points:
    """The tables of points given in the axes of their bodies (rows, points)."""
    return Points(bodies, tree.points(bodies, inside, laws), tree.shifts(bodies))


def gap(one: Points, other: Points) -> Points:
    """The vector from the other points to the first ones."""
    return Points(one.bodies, one.D - other.D, one.U - other.U)


def turned(tree: Tree, q: np.ndarray, v: np.ndarray) -> Turned:
    """All bodies at coordinates q and rates v (rows, n)."""
    return Turned(tree, q, v, np.exp(1j * (tree.drawn_angles + q @ tree.T.T)), v @ tree.T.T)
