"""Effects and places of a gap's report as one says them."""

OUTSIDE = {"camera": "the camera", "world": "the world around it"}


def place_name(at: str) -> str:
    """A place as one says it.

    >>> place_name("joint:A"), place_name("camera")
    ('joint A', 'the camera')
    """
    return OUTSIDE.get(at, at.replace(":", " ", 1))


def acting(kind: str, at: str) -> str:
    """What acts, and where.

    >>> acting("rotor_inertia", "j1"), acting("frame_rate_error", "camera")
    ('rotor inertia at j1', 'frame rate error of the camera')
    >>> acting("camera_tilt", "camera"), acting("gravity_tilt", "world")
    ('camera tilt', 'gravity tilt')
    """
    words = kind.replace("_", " ")
    if at == "camera":
        return words if at in words else f"{words} of the camera"
    return words if at == "world" else f"{words} at {at}"
