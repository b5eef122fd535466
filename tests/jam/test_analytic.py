"""Jams whose place, cause and margin are known from theory."""

import functools

import numpy as np
import pytest

from backend.jam.run import Jam, jam
from backend.mechanism.jam_report import JamReport
from tests.jam import cases
from tests.mechanisms import effect, pendulum


@functools.cache
def found(name: str, *values: float, duration_s: float = 0.3) -> Jam:
    """Cached: several questions are asked of one motion."""
    return jam(getattr(cases, name)(*values), duration_s)


def report(name: str, *values: float, duration_s: float = 0.3) -> JamReport:
    return found(name, *values, duration_s=duration_s).report


@pytest.mark.parametrize(("share", "jams"), [(0.99, True), (1.01, False)])
def test_a_bar_jams_up_to_the_angle_at_which_its_pins_friction_balances_its_weight(share, jams):
    """Upright, sin θ = 2 μ r / L; more weight presses the pin as much harder: it locks."""
    seen = report("held_bar", share)
    assert seen.jammed == jams
    assert seen.cause == ("friction_lock" if jams else "none")
    if jams:
        assert (seen.onset_s, seen.at) == (0.0, ("joint:pin",))
        assert seen.margin.drive_factor is None
        # friction may fall to the bar's share of the critical angle (sin x / x changes it by 1e-3, creep by less)
        assert seen.margin.friction_factor == pytest.approx(share, rel=5e-3)


@pytest.mark.parametrize(("share", "jams"), [(0.99, False), (1.01, True)])
def test_a_drawer_wedges_where_friction_exceeds_half_its_length_over_the_lever_of_the_pull(share, jams):
    seen = report("drawer", share)
    assert seen.jammed == jams
    assert seen.cause == ("friction_lock" if jams else "none")
    if jams:
        assert set(seen.at) == {"body:ground", "body:drawer"}
        assert seen.onset_s < 0.01
        assert seen.friction_cone is not None
        assert seen.friction_cone.holds
        assert seen.margin.friction_factor == pytest.approx(1 / share, rel=2e-3)  # the bracket's width


def test_the_published_count_sees_no_difference_between_a_drawer_that_wedges_and_one_that_slides():
    wedged, slides = report("drawer", 1.01), report("drawer", 0.99)
    assert set(wedged.small_singular_values) == set(slides.small_singular_values) == {3}


def test_a_weak_drive_is_told_by_how_much_it_is_too_weak():
    seen = report("weak_drive", 0.01)
    assert (seen.jammed, seen.cause, seen.at, seen.onset_s) == (True, "insufficient_drive", ("joint:pin",), 0.0)
    # 0.02 N m of friction against a drive of 0.01; the margins are simulated within 0.6%
    assert seen.margin.drive_factor == pytest.approx(2.0, rel=6e-3)
    assert seen.margin.friction_factor == pytest.approx(0.5, rel=6e-3)
    assert "2 times the drive" in seen.sentence


def test_a_drive_above_friction_moves():
    assert (report("weak_drive", 0.022).cause, report("weak_drive", 0.022).onset_s) == ("none", None)


def test_rest_against_a_declared_end_is_no_jam():
    seen = report("stopped", duration_s=0.6)
    assert (seen.jammed, seen.cause, seen.at) == (False, "stop", ("joint:pin",))
    inertia = cases.BAR_KG * (cases.BAR_M**2 / 3 + 0.01**2 / 12)
    # φ = τ t² / 2 I, then the blow within a few steps
    assert seen.onset_s == pytest.approx((2 * 0.5 * inertia / 0.02) ** 0.5, abs=5e-3)


def test_rest_against_another_link_is_a_jam():
    seen = report("blocked", duration_s=0.6)
    assert (seen.jammed, seen.cause) == (True, "stop")
    assert set(seen.at) == {"body:ground", "body:link"}


def test_a_toggle_pushed_along_its_dead_centre_is_singular_and_one_beside_it_moves():
    dead, beside = report("toggle", 0.0), report("toggle", 0.02)
    assert (dead.jammed, dead.cause, dead.onset_s) == (True, "singularity", 0.0)
    assert dead.lever is not None
    assert dead.lever < 1e-12  # rounding
    assert (beside.jammed, beside.cause) == (False, "none")


def test_the_drives_singular_value_falls_linearly_to_a_dead_centre():
    far, near = (report("toggle", angle).driven_singular_value[0] for angle in (0.02, 0.002))
    assert far / near == pytest.approx(10.0, rel=1e-3)  # sin x / x


def test_dead_centres_passed_with_momentum_are_no_jam():
    seen = found("toggle", 0.4, -5.0)
    assert seen.run.done
    assert (seen.report.jammed, seen.report.cause, seen.report.onset_s) == (False, "none", None)
    driven = np.array(seen.report.driven_singular_value)
    assert driven.min() < 0.02 * driven.max()  # it did pass one
    assert seen.run.q["root"].min() < -0.5  # rad: the crank was drawn 0.4 rad before it


def test_a_hand_that_pushes_at_the_release_is_no_rest():
    pushed = pendulum(0.0, effects=[effect("push", "release_velocity", ["world"], rad_per_s=3.0)])
    seen = jam(pushed, 0.2)
    assert not seen.report.jammed
    assert np.ptp(seen.run.q["pin"]) > 0.3
    assert jam(pendulum(0.0), 0.2).run.q["pin"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("play", "jams"), [(1e-3, True), (1e-4, False)])
def test_a_bar_that_sags_by_its_play_onto_a_post_is_locked_by_clearance(play, jams):
    seen = report("sagging_latch", play, duration_s=1.0)
    assert seen.jammed == jams
    if jams:
        assert (seen.cause, seen.at) == ("clearance_lock", ("joint:pin",))
        assert 0.3 < seen.onset_s < 0.7


def test_reactions_stand_on_both_bodies_and_balance():
    seen = report("held_bar", 0.99)
    pin = seen.reactions["pin"]
    assert (pin.body_a, pin.body_b) == ("ground", "link")
    assert len(pin.force_on_a_n) == len(seen.time_s)
    assert pin.force_on_b_n[-1][1] == pytest.approx(0.1 * 9.81, rel=1e-4)  # at rest, within creep
    assert pin.force_on_a_n[-1][1] == -pin.force_on_b_n[-1][1]
