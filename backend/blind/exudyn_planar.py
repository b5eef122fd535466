"""A planar drawing whose every pin is loose, as Exudyn's 2-D bodies: no constraint is left, so that steps are explicit.

Newton's method stalls where dozens of loose pins strike or rub at once.  Without constraints no equations are solved:
each wall pushes by how deep its pin stands in it, and the steps are those of velocity Verlet, as short as walls want.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from backend.blind.contacts import DEAD, Capsules, pair_mass
from backend.blind.drawing import Drawing, DrawnJoint
from backend.blind.exudyn_model import ExudynModel
from backend.blind.poses import Poses

NORMAL = np.array([0.0, 0.0, 1.0])
FLAT = 1e-6  # rad between a joint's axis and the plane's normal, or between a guide and x or y
# Of the speed of a free body: how much a wall's damper takes in a step.  Links press on several walls at once, which
# press on other links: at 0.5 a scissor of 23 cells diverged, and at a quarter of that none did.
TAKEN = 0.15


class PlanarModel(ExudynModel):
    """The drawing as bodies that move along x and y and turn about z of W, each node in its centre of mass."""

    def everything(self, keep: list[tuple[int, ...]] | None) -> None:
        """All items.  ValueError where the drawing does not suit; `keep` is not used: nothing is held but guides."""
        for joint in self.drawing.joints:
            _suits(self.drawing, self.poses, joint)
        if self.drawing.pushes:
            raise ValueError("explicit steps know no external forces; leave them out, or explicit=False")
        super().everything(keep)

    def recorded(self) -> tuple[np.ndarray, Poses]:
        """Times and poses; heights above the plane and tilts are those drawn."""
        time_s, moved = super().recorded()
        for i in self.sensors:
            moved.p_WB[:, i, 2] = self.poses.p_WB[i, 2]
            moved.R_WB[:, i] = moved.R_WB[:, i] @ self.poses.R_WB[i]
            moved.w_WB_B[:, i] = moved.w_WB_B[:, i] @ self.poses.R_WB[i]
        return time_s, moved

    def marker(self, i: int, p: np.ndarray, R: np.ndarray | None = None) -> Any:
        """A marker at a point (and frame) of a body, in the plane."""
        R = np.eye(3) if R is None else R
        number, at = self.ground, np.asarray(p, float)
        if i >= 0:
            at, R = self.poses.R_WB[i] @ at, self.poses.R_WB[i] @ R
            if self.bodies[i] is None:
                at = at + self.poses.p_WB[i]
            else:
                number, at = self.bodies[i], at - self._middle(i)
        flat = self.exudyn.HT(rotation=R, translation=at * (1.0 - NORMAL))
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=number, localHT=flat))

    def wall(self, what: str, drawn: float, mass: float) -> tuple[float, float]:
        """Stiffness [N/m] and damper [N s/m] of a wall; a rigid one is as stiff as a step can follow.

        ValueError where a wall's own damper asks for shorter steps.
        """
        stiffness, ratio = self.walls.stiffness(drawn), self.walls.ratio(drawn)
        if not np.isfinite(drawn):
            stiffness = min(stiffness, mass * (TAKEN / (2.0 * ratio * self.step_s)) ** 2)
        damping = self.walls.damping(drawn, stiffness, mass)
        if (taken := damping * self.step_s / mass) > TAKEN * (1.0 + 1e-9):
            raise ValueError(
                f"{what}: its wall's damper takes {taken:.2g} of a speed in one step of {self.step_s} s; "
                f"write a step of {self.step_s * TAKEN / taken:.1g} s, or softer walls"
            )
        return stiffness, damping

    def _middle(self, i: int) -> np.ndarray:
        """From the body's origin to its centre of mass, in W as drawn."""
        return self.poses.R_WB[i] @ self.drawing.bodies[i].p_BC

    def _body(self, i: int) -> Any:
        body = self.drawing.bodies[i]
        if body.fixed:
            return None
        # At its drawn pose a node's axes are those of W, so that its body may be drawn at any turn.
        middle, n = self._middle(i), self.poses.R_WB[i].T @ NORMAL
        at = self.poses.p_WB[i] + middle
        turning = self.poses.R_WB[i] @ self.poses.w_WB_B[i]
        speed = self.poses.v_WB[i] + np.cross(turning, middle)
        node = self.mbs.AddNode(
            self.items.NodeRigidBody2D(
                referenceCoordinates=[at[0], at[1], 0.0], initialVelocities=[speed[0], speed[1], turning[2]]
            )
        )
        self.nodes[i] = node
        number = self.mbs.AddObject(
            self.items.ObjectRigidBody2D(mass=body.mass, inertia=float(n @ body.inertia @ n), nodeNumber=node)
        )
        mass = self.mbs.AddMarker(self.items.MarkerBodyMass(bodyNumber=number))
        pull = self.drawing.gravity * (1.0 - NORMAL)
        self.mbs.AddLoad(self.items.LoadMassProportional(markerNumber=mass, loadVector=pull))
        self.sensors[i] = self._recording(number, -middle * (1.0 - NORMAL))
        return number

    def _hold(self, joint: DrawnJoint, markers: list[Any], rows: tuple[int, ...] | None) -> None:
        """A guide's body keeps two of its three coordinates; a loose pin holds nothing in the plane."""
        if joint.type != "prismatic":
            return
        body = joint.b if self._still(joint.a) else joint.a
        along = int(np.argmax(np.abs(_axis(self.poses, joint))))
        ground = self.mbs.AddNode(self.items.NodePointGround())
        zero = self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        for k in {0, 1, 2} - {along}:
            held = self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[body], coordinate=k))
            self.mbs.AddObject(self.items.ObjectConnectorCoordinate(markerNumbers=[zero, held]))

    def _touching(self, pairs: list[Capsules]) -> None:
        """All capsules in one force on all nodes: Python is asked once a step."""
        if not pairs:
            return
        bodies, order = self.drawing.bodies, {i: place for place, i in enumerate(self.nodes)}
        ends = np.stack([[self._flat(pair.a, pair.ends_A), self._flat(pair.b, pair.ends_B)] for pair in pairs])
        place = np.array([[order.get(pair.a, len(order)), order.get(pair.b, len(order))] for pair in pairs])
        reach = np.array([pair.radius_a + pair.radius_b for pair in pairs])
        outer = np.array([pair.radius_a for pair in pairs]) / reach
        mass = np.array(
            [pair_mass([(bodies[i], p.mean(0), NORMAL) for i, p in ((c.a, c.ends_A), (c.b, c.ends_B))]) for c in pairs]
        )
        for pair in pairs:
            if pair.restitution >= DEAD or pair.friction:
                raise ValueError(
                    f'effect "{pair.id}": explicit steps know links that touch without bounce and friction'
                )
        walls = [self.wall(f'effect "{pair.id}"', pair.stiffness, m) for pair, m in zip(pairs, mass, strict=True)]
        stiff, damper = np.array(walls).T
        # The last row stands for all that is fixed.
        first = np.array([[*(self.poses.p_WB[i] + self._middle(i))[:2], 0.0] for i in self.nodes] + [[0.0] * 3])

        def forces(mbs, t, item, displaced, rates):
            """Generalised forces on x, y and the angle of every moving body."""
            q = first + np.append(np.asarray(displaced), np.zeros(3)).reshape(-1, 3)
            v = np.append(np.asarray(rates), np.zeros(3)).reshape(-1, 3)
            c, s = np.cos(q[place, 2]), np.sin(q[place, 2])
            turn = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
            on = q[place, None, :2] + np.einsum("nbij,nbkj->nbki", turn, ends)
            near_a, near_b = nearest(on[:, 0], on[:, 1])
            gap = near_b - near_a
            far = np.linalg.norm(gap, axis=-1)
            depth = reach - far
            made = np.zeros_like(q)
            meet = np.flatnonzero(depth > 0.0)
            if not len(meet):
                return made[:-1].ravel()
            n = gap[meet] / np.maximum(far[meet], 1e-12)[:, None]
            at = near_a[meet] + outer[meet, None] * gap[meet]
            arm = at[:, None] - q[place[meet], :2]
            speed = v[place[meet], :2] + v[place[meet], 2:] * np.stack([-arm[..., 1], arm[..., 0]], -1)
            opening = np.einsum("ni,ni->n", speed[:, 1] - speed[:, 0], n)
            push = np.maximum(stiff[meet] * depth[meet] - damper[meet] * opening, 0.0)[:, None] * n
            for side, sign in ((0, -1.0), (1, 1.0)):
                moment = arm[:, side, 0] * push[:, 1] - arm[:, side, 1] * push[:, 0]
                np.add.at(made, place[meet, side], sign * np.column_stack([push, moment]))
            return made[:-1].ravel()

        size = 3 * len(order)
        self.mbs.AddObject(
            self.items.ObjectGenericODE2(
                nodeNumbers=list(self.nodes.values()), massMatrix=np.zeros((size, size)), forceUserFunction=forces
            )
        )

    def _flat(self, i: int, points: np.ndarray) -> np.ndarray:
        """Points of a body (N, 3) from its node, axes as W when drawn; from W's origin where it is fixed."""
        at = points @ self.poses.R_WB[i].T
        at = at + self.poses.p_WB[i] if self.bodies[i] is None else at - self._middle(i)
        return at[:, :2]


def nearest(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest points (N, 2) of pairs of plane segments (N, 2, 2) that do not cross: one of them is an end."""
    feet = [(_foot(one[:, k], other), one[:, k], False) for k in (0, 1)]
    feet += [(_foot(other[:, k], one), other[:, k], True) for k in (0, 1)]
    on_one = np.stack([foot if swapped else end for foot, end, swapped in feet])
    on_other = np.stack([end if swapped else foot for foot, end, swapped in feet])
    best = np.argmin(((on_one - on_other) ** 2).sum(-1), axis=0)
    each = np.arange(len(one))
    return on_one[best, each], on_other[best, each]


def _foot(point: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Where a segment (N, 2, 2) is nearest to a point (N, 2)."""
    along = segment[:, 1] - segment[:, 0]
    share = np.einsum("ni,ni->n", point - segment[:, 0], along) / np.maximum((along**2).sum(-1), 1e-30)
    return segment[:, 0] + np.clip(share, 0.0, 1.0)[:, None] * along


def _axis(poses: Poses, joint: DrawnJoint) -> np.ndarray:
    """A joint's z in W."""
    return (joint.R_AF if joint.a < 0 else poses.R_WB[joint.a] @ joint.R_AF)[:, 2]


def _suits(drawing: Drawing, poses: Poses, joint: DrawnJoint) -> None:
    """ValueError where a joint is neither a loose pin across the plane nor a guide along x or y of a fixed body."""
    axis = _axis(poses, joint)
    if joint.type == "revolute" and joint.play and np.linalg.norm(np.cross(axis, NORMAL)) < FLAT:
        return
    ends = [i < 0 or drawing.bodies[i].fixed for i in (joint.a, joint.b)]
    if joint.type == "prismatic" and any(ends) and np.sort(np.abs(axis))[1] < FLAT and abs(axis[2]) < FLAT:
        return
    raise ValueError(
        f'joint "{joint.id}": explicit steps want the x-y plane, every pin loose, guides of fixed bodies along x or y; '
        "give its pin a clearance, or explicit=False"
    )
