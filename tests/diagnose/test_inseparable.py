"""Which effects one study could not tell apart, from responses that are known."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from backend.diagnose.inseparable import inseparable
from backend.diagnose.library import SMOOTH, library
from backend.diagnose.screen import Screen
from tests.mechanisms import fourbar


def screen(**responses):
    """A four-bar's library in which these parameters alone move anything, each at its expected size."""
    known = library(fourbar(), SMOOTH)
    S = np.zeros((5, len(known.parameters)))
    for i, p in enumerate(known.parameters):
        if p.name in responses:
            S[:, i] = np.array(responses[p.name]) / cast("float", p.prior_sd)
    about: Any = SimpleNamespace(library=known)
    return Screen(about, cast("Any", None), S, np.zeros(5), np.zeros(0), np.zeros((0, S.shape[1])))


def told(about, scale=1.0):
    return [{f"{c.name}.{p.parameter}" for c, p in group} for group in inseparable(about, scale)]


CLOCK, DELAY, OFFSET = "frame_rate_error:camera.relative", "late_release:world.delay_s", "time_offset:camera.s"
TURN, TILT = "camera_rotation:camera.rad", "gravity_tilt:world.pitch_rad"


def test_what_moves_alike_is_one_group_and_what_does_not_is_none():
    about = screen(**{DELAY: [40, 0, 0, 0, 0], OFFSET: [-200, 0, 0, 0, 0], CLOCK: [0, 50, 0, 0, 0]})
    assert told(about) == [{DELAY, OFFSET}]


def test_two_are_told_apart_by_what_one_leaves_beside_the_other_in_sigmas():
    """Of 100 sd, 2 and 4 to the side: within and beyond three."""
    assert told(screen(**{TURN: [100, 0, 0, 0, 0], TILT: [100, 2, 0, 0, 0]})) == [{TURN, TILT}]
    assert told(screen(**{TURN: [100, 0, 0, 0, 0], TILT: [100, 4, 0, 0, 0]})) == []
    assert told(screen(**{TURN: [100, 0, 0, 0, 0], TILT: [100, 4, 0, 0, 0]}), scale=2.0) == [{TURN, TILT}]


def test_what_could_not_be_seen_at_its_expected_size_is_in_no_group():
    assert told(screen(**{TURN: [100, 0, 0, 0, 0], TILT: [3, 0, 0, 0, 0]})) == []


def test_a_faint_effect_is_told_from_a_loud_one_by_its_own_size():
    """It may be any share of the loud one: what it leaves counts at the size that it can have."""
    assert told(screen(**{TURN: [1000, 0, 0, 0, 0], TILT: [20, 2, 0, 0, 0]})) == [{TURN, TILT}]
