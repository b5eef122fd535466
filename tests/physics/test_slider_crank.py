"""A driven slider-crank, against its closed form."""

import numpy as np
import pytest

from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import let_go
from backend.simulate.record import on_steps
from tests.mechanisms import effect, slider_crank
from tests.motions import follow

CRANK, ROD, FIRST = 0.05, 0.15, 0.4
STEP_S, STEPS = 1e-3, 1000
RATE = 8.0
TURN = (RATE * STEP_S) ** 3 / 20  # rad: a turn in a step is measured to third order, 2 sin(θ/2) for θ


@pytest.fixture(scope="module")
def driven():
    """The crank turned steadily, and the angle it was told to have at every node."""
    model = build(slider_crank(FIRST, CRANK, ROD, [effect("motor", "prescribed_motion", ["main"])]))
    times = STEP_S * np.arange(STEPS + 2)
    record = on_steps(model, [(("motor", "q"), times, RATE * times)], STEP_S, STEPS)
    return follow(model, STEP_S, STEPS, record=record), RATE * times[:-1]


def wrist(angle):
    return CRANK * np.cos(angle) + np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)


def test_a_prescribed_crank_turns_as_told(driven):
    motion, told = driven
    np.testing.assert_allclose(motion.path.q[:, 0], told, atol=TURN)


def test_the_block_is_where_the_closed_form_says(driven):
    motion, told = driven
    np.testing.assert_allclose(motion.path.q[:, 3], wrist(FIRST + told) - wrist(FIRST), atol=1e-9)


def test_a_block_pushed_near_its_dead_centre_starts_with_the_speed_it_is_given():
    model = build(slider_crank(0.02, CRANK, ROD, [effect("push", "release_velocity", ["slide"], m_per_s=0.1)]))
    plant = system(model)
    begun = let_go(plant, drawn_pose(model, plant)).velocity[model.topology.slot("block")]
    # The crank is 75 times as fast, in lengths: with its faint wish to stay the block lacked 3% of its speed.
    np.testing.assert_allclose(begun, [0.1, 0, 0, 0, 0, 0], atol=1e-6)


def test_the_rod_swings_as_the_closed_form_says(driven):
    motion, told = driven
    rod = -np.arcsin(CRANK / ROD * np.sin(FIRST + told))
    np.testing.assert_allclose(motion.path.q[:, 1], rod - rod[0] - told, atol=2 * TURN)


def test_the_motor_gives_the_power_that_the_motion_takes(driven):
    motion, _ = driven
    power = (motion.torque[:, 0, 2] * motion.path.rate[:, 0])[2:]  # the first step is a blow from rest to full speed
    work = np.cumsum(0.5 * STEP_S * (power[1:] + power[:-1]))
    gained = motion.energy[3:] - motion.energy[2]
    np.testing.assert_allclose(work, gained, atol=1e-3 * np.ptp(motion.energy[2:]))  # trapezoids of 8 mrad


def test_a_record_on_the_steps_themselves_is_read_at_each_steps_end():
    model = build(slider_crank(effects=[effect("motor", "prescribed_motion", ["main"])]))
    steps, step_s = 3000, 1e-3
    times = np.arange(steps + 2) * step_s
    record = on_steps(model, [(("motor", "q"), times, np.arange(steps + 2.0))], step_s, steps)
    np.testing.assert_allclose(record.values[:, 0], np.arange(1.0, steps + 2), rtol=1e-12)


def test_a_path_is_joined_smoothly_between_its_samples_and_stops_without_overshoot():
    model = build(slider_crank(effects=[effect("motor", "prescribed_motion", ["main"])]))
    told = lambda t: np.where(t < 0.5, 0.4 * (1.0 - np.cos(2 * np.pi * t)), 0.8)  # noqa: E731 - turns, then rests
    coarse, steps, step_s = np.arange(0.0, 1.0, 0.01), 900, 1e-3
    record = on_steps(model, [(("motor", "q"), coarse, told(coarse))], step_s, steps)
    at = step_s * np.arange(1, steps + 2)
    found = np.asarray(record.values[:, 0])
    np.testing.assert_allclose(found, told(at), atol=1e-4)  # held from sample to sample it would be off by 0.025
    assert found.max() <= 0.8 + 1e-12
    for samples in (1, 2):  # too few for a curve
        few = on_steps(model, [(("motor", "q"), coarse[:samples], 0.3 + coarse[:samples])], step_s, 20)
        np.testing.assert_allclose(few.values[:, 0], 0.3 + np.minimum(at[:21], coarse[samples - 1]), atol=1e-12)
