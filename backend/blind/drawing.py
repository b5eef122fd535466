"""What the peers are told about a mechanism: frames, masses, and each joint's effects summed into one law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from backend.blind.contacts import Capsules, Pads, Play
from backend.blind.poses import COORDINATE, LOOSE, MET

WORLD = -1  # the index that stands for every fixed body

Drive = Callable[[float], float]


@dataclass(frozen=True)
class DrawnBody:
    """X_WB as drawn, mass [kg], p_BC [m] and inertia about C in body axes [kg m²]; massless where fixed."""

    id: str
    fixed: bool
    p_WB: np.ndarray
    R_WB: np.ndarray
    mass: float
    p_BC: np.ndarray
    inertia: np.ndarray


@dataclass
class DrawnJoint:
    """A joint with its frames, and the effort along q that its effects add up to [N m, or N if it slides].

    effort = -stiffness q + preload + Σ drives(t) - damping q̇ - friction sign(q̇), and stops at lower, upper.
    rub_radius: pin friction's torque over the radial reaction [m].  play: how a pin is loose in its hole, if it is.
    """

    id: str
    type: str
    a: int
    b: int
    p_AF: np.ndarray
    R_AF: np.ndarray
    p_BF: np.ndarray
    R_BF: np.ndarray
    stiffness: float = 0.0
    preload: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    inertia: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    drives: list[Drive] = field(default_factory=list)
    pin_radius: float = 0.0
    drawn_play: float | None = None
    rub_radius: float = 0.0
    play: Play | None = None

    @property
    def turns(self) -> bool:
        """Whether q is an angle."""
        return self.moves and self.type != "prismatic"

    @property
    def moves(self) -> bool:
        """Whether there is a q at all."""
        return self.type in COORDINATE

    @property
    def held(self) -> tuple[int, ...]:
        """The rows (poses.joint_rows) that stay zero."""
        return LOOSE if self.play else MET[self.type]

    def drive(self, time_s: float) -> float:
        """Effort of the known drives [N m or N]."""
        return sum(drive(time_s) for drive in self.drives)


@dataclass(frozen=True)
class Strut:
    """A spring and damper along the line between two points, each in its body's axes."""

    a: int
    b: int
    p_A: np.ndarray
    p_B: np.ndarray
    stiffness: float
    free_length: float
    damping: float


@dataclass(frozen=True)
class Push:
    """A force (at p_A of body a) or a torque along a direction fixed in W; body b takes the reaction."""

    a: int
    b: int
    p_A: np.ndarray
    direction: np.ndarray
    size: Drive
    torque: bool


@dataclass(frozen=True)
class Drag:
    """-linear v - quadratic |v| v at the centre of mass [N s/m, N s²/m²]."""

    body: int
    linear: float
    quadratic: float


@dataclass(frozen=True)
class Drawing:
    """All of it; body indices count `bodies`, and b = WORLD means that nothing takes the reaction."""

    gravity: np.ndarray
    bodies: list[DrawnBody]
    joints: list[DrawnJoint]
    struts: list[Strut]
    pushes: list[Push]
    drags: list[Drag]
    pads: list[Pads]
    capsules: list[Capsules]
    markers: list[tuple[str, int, np.ndarray]]

    @property
    def moving(self) -> list[int]:
        """Indices of the bodies that can move."""
        return [i for i, body in enumerate(self.bodies) if not body.fixed]
