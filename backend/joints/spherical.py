"""A ball in its socket: all turns are free."""

from backend.joints.joint import AbstractJoint


class Spherical(AbstractJoint):
    """The two origins stay together; three turns are free, so that no single one is the coordinate."""

    type = "spherical"
    held = (True, True, True, False, False, False)
    coordinate = None
