"""Derivatives of a motion with blows and rubbing; and its convergence as step and barrier shrink."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.rollout import rollout
from tests.loose import loose_bar
from tests.motions import still

STEP_S, STEPS = 1e-3, 100
AT = {"radial_m": 1e-3, "friction_coefficient": 0.2, "stiffness_n_per_m": 2e5, "restitution": 0.4}


@pytest.fixture(scope="module")
def slopes():
    """A bar that falls into its hole, bounces and swings: sight in time, forward slopes and pulled-back weights."""
    model = loose_bar(0.6, **AT)
    size = np.array(list(AT.values()))

    def seen(x):
        given = {("play", name): value for name, value in zip(AT, x * size, strict=True)}
        plant = system(model.with_parameters(given), 1e-13)  # differences cannot bear more noise
        path = rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, STEPS)
        return jnp.concatenate([path.q[::10].ravel(), path.pose.position[::10].ravel()]), (path.wall, path.lost)

    ones = np.ones(len(AT))
    run = jax.jit(seen)
    values, (wall, lost) = run(ones)
    assert not lost.any()
    assert (wall[1:-1] < 0.1).any()  # N: it flies
    assert (wall > 0.5).any()  # N: and is carried
    columns = jax.jit(jax.jacfwd(lambda x: seen(x)[0]))(ones)
    weights = np.random.default_rng(3).standard_normal(values.shape)
    pulled = jax.jit(jax.grad(lambda x: weights @ seen(x)[0]))(ones)
    return lambda x: np.asarray(run(x)[0]), np.asarray(columns), np.asarray(pulled), weights


@pytest.mark.nightly
@pytest.mark.parametrize("place", range(len(AT)), ids=list(AT))
def test_forward_slopes_through_contact_agree_with_differences(slopes, place):
    seen, columns, _, _ = slopes
    apart = []
    for by in (1e-4, 1e-5, 1e-6):  # of the parameter; the larger steps bend, the smaller ones see rounding
        unit = by * np.eye(len(AT))[place]
        difference = (seen(1.0 + unit) - seen(1.0 - unit)) / (2 * by)
        apart.append(np.linalg.norm(difference - columns[:, place]) / np.linalg.norm(difference))
    assert min(apart) < 1e-5, apart


def test_adjoint_slopes_through_contact_are_the_forward_ones_transposed(slopes):
    _, columns, pulled, weights = slopes
    assert (
        np.abs(weights @ columns - pulled) <= 1e-8 * np.linalg.norm(columns, axis=0) * np.linalg.norm(weights)
    ).all()


@pytest.mark.parametrize("place", [0, 1, 3], ids=["radial_m", "friction_coefficient", "restitution"])
def test_slopes_through_many_bounces_are_those_of_the_motion_as_simulated(place):
    """Only narrow differences show it: 1e-5 more play already moves a blow into another step."""
    bouncing = {**AT, "stiffness_n_per_m": 1e10, "restitution": 0.8}
    model, (name, size) = loose_bar(0.6, **bouncing), list(bouncing.items())[place]

    @jax.jit
    def seen(x):
        # Solved as far as it goes: what a tolerance leaves has a slope of its own, of 1e-4.
        plant = system(model.with_parameters({("play", name): x * size}), 0.0)
        path = rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, 75)
        return jnp.concatenate([path.q.ravel(), path.pose.position.ravel()]), path.wall[:, 0] > 0.5

    pushed = np.asarray(seen(1.0)[1])
    assert (pushed[1:] & ~pushed[:-1]).sum() >= 3  # blows
    slope = jax.jit(jax.jacfwd(lambda x: seen(x)[0]))(1.0)
    apart = []
    for by in (1e-8, 1e-7):
        difference = (seen(1.0 + by)[0] - seen(1.0 - by)[0]) / (2 * by)
        apart.append(np.linalg.norm(difference - slope) / np.linalg.norm(difference))
    assert min(apart) < 1e-5, apart


@eqx.filter_jit
def _end(model, step_s, barrier, steps):
    plant = system(model)
    plant = eqx.tree_at(lambda s: s.barrier, plant, barrier * plant.barrier)
    path = rollout(plant, Start(drawn_pose(model, plant), still(model)), step_s, steps, None, 6)
    return path.pose.position[-1, 0]


@pytest.mark.nightly
def test_an_answer_with_contact_converges_only_if_the_barrier_shrinks_with_the_step():
    """The barrier is an energy times the step; `held` keeps the product as it is at 1 ms, ten thousand times larger."""
    model = loose_bar(0.6, radial_m=2e-3, friction_coefficient=0.2)

    def end(step_s, barrier=1.0):
        return np.asarray(_end(model, jnp.asarray(step_s), jnp.asarray(barrier), round(0.2 / step_s)))

    truth = end(3.125e-5)
    along = [np.linalg.norm(end(h) - truth) for h in (1e-3, 2.5e-4)]
    held = [np.linalg.norm(end(h, 1e4 * 1e-3 / h) - truth) for h in (1e-3, 2.5e-4)]
    assert along[1] < 0.5 * along[0]
    assert held[1] > 0.9 * held[0]
