"""Sets with what nobody states of them free: drag that is spread along a bar falls behind while it acts at a point."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose import closer as module
from backend.diagnose.closer import in_shape

OPEN = {"air_drag", "coulomb_friction"}  # kinds of which something is left open


def found(*names: str, chi2: float, log_z: float) -> Any:
    members = [SimpleNamespace(kind=n.split(":")[0], closer=(n,) if n.split(":")[0] in OPEN else ()) for n in names]
    return SimpleNamespace(
        names=names, candidates=members, fitted=SimpleNamespace(chi2=chi2, fraction=1.0), log_z=log_z
    )


@pytest.fixture
def asked(monkeypatch):
    """Names of the sets that were tried closer; those with drag are the likelier so."""
    tried: list[tuple[str, ...]] = []

    def closer(search, cause):
        tried.append(cause.names)
        gains = any(n.startswith("air_drag") for n in cause.names)
        return found(*cause.names, chi2=100.0, log_z=cause.log_z + 90.0) if gains else cause

    monkeypatch.setattr(module, "closer", closer)
    return tried


def test_of_each_kind_with_a_shape_the_nearest_is_tried_and_what_could_come_up_with_it(asked):
    level = [
        found("linear_drag:b", "mass_error:b", chi2=400.0, log_z=-200.0),
        found("air_drag:b", "torsion_spring:j", chi2=470.0, log_z=-235.0),
        found("air_drag:b", "spring_stiffness_error:s", chi2=480.0, log_z=-240.0),
        found("coulomb_friction:j", "mass_error:b", chi2=500.0, log_z=-250.0),
        found("coulomb_friction:k", "mass_error:b", chi2=520.0, log_z=-260.0),
        found("air_drag:b", "length_error:b", chi2=900.0, log_z=-450.0),
        found("air_drag:c", "length_error:b", chi2=1700.0, log_z=-850.0),
    ]
    shaped = in_shape(SimpleNamespace(), level)  # type: ignore[arg-type]
    assert asked == [level[1].names, level[2].names, level[3].names]
    assert [c.log_z for c in shaped] == [-200.0, -145.0, -150.0, -250.0, -260.0, -450.0, -850.0]


def test_sets_far_behind_the_likeliest_are_left_as_they_are(asked):
    level = [
        found("linear_drag:b", "mass_error:b", chi2=100.0, log_z=-50.0),
        found("air_drag:b", "mass_error:b", chi2=401.0, log_z=-200.0),
    ]
    assert in_shape(SimpleNamespace(), level) == level  # type: ignore[arg-type]
    assert asked == []
