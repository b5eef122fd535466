"""One mechanism that carries every effect at once, so that one compiled program questions them all."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from backend.effects.catalogue import catalogue
from backend.model.build import build
from backend.model.model import Address, Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.rollout import rollout
from tests.mechanisms import bead_on_bar, effect
from tests.motions import move, still

STEP_S, STEPS = 1e-3, 250
WITHOUT_ABSENT = (  # a driven joint follows its value; a hole without play has a micrometre; a bend is a hinge more
    "prescribed_motion",
    "clearance",
    "link_flexibility",
)
GIVEN = {  # parameters that a drawing must give
    "applied_force": {"direction": [0.6, 0.8, 0.0], "point_m": [0.02, 0.01, 0.0]},
    "applied_torque": {"axis": [0.0, 0.0, 1.0]},
    "extension_spring": {"anchor_a_m": [0.01, 0.0, 0.0], "anchor_b_m": [0.1, 0.15, 0.05]},
}
SIZES = {  # what is large enough to see in a quarter of a second, and not so large that motion stops
    "free_length_m": 0.1,
    "rest_rad": 0.3,
    "lower": -1e3,
    "upper": 1e3,
    "drag_area_m2": 0.05,
    "friction_coefficient": 0.2,
    "friction_torque_n_m": 0.0005,
    "static_torque_n_m": 0.0015,
    "friction_force_n": 0.02,
    "static_force_n": 0.025,
    "stribeck_velocity_m_per_s": 0.1,
}
SHARE = 0.05  # of the natural size, for all other parameters


def members() -> list:
    """Every effect of the catalogue, once per kind, on the bar or its pin and rail."""
    places = {"joint": "all", "body": ["bar"], "bodies": ["bar", "ground"], "world": ["world"], "camera": ["camera"]}
    return [
        effect(kind, kind, places[type_.acts_on], **GIVEN.get(kind, {}))
        for kind, type_ in catalogue().items()
        if kind not in (*WITHOUT_ABSENT, "gravity")
    ]


@cache
def bare() -> Model:
    """The mechanism without any effect."""
    return build(bead_on_bar())


@cache
def laden() -> Model:
    """The mechanism with every effect at its default, which is absent."""
    return build(bead_on_bar(members()))


def sized(address: Address) -> float:
    """A telling value of a scalar parameter."""
    row = laden().parameters[address]
    return SIZES.get(address[1], SHARE * row.natural)


def present(kind: str) -> dict[Address, float]:
    """One effect's scalar parameters at telling values."""
    rows = laden().parameters
    return {a: sized(a) for a, row in rows.items() if row.kind == kind and row.declaration.size == 1}


def scalars() -> list[Address]:
    """Every scalar parameter that changes the motion."""
    return [
        address
        for address, row in laden().parameters.items()
        if row.declaration.size == 1 and catalogue()[row.kind].acts_on != "camera" and row.kind != "joint_stop"
    ]


_move = eqx.filter_jit(move)


def motion(model: Model):
    """From rest at the drawn pose."""
    return jax.tree.map(np.asarray, _move(model, still(model), jnp.asarray(STEP_S), STEPS))


@eqx.filter_jit
def seen(model: Model, values: dict, sharp: bool = True):
    """Coordinates and poses of the moved mechanism, over time."""
    model = model.with_parameters(values)
    plant = system(model, 1e-13)  # differences by 1e-6 cannot bear the default's 1e-10
    path = rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, STEPS)
    return jnp.concatenate([path.q.ravel(), path.pose.position.ravel()])


@eqx.filter_jit
def slope(model: Model, values: dict, along: dict):
    """Its derivative in a direction of the parameters."""
    return jax.jvp(lambda v: seen(model, v), (values,), (along,))[1]
