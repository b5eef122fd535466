"""A slide: only the travel along the axis is free."""

from backend.joints.joint import SLIDE, AbstractJoint


class Prismatic(AbstractJoint):
    """Slider along the common z axis; q is the travel of B's origin [m]."""

    type = "prismatic"
    held = (True, True, False, True, True, True)
    coordinate = SLIDE
