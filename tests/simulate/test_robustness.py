"""A motion that cannot be followed ends in a sentence, never in a NaN; and a batch is many single runs."""

import equinox as eqx
import jax
import numpy as np
import pytest

from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.report.run_summary import summary_json
from backend.simulate.rollout import GRACE, rollout
from backend.simulate.run import simulate
from tests.mechanisms import WEIGHTLESS, double_pendulum, effect, fourbar, pendulum
from tests.motions import stacked, still

STEP_S, STEPS = 1e-3, 300
ADDRESS = ("f", "friction_torque_n_m")


@pytest.fixture(scope="module")
def absurd():
    """A double pendulum pulled by a force that no step of a millisecond can follow."""
    push = effect("push", "applied_force", ["lower"], force_n=1e9, direction=[0, 1, 0], point_m=[0.2, 0, 0])
    return simulate(double_pendulum([push]), 0.05, 1e-3)


def test_a_step_that_cannot_be_solved_freezes_the_motion(absurd):
    for table in (absurd.q, absurd.position_m, absurd.velocity_m_per_s, absurd.reaction_force_n):
        for values in table.values():
            assert np.isfinite(values).all()
    np.testing.assert_array_equal(absurd.q["elbow"][-1], absurd.q["elbow"][-2])


def test_a_step_that_cannot_be_solved_is_told_in_a_sentence(absurd):
    assert not absurd.done
    assert "could not be solved" in absurd.result
    assert "Try a smaller step than 0.001 s" in absurd.result


def follow_alone(model, steps):
    plant = system(model)
    return rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, steps)


def test_no_time_is_spent_behind_the_step_that_is_lost():
    push = effect("push", "applied_force", ["lower"], force_n=1e9, direction=[0, 1, 0], point_m=[0.2, 0, 0])
    model = build(double_pendulum([push]))
    plant = system(model)
    begin = Start(drawn_pose(model, plant), still(model))
    whole, ended = (rollout(plant, begin, STEP_S, 20, None, 0, until) for until in (None, np.array(20)))
    np.testing.assert_array_equal(ended.lost, whole.lost)
    np.testing.assert_allclose(ended.q, whole.q, rtol=0, atol=1e-12)
    # Behind it nothing was solved: iterations stand at those of the step that was lost.
    np.testing.assert_array_equal(ended.iterations, np.full(21, ended.iterations[0]))


def test_a_motion_that_takes_too_long_is_given_up_and_no_time_is_spent_behind():
    model = build(double_pendulum([]))
    plant = system(model)
    begin = Start(drawn_pose(model, plant), still(model))
    whole, ended = (rollout(plant, begin, STEP_S, 200, None, 0, np.array(200), patience) for patience in (300, 1))
    assert not whole.lost.any()
    spent = np.cumsum(whole.iterations)
    (first, *_) = np.flatnonzero(spent > np.arange(201) + GRACE)
    np.testing.assert_array_equal(ended.lost, np.arange(201) >= first)
    np.testing.assert_allclose(ended.q[:first], whole.q[:first], rtol=0, atol=1e-12)


def test_a_motion_that_ends_early_is_the_first_part_of_the_whole_with_its_slopes():
    model = build(double_pendulum([effect("f", "viscous_friction", ["elbow"])]))

    def path(damping, until):
        plant = system(model.with_parameters({("f", "damping_n_m_s_per_rad"): damping}), 1e-13)
        return rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, STEPS, None, 0, until).q

    whole, early = (
        jax.jvp(lambda d, u=u: path(d, u), (np.array(1e-3),), (np.array(1.0),)) for u in (None, np.array(120))
    )
    for long, short in zip(whole, early, strict=True):
        # Two programs, each with its own rounding, which this pendulum's slopes raise a millionfold on their way to 50.
        np.testing.assert_allclose(short[:121], long[:121], rtol=0, atol=1e-9 * np.abs(long[:121]).max())
        np.testing.assert_array_equal(short[121:], np.broadcast_to(short[120], short[121:].shape))
    assert np.abs(early[1]).max() > 1e-3


@pytest.fixture(scope="module")
def frictions():
    model = build(fourbar([effect("f", "coulomb_friction", ["j2"])]))
    return [model.with_parameters({ADDRESS: value}) for value in np.linspace(0.0, 0.02, 8)]


def test_a_batch_of_eight_frictions_is_eight_single_runs(frictions):
    def go(model):
        return follow_alone(model, STEPS).q

    together = eqx.filter_jit(eqx.filter_vmap(go))(stacked(frictions))
    alone = eqx.filter_jit(go)
    for one, model in zip(together, frictions, strict=True):
        np.testing.assert_allclose(one, alone(model), atol=1e-8)  # each stops its iterations at 1e-10 by itself
    assert np.ptp(np.asarray(together)[:, -1, 0]) > 1e-3


def test_one_lost_sample_does_not_spoil_a_batch():
    push = effect("push", "applied_force", ["lower"], direction=[0, 1, 0], point_m=[0.2, 0, 0])
    model = build(double_pendulum([push]))
    batch = stacked([model.with_parameters({("push", "force_n"): force}) for force in (0.0, 1e9)])
    path = eqx.filter_jit(eqx.filter_vmap(lambda m: follow_alone(m, 50)))(batch)
    assert not path.lost[0].any()
    assert path.lost[1].all()
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(path) if leaf.dtype == float)


def test_a_summary_tells_of_steps_that_had_to_be_cut():
    spin = effect("spin", "release_velocity", ["pin"], rad_per_s=1500.0)
    run = simulate(pendulum(effects=[spin], gravity=WEIGHTLESS), 0.004)  # a step turns by one radian at most
    assert run.done
    assert "steps had to be cut to be solved" in "".join(summary_json(run)["remarks"])
