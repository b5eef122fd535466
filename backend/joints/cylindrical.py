"""A shaft in a sleeve: it turns about its axis and slides along it."""

from backend.joints.joint import TURN, AbstractJoint


class Cylindrical(AbstractJoint):
    """Common z axis; q is the turn of B relative to A [rad], the slide along z is free and carries nothing."""

    type = "cylindrical"
    held = (True, True, False, True, True, False)
    coordinate = TURN
