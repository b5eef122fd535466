"""Loose pins, pads on the bed and touching links as Exudyn's items.

A loose pin is a sphere in a hollow sphere (Exudyn's own contact, in C++): linear stiffness, Coulomb friction at the
contact point, linear damping where blows are inelastic, else Hunt and Crossley's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from backend.blind.contacts import DEAD, DEAD_BLOW, Capsules, Pads, hunt_crossley, pair_mass
from backend.blind.poses import cross, quaternion, rotation_matrix

if TYPE_CHECKING:
    from backend.blind.drawing import DrawnJoint
    from backend.blind.exudyn_model import ExudynModel

# rad a step, of the free bodies on what stands for a rigid link's wall.  Its damper, ten times critical, then acts in
# half a step; a faster one rings (by -0.9 a step, the integrator's spectral radius) and, since it cannot pull, throws
# the links apart.
FOLLOWED = 0.1
POINT = 1e-9  # m: Exudyn wants a sphere even where the drawing gives no pin


@dataclass(frozen=True)
class Walls:
    """How Exudyn's walls stand for rigid ones, and where its friction begins to slide.

    rigid_stiffness [N/m]: of walls without a stiffness of their own.  damping_ratio: their damping in inelastic blows,
    1 is critical for the free bodies that meet; soft_damping_ratio: that of walls with a stiffness of their own.
    creep [m/s]: contact friction is proportional to speed below it.  slowest_blow [m/s]: slower ones bounce less than
    they should, and Exudyn's wall can hold the pin a moment.
    """

    rigid_stiffness: float = 1e7
    damping_ratio: float = 10.0
    soft_damping_ratio: float = DEAD_BLOW
    creep: float = 3e-4
    slowest_blow: float = 1e-2

    def stiffness(self, drawn: float) -> float:
        """The wall's own, or what stands for a rigid one [N/m]."""
        return drawn if np.isfinite(drawn) else self.rigid_stiffness

    def ratio(self, drawn: float) -> float:
        """Damping over critical that takes a blow's energy."""
        return self.soft_damping_ratio if np.isfinite(drawn) else self.damping_ratio

    def damping(self, drawn: float, stiffness: float, mass: float) -> float:
        """Linear damper of that ratio [N s/m] on a wall of a stiffness, drawn or standing for a rigid one."""
        return 2.0 * self.ratio(drawn) * float(np.sqrt(stiffness * mass))


def add_play(model: ExudynModel, joint: DrawnJoint, markers: list[Any]) -> None:
    """The contact of a loose pin (body b) with its hole (body a); markers of a, b."""
    play, walls = joint.play, model.walls
    if play is None:
        return
    bodies = model.drawing.bodies
    ends = ((joint.a, joint.p_AF, joint.R_AF), (joint.b, joint.p_BF, joint.R_BF))
    mass = pair_mass([(bodies[i], p, R[:, 2]) for i, p, R in ends])
    dead, pin = play.restitution < DEAD, max(joint.pin_radius, POINT)
    stiffness, damping = model.wall(f'joint "{joint.id}"', play.stiffness, mass)
    state = model.items.NodeGenericData(initialCoordinates=[play.radial, 0, 0, 0], numberOfDataCoordinates=4)
    model.mbs.AddObject(
        model.items.ObjectContactSphereSphere(
            markerNumbers=[markers[1], markers[0]],
            nodeNumber=model.mbs.AddNode(state),
            spheresRadii=[pin, pin + play.radial],
            isHollowSphere1=True,
            dynamicFriction=play.friction,
            frictionProportionalZone=walls.creep,
            contactStiffness=stiffness,
            contactDamping=damping if dead else 0.0,
            contactStiffnessExponent=1.0,
            impactModel=0 if dead else 2,
            restitutionCoefficient=1.0 if dead else exudyn_restitution(play.restitution),
            minimumImpactVelocity=walls.slowest_blow,
        )
    )


def exudyn_restitution(restitution: float) -> float:
    """The number that makes Exudyn's impact model 2 return exactly `restitution`.

    Its c (see contacts.hunt_crossley) is 3/2 (1 - e)(11 - e)/(1 + 9 e) above 1/3 (Carvalho and Martins 2019), which is
    up to 2% off, and (1 - e²)/e below (Gonthier et al. 2004).
    """
    wanted = hunt_crossley(restitution)

    def c(e: float) -> float:
        return 1.5 * (1 - e) * (11 - e) / (1 + 9 * e) if e > 1 / 3 else (1 - e * e) / e

    low, high = 1e-9, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if c(middle) > wanted else (low, middle)
    return 0.5 * (low + high)


def add_pads(model: ExudynModel, pads: Pads) -> None:
    """Two pads under a body, each rubbing with a known force against its velocity along the bed."""
    creep2 = model.creep**2
    flat = np.eye(3) - np.outer(pads.normal, pads.normal)

    def rub(mbs, t, item, displacement, velocity, stiffness, damping, offset):
        v = flat @ np.asarray(velocity)
        return pads.force * v / np.sqrt(v @ v + creep2)

    for p in pads.points:
        markers = [model.marker(-1, np.zeros(3)), model.marker(pads.body, p)]
        model.mbs.AddObject(
            model.items.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, springForceUserFunction=rub)
        )


def add_capsules(model: ExudynModel, pair: Capsules) -> None:
    """Two capsules that push each other where their axes come nearest.

    A force of its own on the coordinates of both bodies: Exudyn's connector pushes each body at its own marker, and the
    couple of the two forces would turn the pair.
    """
    walls, bodies = model.walls, model.drawing.bodies
    middles = ((pair.a, pair.ends_A.mean(0)), (pair.b, pair.ends_B.mean(0)))
    mass = pair_mass([(bodies[i], p, np.eye(3)[2]) for i, p in middles])
    stiffness = walls.stiffness(pair.stiffness)
    if not np.isfinite(pair.stiffness):
        stiffness = min(stiffness, mass * (FOLLOWED / model.step_s) ** 2)
    damping = 2.0 * walls.ratio(pair.stiffness) * float(np.sqrt(stiffness * mass))
    dead, c = pair.restitution < DEAD, hunt_crossley(max(pair.restitution, DEAD))
    reach = pair.radius_a + pair.radius_b
    blow = {"speed": 0.0, "inside": False}
    moving = [i for i in (pair.a, pair.b) if not bodies[i].fixed]
    drawn = {i: np.array([*model.poses.p_WB[i], *quaternion(model.poses.R_WB[i][None])[0]]) for i in (pair.a, pair.b)}
    if not moving:
        return

    def forces(mbs, t, item, displaced, rates):
        """Generalised forces on position and Euler parameters of each moving body."""
        q, q_dot = ({i: np.zeros(7) for i in drawn} for _ in range(2))
        for place, i in enumerate(moving):
            here = slice(7 * place, 7 * place + 7)
            q[i], q_dot[i] = np.asarray(displaced[here], float), np.asarray(rates[here], float)
        q = {i: drawn[i] + q[i] for i in drawn}
        p, R = {i: q[i][:3] for i in q}, {i: rotation_matrix(q[i][3:]) for i in q}
        near_a, near_b = nearest_points(p[pair.a] + pair.ends_A @ R[pair.a].T, p[pair.b] + pair.ends_B @ R[pair.b].T)
        gap = near_b - near_a
        distance = float(np.linalg.norm(gap))
        depth = reach - distance
        if depth <= 0.0 or distance == 0.0:
            blow["inside"] = False
            return [0.0] * (7 * len(moving))
        n = gap / distance
        contact = near_a + (pair.radius_a - 0.5 * depth) * n

        def velocity(i: int) -> np.ndarray:
            return q_dot[i][:3] + cross(R[i] @ turning(q[i][3:]) @ q_dot[i][3:], contact - p[i])

        v = velocity(pair.b) - velocity(pair.a)
        approach = -float(v @ n)
        if not blow["inside"]:
            blow["inside"], blow["speed"] = True, max(approach, walls.slowest_blow)
        push = stiffness * depth
        push += damping * approach if dead else push * c * approach / blow["speed"]
        push = max(push, 0.0)
        slip = v - (v @ n) * n
        on_b = push * n - pair.friction * push * slip / np.sqrt(slip @ slip + walls.creep**2)
        made = []
        for i in moving:
            force = on_b if i == pair.b else -on_b
            made += [*force, *(turning(q[i][3:]).T @ R[i].T @ cross(contact - p[i], force))]
        return made

    size = 7 * len(moving)
    model.mbs.AddObject(
        model.items.ObjectGenericODE2(
            nodeNumbers=[model.nodes[i] for i in moving],
            massMatrix=np.zeros((size, size)),
            forceUserFunction=forces,
        )
    )


def turning(q: np.ndarray) -> np.ndarray:
    """G of ω = G q̇, ω in body axes, q a unit quaternion."""
    w, x, y, z = q
    return 2.0 * np.array([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])


def nearest_points(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points of two segments (2, 3 each) that are nearest to each other (Ericson 2005, 5.1.9)."""
    d1, d2, r = one[1] - one[0], other[1] - other[0], one[0] - other[0]
    a, e, b, c, f = d1 @ d1, d2 @ d2, d1 @ d2, d1 @ r, d2 @ r
    across = a * e - b * b
    s = np.clip((b * f - c * e) / across, 0.0, 1.0) if across > 1e-12 * a * e else 0.5
    t = (b * s + f) / e if e > 0.0 else 0.0
    if not 0.0 <= t <= 1.0:
        t = np.clip(t, 0.0, 1.0)
        s = np.clip((b * t - c) / a, 0.0, 1.0) if a > 0.0 else 0.0
    return one[0] + s * d1, other[0] + t * d2
