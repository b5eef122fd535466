"""Releases that what was seen contradicts: amid a motion, or long before one."""

import numpy as np
import pytest

from backend.mechanism.release_findings import release_findings
from backend.mechanism.study import Experiment, Release
from tests.mechanism.swings import RELEASE_S, TIME, filmed, pendulum
from tests.mechanisms import effect


def told(release, table=None, mechanism=None):
    shot = Experiment("e1", "fit", release, tracks=filmed() if table is None else table)
    return list(release_findings(shot, TIME, mechanism or pendulum()))


def fallen(held_s):
    """As tracks of a bar that was held for so long, struck by a wild sample."""
    table = filmed()
    table = table.assign(time_s=table["time_s"] + held_s - RELEASE_S)
    table.loc[table.index[10], "x_m"] += 0.1
    return table[table["time_s"] >= 0.0]


def test_still_frames_that_are_still_say_nothing():
    assert told(Release(time_s=RELEASE_S)) == told(Release(time_s=RELEASE_S - 0.02)) == []


def test_still_frames_that_move_are_told():
    (said,) = told(Release(time_s=0.7))
    assert "held still until its release at 0.7 s, and marker" in said
    assert "samples before it: set release.time_s to when it was let go" in said
    assert told(Release(time_s=0.7, at_rest=False)) == []


@pytest.mark.parametrize("held_s", [0.15, 0.25])
def test_a_release_at_the_first_sample_of_a_record_that_is_held_is_told(held_s):
    (said,) = told(Release(time_s=0.0), fallen(held_s))
    assert "release.time_s is 0 s, and nothing moves until marker" in said
    assert "set release.time_s to when it was let go" in said


def test_a_record_that_begins_as_it_is_let_go_says_nothing():
    assert told(Release(time_s=0.0), fallen(0.0)) == []


def test_what_a_drive_sets_in_motion_may_wait():
    led = pendulum(effects=[effect("led", "prescribed_motion", ["pin"], q=0.0)])
    assert told(Release(time_s=0.0), fallen(0.25), led) == []


def test_a_release_far_from_the_first_sample_is_told_once():
    (said,) = told(Release(time_s=-1.0), filmed())
    assert "1 s before its first sample" in said
    assert np.isclose(TIME[0], 0.0)
