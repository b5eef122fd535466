"""A fitted mechanism in terms that other simulators share: rigid bodies, joints with their numbers, springs, drives.

World axes W; points and axes are given in a body's own CAD frame, SI.  The pose is that in which a simulation starts.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

FLAT = 1e-9  # of the inertia: second moment of mass across a plate without thickness

Vector = Float[np.ndarray, "3"]
Matrix = Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class TwinBody:
    """A rigid body: pose X_WB, centre of mass in body axes [m], inertia about it [kg m²]; none where fixed."""

    id: str
    fixed: bool
    p_WB: Vector
    R_WB: Matrix
    mass: float = 0.0
    center: Vector = field(default_factory=lambda: np.zeros(3))
    inertia: Matrix = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class TwinJoint:
    """A joint between body a and body b and all that acts along its coordinate q (rad, or m where it slides).

    p_A, R_AF, p_B, R_BF: its frame in both bodies.  q: at the start; 0 where the type has none.  damping [N m s/rad or
    N s/m], dry: size of friction [N m or N], rotor: inertia along q [kg m² or kg], stiffness and preload: effort =
    preload - stiffness q.  lower, upper: stops, infinite where open.  driven: q is prescribed.
    """

    id: str
    type: str
    a: str
    b: str
    p_A: Vector
    R_AF: Matrix
    p_B: Vector
    R_BF: Matrix
    q: float = 0.0
    damping: float = 0.0
    dry: float = 0.0
    rotor: float = 0.0
    stiffness: float = 0.0
    preload: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    driven: float | None = None

    @property
    def stopped(self) -> bool:
        """Whether a stop bounds its travel."""
        return bool(np.isfinite(self.lower) or np.isfinite(self.upper))

    @property
    def laden(self) -> bool:
        """Whether anything acts along its coordinate."""
        acts = self.damping or self.dry or self.rotor or self.stiffness or self.preload
        return bool(acts) or self.stopped or self.driven is not None


@dataclass(frozen=True)
class Spring:
    """A line between points of two bodies: tension = stiffness (length - free) + damping x rate of lengthening."""

    id: str
    a: str
    b: str
    p_A: Vector
    p_B: Vector
    stiffness: float
    free: float
    damping: float


@dataclass(frozen=True)
class Effort:
    """A drive along a joint's coordinate [N m or N]."""

    id: str
    joint: str
    size: float


@dataclass(frozen=True)
class Push:
    """A drive along a direction of W: a force [N] at a point of body a, or a torque [N m]; b takes the reaction."""

    id: str
    a: str
    b: str
    p_A: Vector
    direction: Vector
    size: float
    torque: bool


@dataclass(frozen=True)
class Twin:
    """Everything that can be handed on, and in `left_out` a sentence for each thing that cannot."""

    name: str
    gravity: Vector
    bodies: tuple[TwinBody, ...]
    joints: tuple[TwinJoint, ...]
    springs: tuple[Spring, ...]
    efforts: tuple[Effort, ...]
    pushes: tuple[Push, ...]
    markers: tuple[tuple[str, str, Vector], ...]
    left_out: tuple[str, ...]

    def body(self, id: str) -> TwinBody:
        """The body of that id."""
        return next(body for body in self.bodies if body.id == id)

    def frame_a(self, joint: TwinJoint) -> tuple[Vector, Matrix]:
        """Place and axes of a joint's frame on body a, in W, at the start."""
        body = self.body(joint.a)
        return body.p_WB + body.R_WB @ joint.p_A, body.R_WB @ joint.R_AF

    def frame_b(self, joint: TwinJoint) -> tuple[Vector, Matrix]:
        """The same on body b."""
        body = self.body(joint.b)
        return body.p_WB + body.R_WB @ joint.p_B, body.R_WB @ joint.R_BF

    @property
    def size(self) -> float:
        """Diagonal of the box around all joints; 1 where that is a point [m]."""
        points = np.array([self.frame_b(joint)[0] for joint in self.joints]).reshape(-1, 3)
        return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) > 1 else 1.0


def physical(inertia: Matrix) -> Matrix:
    """The nearest inertia that a strict reader takes: a flat plate's moments, rounded, may break the triangle."""
    moments, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    spread = np.maximum(moments, FLAT * np.trace(inertia))
    return (axes * (spread.sum() - spread)) @ axes.T
