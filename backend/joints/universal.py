"""A cross between two yokes (Hooke's joint): it bends both ways, and hands turning on."""

from backend.joints.joint import AbstractJoint


class Universal(AbstractJoint):
    """The cross turns in A about the y axis of frame A, and B turns on the cross about the x axis of frame B.

    The turn row is y of frame A · x of frame B, so holding it keeps these two axes of the cross square.  Where the
    frames coincide z is the line of both shafts.  Two turns are free, so that no single one is the coordinate.
    """

    type = "universal"
    held = (True, True, True, False, False, True)
    coordinate = None
