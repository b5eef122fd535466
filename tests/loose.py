"""Parts with play, drawn where their pins touch or fly, for questions whose answer is known beforehand."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from backend.mechanism.read import parse_mechanism as parse
from backend.model.build import build
from backend.model.model import Model
from tests.mechanisms import DOWN, WEIGHTLESS, Document, Z, body, document, drawing, effect, pendulum, pose

LENGTH, MASS, G = 0.2, 0.1, 9.81
RIGID = {"friction_coefficient": 0.0, "restitution": 0.0, "stiffness_n_per_m": 1e10}


def loose_bar(angle: float = 0.0, at=(0.0, 0.0), gravity=DOWN, pin_radius_m: float = 0.004, **play: Any) -> Model:
    """A 0.2 m, 0.1 kg bar on one loose pin, `angle` from hanging down, its pin drawn at `at` in the hole."""
    return build(parse(_placed(pendulum(angle, LENGTH, MASS, [_play(**play)], gravity), at, pin_radius_m)))


def loose_ball(at=(0.0, 0.0), gravity=WEIGHTLESS, **play: Any) -> Model:
    """The same with its mass around the pin: it strikes its hole without turning."""
    drawn = _placed(pendulum(0.0, LENGTH, MASS, [_play(**play)], gravity), at)
    _part(drawn, "link")["inertial"]["center_of_mass_m"] = [0.0, 0.0, 0.0]
    return build(parse(drawn))


def drawer(friction: float, arm: float, length: float, play: float, force: float) -> Model:
    """A drawer guided at both ends, tilted as far as its two walls allow; a force pulls at `arm` off centre."""
    block = body("drawer", (0, 0, 0), Rotation.identity(), MASS, np.full(3, 2e-4))
    ends = [
        (n, "revolute", "ground", "drawer", (x, 0, 0), Z) for n, x in (("front", length / 2), ("back", -length / 2))
    ]
    walls = effect("walls", "clearance", "all", radial_m=play, shape="rectangle", friction_coefficient=friction)
    pull = effect("pull", "applied_force", ["drawer"], force_n=force, direction=[1, 0, 0], point_m=[0, arm, 0])
    drawn = document(drawing("drawer", [block], ends, [walls, pull], gravity=WEIGHTLESS))
    tilt = np.arcsin(2 * play / length)
    _part(drawn, "drawer")["pose"] = pose((0, 0, 0), Rotation.from_rotvec([0, 0, -tilt]))
    return build(parse(drawn))


def _play(**play: Any):
    return effect("play", "clearance", ["pin"], **{"radial_m": 1e-3, **RIGID, **play})


def _placed(mechanism, at, pin_radius_m: float = 0.004) -> Document:
    drawn = document(mechanism)
    _part(drawn, "link")["pose"]["position_m"] = [*map(float, at), 0.0]
    drawn["joints"][0]["fit"]["pin_diameter_m"] = 2 * pin_radius_m
    return drawn


def _part(drawn: Document, id: str) -> Document:
    return next(part for part in drawn["bodies"] if part["id"] == id)
