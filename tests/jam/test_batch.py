"""Many samples at once are judged as each alone is."""

import numpy as np
import pytest

from backend.jam.batch import verdicts
from backend.model.build import build
from tests.jam import cases

TORQUE, DRY = ("drive", "torque_n_m"), ("dry", "friction_torque_n_m")


def test_a_drive_is_held_by_friction_above_it_and_by_none_below():
    model = build(cases.weak_drive(0.01))
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
        next(verdicts(build(cases.weak_drive(0.01)), [TORQUE, DRY], np.zeros((3, 1))))
