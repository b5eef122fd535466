"""A weld: nothing is free."""

from backend.joints.joint import AbstractJoint


class Fixed(AbstractJoint):
    """The two frames stay together; there is no coordinate."""

    type = "fixed"
    held = (True, True, True, True, True, True)
    coordinate = None
