"""One mechanism that carries every effect at once, so that one compiled program questions them all.

What strikes stands alone: a wide difference of any other parameter would move a blow into another step.
"""

from collections.abc import Iterable
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from backend.effects.catalogue import catalogue
from backend.model.build import build
from backend.model.model import Address, Model, ParameterRow
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.rollout import rollout
from tests.mechanisms import bead_on_bar, effect
from tests.motions import move, still

STEP_S, STEPS = 1e-3, 250
STEPS_STRUCK = 100  # a few blows: more, and differences see how each sends the next
WITHOUT_ABSENT = (  # a driven joint follows its value; a hole without play has a micrometre; a bend is a hinge more
    "prescribed_motion",
    "clearance",
    "link_flexibility",
)
GIVEN = {  # parameters that a drawing must give
    "applied_force": {"direction": [0.6, 0.8, 0.0], "point_m": [0.02, 0.01, 0.0]},
    "applied_torque": {"axis": [0.0, 0.0, 1.0]},
    "extension_spring": {"anchor_a_m": [0.01, 0.0, 0.0], "anchor_b_m": [0.1, 0.15, 0.05]},
    "clearance": {"radial_m": 1e-3, "bearing_length_m": 0.02},
    "link_contact": {  # a post that ends 10 mm above the plane in which the bar swings: too thin to be met
        "start_a_m": [0.0, 0.0, 0.0],
        "end_a_m": [0.2, 0.0, 0.0],
        "start_b_m": [0.077, -0.092, 0.01],
        "end_b_m": [0.077, -0.092, 0.1],
        "radius_a_m": 0.001,
        "radius_b_m": 0.001,
    },
}
ELSEWHERE = (  # a stop is out of reach; the others show in what is measured, or not at all while they are zero
    "joint_stop",
    "late_release",
    "release_velocity",
    "base_motion",
)
STRIKING = ("clearance", "link_contact")
SIZES = {  # what is large enough to see in a quarter of a second, and not so large that motion stops
    "free_length_m": 0.1,
    "rest_rad": 0.3,
    "lower": -1e3,
    "upper": 1e3,
    "drag_area_m2": 0.05,
    "half_length_m": 0.05,
    "slip": 0.3,
    "friction_coefficient": 0.2,
    "friction_torque_n_m": 0.0005,
    "static_torque_n_m": 0.0015,
    "friction_force_n": 0.02,
    "static_force_n": 0.025,
    "stribeck_velocity_m_per_s": 0.1,
    "presliding_rad": 5e-3,
    "presliding_m": 2e-4,
    "onset_rad_per_s": 2e-2,
    "onset_m_per_s": 5e-3,
    "radius_a_m": 0.01,
    "radius_b_m": 0.012,
    "radial_m": 2e-4,
    "bearing_length_m": 0.02,
    ("clearance", "stiffness_n_per_m"): 1e5,
    ("link_contact", "stiffness_n_per_m"): 1e5,
    ("clearance", "restitution"): 0.3,
    ("link_contact", "restitution"): 0.3,
}
SHARE = 0.05  # of the natural size, for all other parameters


def members(kinds: Iterable[str]) -> list:
    """Effects of these kinds on the bar, or on its pin and rail."""
    places = {
        "joint": "all",
        "body": ["bar"],
        "bodies": ["bar", "ground"],
        "effect": ["extension_spring"],
        "marker": ["bead"],
        "world": ["world"],
        "camera": ["camera"],
    }
    own = {"air_drag": ["bead"]}  # the bar never moves along itself
    return [effect(k, k, own.get(k, places[catalogue()[k].acts_on]), **GIVEN.get(k, {})) for k in kinds]


@cache
def bare() -> Model:
    """The mechanism without any effect."""
    return build(bead_on_bar())


@cache
def laden() -> Model:
    """The mechanism with every effect at its default, which is absent."""
    return build(bead_on_bar(members(kind for kind in catalogue() if kind not in (*WITHOUT_ABSENT, "gravity"))))


@cache
def struck(kind: str) -> Model:
    """The mechanism with one effect that strikes."""
    return build(bead_on_bar(members([kind])))


def carrier(kind: str) -> Model:
    """The mechanism that questions a kind."""
    return struck(kind) if kind in STRIKING else laden()


@cache
def rows(kind: str) -> dict[Address, ParameterRow]:
    """What the mechanism that questions a kind may be asked about."""
    return carrier(kind).parameters


def sized(address: Address) -> float:
    """A telling value of a scalar parameter."""
    row = rows(address[0])[address]
    return SIZES.get(address, SIZES.get(address[1], SHARE * row.natural))


def present(kind: str) -> dict[Address, float]:
    """One effect's scalar parameters at telling values."""
    return {a: sized(a) for a, row in rows(kind).items() if row.kind == kind and row.declaration.size == 1}


def scalars(model: Model) -> list[Address]:
    """Every scalar parameter that this mechanism questions and that changes the motion."""
    return [
        address
        for address, row in model.parameters.items()
        if row.declaration.size == 1
        and catalogue()[row.kind].acts_on not in ("camera", "marker")
        and row.kind not in ELSEWHERE
        and carrier(row.kind) is model
    ]


_move = eqx.filter_jit(move)


def motion(model: Model):
    """From rest at the drawn pose."""
    return jax.tree.map(np.asarray, _move(model, still(model), jnp.asarray(STEP_S), STEPS))


def seen(model: Model, values: dict):
    """Coordinates and poses of the moved mechanism, over time."""
    model = model.with_parameters(values)
    plant = system(model, 1e-13)  # differences by 1e-6 cannot bear the default's 1e-10
    steps = STEPS_STRUCK if len(model.effects) == 1 else STEPS
    path = rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, steps)
    return jnp.concatenate([path.q.ravel(), path.pose.position.ravel()])


@eqx.filter_jit
def seen_and_slope(model: Model, values: dict, along: dict):
    """The same, and its derivative in a direction of the parameters; one program for both."""
    return jax.jvp(lambda v: seen(model, v), (values,), (along,))
