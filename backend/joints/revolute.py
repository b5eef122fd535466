"""A pin in a hole: only the turn about the axis is free."""

from backend.joints.joint import TURN, AbstractJoint


class Revolute(AbstractJoint):
    """Hinge about the common z axis; q is the turn of B relative to A [rad]."""

    type = "revolute"
    held = (True, True, True, True, True, False)
    coordinate = TURN
