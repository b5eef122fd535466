"""How far into the records all is well, of a bar that meets a wall, filmed at a right scale or at a wrong one."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.effects.catalogue import catalogue
from tests.diagnose.test_diagnosis import COARSE_S, drawing, run_often, study
from tests.diagnose.test_soft_stop import END, damped_spring

__all__ = ["drawing", "run_often"]  # fixtures

KINDS = {"camera_scale", "viscous_friction", "joint_stop"}
LARGER = 1.02
ANGLES = (0.9, 0.5, 1.4)


def searched(drawing, torque, places):
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.onset import onset
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    told = study(drawing, 3, torque=torque, places=places, angles=ANGLES)
    known = library(told.mechanism, SMOOTH, without=frozenset(set(catalogue()) - KINDS))
    search = Search(prepare(told, known, COARSE_S), lambda words: None, lambda: False)
    found = onset(search, 1.0)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("torque", "scale", "names", "most"),
    [
        (None, 1.0, (), 0.5),
        (damped_spring, 1.0, (), 0.25),
        (damped_spring, LARGER, ("camera_scale:camera",), 0.25),
    ],
    ids=["drawn", "walled", "walled and larger"],
)
def test_all_is_well_until_the_wall_is_met(drawing, torque, scale, names, most):
    share, cause = searched(drawing, torque, lambda p: scale * p)
    assert cause.names == names
    assert share == most
    if names:
        assert cause.values["camera_scale:camera.relative"] == pytest.approx(LARGER - 1.0, abs=1e-3)


def test_what_acts_from_the_start_alone_is_enough_as_far_as_anything_was_asked(drawing):
    share, cause = searched(drawing, lambda t, q, rate: -0.01 * rate, lambda p: p)
    assert (share, cause.names) == (0.5, ("viscous_friction:j1",))


def test_joints_pass_little_of_their_way_at_first_and_all_of_it_in_the_end(monkeypatch):
    from backend.diagnose import onset as module

    time_s = np.linspace(0.0, 1.0, 41)
    way = np.stack([1.0 - np.cos(np.pi * time_s), 0.2 * (1.0 - np.cos(np.pi * time_s))])
    monkeypatch.setattr(module, "let_go", lambda fitted: {"hinge": way, "rail": 1e-2 * np.sqrt(time_s)[None]})
    sizes = {"hinge": 1.0, "rail": 0.1}
    for followed in (1.0, 0.5):
        drawn: Any = SimpleNamespace(fraction=followed, subject=SimpleNamespace(size_of=sizes.__getitem__))
        for share in (0.1, 0.25):
            begun = 2.4 * np.sin(0.5 * np.pi * share) ** 2 + 0.1 * np.sqrt(share)
            assert module.moved(drawn, followed * share) == pytest.approx(begun / 2.5)
        assert module.moved(drawn, followed) == 1.0


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_an_end_of_travel_beside_a_wrong_scale_is_named_with_it(drawing):
    from backend.diagnose.run import diagnose_study

    told = study(drawing, 3, torque=damped_spring, places=lambda p: LARGER * p, angles=ANGLES)
    found = diagnose_study(told, without=frozenset(set(catalogue()) - KINDS), step_s=COARSE_S)
    assert {(e.kind, *e.on) for e in found.report.causes[0].effects} == {
        ("joint_stop", "j1"),
        ("camera_scale", "camera"),
    }
    named = {e.kind: e.parameters for e in found.report.causes[0].effects}
    assert named["joint_stop"]["lower"].value == pytest.approx(END, abs=0.02)
    assert named["camera_scale"]["relative"].value == pytest.approx(LARGER - 1.0, abs=2e-3)
