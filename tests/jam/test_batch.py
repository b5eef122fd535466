"""Many samples at once are judged as each alone is."""

import equinox as eqx
import numpy as np
import pytest

from backend.jam.batch import _meets, verdicts
from backend.mechanism.effect import Effect
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import closed
from tests.jam import cases
from tests.jam.weak import weak_bar

TORQUE, DRY = ("drive", "torque_n_m"), ("dry", "friction_torque_n_m")


@pytest.mark.parametrize(
    "drawn",
    [weak_bar, pytest.param(cases.weak_drive, marks=pytest.mark.nightly)],
    ids=["bare", "beside a post and an end"],
)
def test_a_drive_is_held_by_friction_above_it_and_by_none_below(drawn):
    model = build(drawn(0.01))
    drives = np.array([0.005, 0.0099, 0.0101, 0.02, 0.0])
    samples = np.stack([drives, np.full(5, 0.01)], 1)
    found = [(where, seen) for where, seen in verdicts(model, [TORQUE, DRY], samples, 0.3, chunk=4)]
    assert [where for where, _ in found] == [slice(0, 4), slice(4, 5)]
    jammed = np.concatenate([seen.jammed for _, seen in found])
    rests = np.concatenate([seen.rests for _, seen in found])
    assert jammed.tolist() == [True, True, False, False, False]
    assert rests.tolist() == [True, True, False, False, True]  # nothing drives the last: it rests and is not jammed
    assert not any(seen.lost.any() for _, seen in found)


def test_samples_of_another_width_are_refused():
    with pytest.raises(ValueError, match="one column for each of 2"):
        next(verdicts(build(weak_bar()), [TORQUE, DRY], np.zeros((3, 1))))


@pytest.mark.parametrize(("shorter", "closes"), [(0.05, True), (0.89, False)])
def test_a_sample_whose_loop_cannot_close_is_told_as_lost(shorter, closes):
    """Crank 0.1, rocker 0.2 and ground 0.32 m: a coupler of 0.15 m less 89% cannot span what is left."""
    model = build(
        cases.toggle(), [Effect(id="cut", kind="length_error", on=("coupler",), parameters={"relative": -shorter})]
    )
    plant = system(model)
    assert bool(_meets(plant, eqx.filter_jit(closed)(plant, drawn_pose(model, plant)))) == closes
