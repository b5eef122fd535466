"""A puck on a table: it slides in a plane and turns about the plane's normal."""

from backend.joints.joint import TURN, AbstractJoint


class Planar(AbstractJoint):
    """B stays in the xy plane of frame A; q is its turn about z [rad], both slides are free and carry nothing."""

    type = "planar"
    held = (False, False, True, True, True, False)
    coordinate = TURN
