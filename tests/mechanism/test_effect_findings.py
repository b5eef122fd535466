"""What `check` says of where effects stand: on what is fixed, on a bed of no plane, under another part's name."""

import pytest

from backend.mechanism.effect_findings import effect_findings
from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism
from tests.mechanisms import document, double_pendulum, effect, pendulum


def hung(type, effects=()):
    """The pendulum on another joint."""
    drawn = document(pendulum(effects=effects))
    drawn["joints"][0]["type"] = type
    return parse_mechanism(drawn)


BED = [effect("bed", "surface_friction", "all", friction_coefficient=0.2)]


@pytest.mark.parametrize(
    "wind",
    [
        effect("wind", "linear_drag", ["ground"], n_s_per_m=0.1),
        effect("wind", "air_drag", ["ground"], drag_area_m2=0.1),
        effect("wind", "applied_force", ["ground"], force_n=1.0, direction=[1.0, 0.0, 0.0]),
        effect("wind", "mass_error", ["ground"], relative=0.1),
    ],
)
def test_an_effect_on_a_body_that_stands_still_does_nothing(wind):
    (said,) = describe(pendulum(effects=[wind])).warnings
    assert said.startswith(f'effect "wind": {wind.kind} on body "ground", which is fixed, does nothing')


@pytest.mark.parametrize(
    "acting",
    [
        effect("x", "linear_drag", "all", n_s_per_m=0.1),
        effect("x", "length_error", ["ground"], relative=0.01),
        effect("x", "applied_force", ["link", "ground"], force_n=1.0, direction=[1.0, 0.0, 0.0]),
        effect("pin", "viscous_friction", ["pin"], damping_n_m_s_per_rad=0.1),
        effect("link", "viscous_friction", ["pin"], damping_n_m_s_per_rad=0.1),
        effect("pin", "linear_drag", ["link"], n_s_per_m=0.1),
        *BED,
    ],
)
def test_nothing_is_said_of_an_effect_that_acts(acting):
    assert list(effect_findings(pendulum(effects=[acting]))) == []


@pytest.mark.parametrize("type", ["spherical", "universal"])
def test_the_bed_of_a_body_that_hangs_in_space_is_told(type):
    (said,) = effect_findings(hung(type, BED))
    assert f'effect "bed": body "link" hangs on {type} joints' in said
    assert "across gravity" in said
    assert list(effect_findings(hung("planar", BED))) == []


def test_an_effect_called_like_a_joint_that_it_does_not_stand_on_is_told():
    for on in (["shoulder"], "all"):
        rub = effect("elbow", "viscous_friction", on, damping_n_m_s_per_rad=0.1)
        (said,) = effect_findings(double_pendulum([rub]))
        assert "--free viscous_friction:elbow frees this effect, not one at that joint" in said
