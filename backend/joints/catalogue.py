"""The joints that can be simulated, found by looking in this folder."""

import importlib
import pkgutil
from functools import cache

import backend.joints
from backend.joints.joint import AbstractJoint


@cache
def catalogue() -> dict[str, type[AbstractJoint]]:
    """Joint type -> its class, for every file of this room."""
    for module in pkgutil.iter_modules(backend.joints.__path__):
        importlib.import_module(f"backend.joints.{module.name}")
    return {joint.type: joint for joint in sorted(AbstractJoint.__subclasses__(), key=lambda j: j.type)}


def joint_of_type(type_: str) -> type[AbstractJoint]:
    """The class of a joint type.  Raises ValueError naming the types that can be simulated."""
    known = catalogue()
    if type_ not in known:
        raise ValueError(f"joint type '{type_}' cannot be simulated yet; simulated types: {', '.join(known)}")
    return known[type_]
