"""Forces on record, held from sample to sample, against what they do to a mass."""

import numpy as np
import pytest

from backend.model.build import build
from backend.simulate.record import on_steps
from backend.simulate.run import simulate
from tests.mechanisms import effect, sliding_mass
from tests.motions import follow

FORCE, MASS, STEP_S, STEPS = 2.0, 0.5, 2e-3, 200


@pytest.fixture(scope="module")
def drawn():
    return sliding_mass([effect("motor", "effort_offset", "all", force_n=0.0)], mass=MASS)


def pushed(drawn, times, forces, start_s=0.0):
    """Nodes' times and how far the mass has come, let go at `start_s` of the record."""
    model = build(drawn)
    series = [(("motor", "force_n"), np.asarray(times), np.asarray(forces))]
    motion = follow(model, STEP_S, STEPS, record=on_steps(model, series, STEP_S, STEPS, start_s))
    return STEP_S * np.arange(STEPS + 1), np.asarray(motion.path.q[:, 0])


def test_a_force_that_sets_in_at_the_release_acts_from_there(drawn):
    """A half of the first step's push lay before the release: the mass came a quarter of a step late."""
    t, way = pushed(drawn, [0.0, 0.25], [0.0, FORCE], start_s=0.25)
    np.testing.assert_allclose(way, 0.5 * FORCE / MASS * t**2, atol=1e-9)


def test_a_force_that_changes_within_a_step_gives_all_its_push(drawn):
    """Its moment within the step is the method's error, of second order."""
    at, after = 0.1007, -3.0
    t, way = pushed(drawn, [0.0, at], [FORCE, after])
    late = np.maximum(t - at, 0.0)
    told = 0.5 * FORCE / MASS * t**2 + 0.5 * (after - FORCE) / MASS * late**2
    np.testing.assert_allclose(way, told, atol=abs(after - FORCE) / MASS * STEP_S**2 / 8)


def test_a_simulation_takes_a_motor_that_starts_with_it(drawn):
    run = simulate(drawn, 0.1, STEP_S, inputs=[(("motor", "force_n"), np.array([-1.0, 0.0]), np.array([0.0, FORCE]))])
    assert run.q["rail"][-1] == pytest.approx(0.5 * FORCE / MASS * 0.1**2, rel=1e-6)
