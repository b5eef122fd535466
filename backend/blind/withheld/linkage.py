"""A planar linkage as its maker knows it, and the mechanism.json that is drawn of it.

The plane of motion is the world's x-z plane, written as the complex number x + i z; gravity points along -z.  Angles
count from x towards z.  A link's own axes: x along the link, y across it in the plane, z along -y of the world, which
is every pin's axis; so a drawn pose is the quaternion of 90 degrees about x followed by the angle about z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
UPRIGHT = Rotation.from_euler("x", 90, degrees=True)  # the plane's axes (x, z, -y) in the world's


@dataclass(frozen=True)
class Link:
    """A rigid part.  place, angle: its frame in the plane as drawn [m, rad]; centre, markers: in its own axes [m].

    inertia: about the centre of mass, across the plane [kg m²].  ends: the stretch of x that the air meets [m].
    straight: whether both pins lie on the x axis, so that its length is one number.
    """

    id: str
    place: complex
    angle: float
    mass: float
    centre: complex
    inertia: float
    ends: tuple[float, float]
    width: float = 0.01
    markers: tuple[complex, ...] = ()
    straight: bool = True


@dataclass(frozen=True)
class Pin:
    """A joint at a drawn point [m]; bodies count from 1, 0 is the ground.  slide: unit direction, None turns."""

    id: str
    a: int
    b: int
    at: complex
    slide: complex | None = None
    radius: float = 0.004


@dataclass(frozen=True)
class Spring:
    """A drawn extension spring between a point of link a and one of link b, each in its own axes (0: the world)."""

    id: str
    a: int
    b: int
    p_A: complex
    p_B: complex
    stiffness: float
    free_length: float


@dataclass(frozen=True)
class Linkage:
    """Links, pins and springs.  movers: the pins whose coordinates set a start pose; reach: [low, high] of each.

    size: a length of the whole [m]; family: which kind of mechanism it is.
    """

    family: str
    links: tuple[Link, ...]
    pins: tuple[Pin, ...]
    movers: tuple[int, ...]
    reach: tuple[tuple[float, float], ...]
    springs: tuple[Spring, ...] = ()

    @property
    def size(self) -> float:
        """The spread of the drawn pins and markers [m]."""
        points = [pin.at for pin in self.pins]
        points += [link.place + np.exp(1j * link.angle) * m for link in self.links for m in link.markers]
        return float(max(np.ptp(np.real(points)), np.ptp(np.imag(points))))

    @property
    def markers(self) -> list[tuple[str, int, complex]]:
        """(id, link counted from 1, place in its axes) of every marker, in the file's order."""
        return [(f"{ln.id}_m{i}", k, m) for k, ln in enumerate(self.links, 1) for i, m in enumerate(ln.markers, 1)]

    def axes(self, body: int) -> complex:
        """The drawn direction of a body's x axis."""
        return complex(np.exp(1j * self.links[body - 1].angle)) if body else 1 + 0j

    def place(self, body: int) -> complex:
        """The drawn origin of a body [m]."""
        return self.links[body - 1].place if body else 0j

    def inside(self, body: int, point: complex) -> complex:
        """A drawn point of the plane in a body's axes [m]."""
        return (point - self.place(body)) * np.conj(self.axes(body))

    def name(self, body: int) -> str:
        """The id of a body."""
        return self.links[body - 1].id if body else "ground"


def vector(z: complex, body_axes: bool) -> list[float]:
    """(x, y, 0) in a link's axes, or (x, 0, z) in the world's."""
    return [float(z.real), float(z.imag), 0.0] if body_axes else [float(z.real), 0.0, float(z.imag)]


def _attitude(linkage: Linkage, body: int) -> Rotation:
    return UPRIGHT * Rotation.from_euler("z", linkage.links[body - 1].angle) if body else Rotation.identity()


def _quaternion(turn: Rotation) -> list[float]:
    return [float(x) for x in turn.as_quat(canonical=True, scalar_first=True)]


def _frame(linkage: Linkage, body: int, pin: Pin) -> dict[str, Any]:
    """The same frame of the world seen from either body, so that every coordinate is zero as drawn."""
    if pin.slide is None:
        turn = _attitude(linkage, pin.b)
    else:
        turn = UPRIGHT * Rotation.from_euler("ZY", [float(np.angle(pin.slide)), np.pi / 2])
    inside = _attitude(linkage, body).inv() * turn
    return {"position_m": vector(linkage.inside(body, pin.at), bool(body)), "quaternion_wxyz": _quaternion(inside)}


def _body(linkage: Linkage, index: int) -> dict[str, Any]:
    link = linkage.links[index - 1]
    thin = link.mass * link.width**2 / 6
    pose = {"position_m": vector(link.place, False), "quaternion_wxyz": _quaternion(_attitude(linkage, index))}
    inertia = {"xx": thin, "yy": link.inertia, "zz": link.inertia, "xy": 0.0, "xz": 0.0, "yz": 0.0}
    inertial = {"mass_kg": link.mass, "center_of_mass_m": vector(link.centre, True), "inertia_kg_m2": inertia}
    return {"id": link.id, "pose": pose, "inertial": inertial}


def document(linkage: Linkage) -> dict[str, Any]:
    """mechanism.json's content: what a drawing office would have handed over."""
    bodies = [{"id": "ground", "fixed": True}, *(_body(linkage, k) for k in range(1, len(linkage.links) + 1))]
    joints = [
        {
            "id": pin.id,
            "type": "revolute" if pin.slide is None else "prismatic",
            "body_a": linkage.name(pin.a),
            "body_b": linkage.name(pin.b),
            "frame_a": _frame(linkage, pin.a, pin),
            "frame_b": _frame(linkage, pin.b, pin),
            **({"fit": {"pin_diameter_m": 2 * pin.radius}} if pin.slide is None else {}),
        }
        for pin in linkage.pins
    ]
    springs = [
        {
            "id": s.id,
            "kind": "extension_spring",
            "on": [linkage.name(s.a), linkage.name(s.b)],
            "parameters": {
                "anchor_a_m": vector(s.p_A, bool(s.a)),
                "anchor_b_m": vector(s.p_B, bool(s.b)),
                "stiffness_n_per_m": s.stiffness,
                "free_length_m": s.free_length,
            },
        }
        for s in linkage.springs
    ]
    markers = [
        {"id": id, "body": linkage.name(body), "position_m": vector(place, True)} for id, body, place in linkage.markers
    ]
    return {
        "schema_version": "1.0",
        "name": linkage.family,
        "gravity_m_per_s2": [0.0, 0.0, -GRAVITY],
        "bodies": bodies,
        "joints": joints,
        "effects": springs,
        "markers": markers,
    }
