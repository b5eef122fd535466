"""Two rigs that carry every effect which acts there, at zero: one compiled program answers all questions."""

from collections.abc import Callable

import pytest

from backend.model.build import build
from backend.model.model import Model
from tests.mechanisms import DOWN, WEIGHTLESS, effect, pendulum, sliding_mass

ON_PIN = ("viscous_friction", "coulomb_friction", "pin_friction", "torsion_spring", "rotor_inertia", "effort_offset")
ON_RAIL = ("viscous_friction", "coulomb_friction", "effort_offset")
ON_BODY = ("air_drag", "linear_drag")


def named(kinds, at):
    return [effect(kind, kind, [at]) for kind in kinds]


def with_effects(model: Model, values: dict) -> Model:
    """values: parameter by kind, or {parameter: value} where a kind has several."""
    table = {}
    for kind, given in values.items():
        of_kind = {name: row for (id, name), row in model.parameters.items() if id == kind}
        if not isinstance(given, dict):
            first = next(name for name, row in of_kind.items() if suits(row, model))
            given = {first: given}
        table |= {(kind, name): value for name, value in given.items()}
    return model.with_parameters(table)


def suits(row, model):
    """The parameter of this kind that the rig's joint understands."""
    types = row.declaration.joint_types
    return types is None or types[0] == model.topology.joint_types[0]


@pytest.fixture(scope="session")
def swinging() -> Callable[..., Model]:
    """swinging(angle, weight=True, kind=value, ...): a 0.2 m, 0.1 kg bar on a pin."""

    def model(angle: float = 0.5, weight: bool = True, **values) -> Model:
        push = effect("applied_force", "applied_force", ["link"], direction=[1, 0, 0], point_m=[0.1, 0, 0])
        twist = effect("applied_torque", "applied_torque", ["link"], axis=[0, 0, 1])
        effects = [*named(ON_PIN, "pin"), *named(ON_BODY, "link"), push, twist]
        drawn = pendulum(angle, effects=effects, gravity=DOWN if weight else WEIGHTLESS)
        return with_effects(build(drawn), values)

    return model


@pytest.fixture(scope="session")
def sliding() -> Callable[..., Model]:
    """sliding(gravity, kind=value, ...): a 0.5 kg block on a rail along x, a spring to a post 0.3 m ahead."""

    def model(gravity=WEIGHTLESS, **values) -> Model:
        spring = effect(
            "extension_spring", "extension_spring", ["block", "ground"], anchor_a_m=[0, 0, 0], anchor_b_m=[0.3, 0, 0]
        )
        push = effect("applied_force", "applied_force", ["block"], direction=[2, 0, 0])
        drawn = sliding_mass([*named(ON_RAIL, "rail"), *named(ON_BODY, "block"), spring, push], gravity=gravity)
        return with_effects(build(drawn), values)

    return model
