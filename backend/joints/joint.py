"""What a kind of joint is: which of its six rows are held, and which one is its coordinate.

The rows of a joint, in frame A (z is the axis): offset of B's origin along x, y and z [m], tilt of B's
axis along x and y, and turn about z [rad].
"""

from typing import ClassVar, Literal

ROWS = ("x", "y", "z", "tilt_x", "tilt_y", "turn")
SLIDE, TURN = 2, 5


class AbstractJoint:
    """One kind of joint.  A final subclass names its rows; it carries no numbers."""

    type: ClassVar[str]
    held: ClassVar[tuple[bool, bool, bool, bool, bool, bool]]
    coordinate: ClassVar[Literal[2, 5] | None]
    """Row whose displacement is the joint's q: 2 slides [m], 5 turns [rad], None has no coordinate."""
