"""Derivatives of a motion, forward and adjoint, against differences and against each other."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import free_motions, start
from backend.simulate.rollout import rollout
from tests.mechanisms import effect, fourbar, scissor

STEP_S, STEPS = 1e-3, 120


def errors(body):
    return [
        effect("length", "length_error", [body], relative=1e-3),
        effect("mass", "mass_error", [body], relative=0.05),
    ]


LINKAGES = {
    "scissor": lambda: scissor(
        3,
        [
            effect("pin", "pin_friction", "all", friction_coefficient=0.1),
            effect("coulomb", "coulomb_friction", "all", friction_torque_n_m=5e-4),
            *errors("a0"),
        ],
    ),
    "fourbar": lambda: fourbar(
        [effect("viscous", "viscous_friction", "all", damping_n_m_s_per_rad=2e-4), *errors("coupler")]
    ),
}


class Slopes(NamedTuple):
    """One linkage's sight in time, and its derivatives, at one point of its parameters."""

    names: list[str]
    at: np.ndarray
    seen: Callable[[np.ndarray], np.ndarray]
    columns: np.ndarray
    pulled: np.ndarray
    weights: np.ndarray


@pytest.fixture(scope="module", params=["fourbar", pytest.param("scissor", marks=pytest.mark.nightly)])
def slopes(request):
    model = build(LINKAGES[request.param]())
    plant = eqx.filter_jit(system)(model)
    reference = drawn_pose(model, plant)
    motions = free_motions(plant, reference)
    table = model.parameters
    scalar = [a for a, row in table.items() if row.declaration.size == 1 and row.value]
    count, free = len(scalar), motions.shape[2]
    names = [*map("-".join, scalar), *(f"{what} {i}" for what in ("coordinate", "rate") for i in range(free))]
    first = 0.02 * np.arange(1, free + 1)
    at = np.array([*(table[a].value for a in scalar), *first, *(10 * first)])

    def seen(x):
        # Differences cannot bear the default's 1e-10 of solver noise.
        real = system(model.with_parameters(dict(zip(scalar, x[:count], strict=True))), 1e-13)
        begin = start(real, reference, motions, x[count : count + free], x[count + free :])
        path = rollout(real, begin, STEP_S, STEPS)
        return jnp.concatenate([path.q[::10].ravel(), path.pose.position[::10].ravel()])

    def with_slopes(x):
        values, along = jax.vmap(lambda v: jax.jvp(seen, (x,), (v,)), out_axes=(None, 0))(jnp.eye(at.size))
        return values, along

    forward = jax.jit(with_slopes)
    values, columns = forward(at)
    weights = np.random.default_rng(11).standard_normal(values.shape)
    pulled = jax.jit(jax.grad(lambda x: weights @ seen(x)))(at)
    return Slopes(names, at, lambda x: np.asarray(forward(x)[0]), np.asarray(columns), np.asarray(pulled), weights)


def test_forward_slopes_agree_with_differences(slopes):
    for name, at, column, unit in zip(slopes.names, slopes.at, slopes.columns, np.eye(len(slopes.at)), strict=True):
        apart = []
        for share in (1e-3, 1e-4):  # the larger step bends, the smaller one sees rounding: the better of two counts
            by = share * min(abs(at), 0.1) if "length" not in name else 0.1 * share
            difference = (slopes.seen(slopes.at + by * unit) - slopes.seen(slopes.at - by * unit)) / (2 * by)
            apart.append(np.linalg.norm(difference - column) / np.linalg.norm(difference))
        assert min(apart) <= 1e-5, f"{name}: {apart}"


def test_forward_and_adjoint_are_transposes(slopes):
    forward = slopes.columns @ slopes.weights
    size = np.linalg.norm(slopes.columns, axis=1) * np.linalg.norm(slopes.weights)
    assert np.abs(forward - slopes.pulled).max() > 0  # two programs, not one
    assert (np.abs(forward - slopes.pulled) <= 1e-9 * size).all()


def test_a_motion_is_the_same_whether_or_not_its_slopes_are_asked_for():
    model = build(fourbar())
    plant = eqx.filter_jit(system)(model)
    reference = drawn_pose(model, plant)
    motions = free_motions(plant, reference)

    def turned(rate):
        return rollout(plant, start(plant, reference, motions, jnp.zeros(1), rate), STEP_S, STEPS).q

    rate = jnp.array([80.0])
    plain, (seen, _) = jax.jit(turned)(rate), jax.jit(lambda x: jax.jvp(turned, (x,), (x,)))(rate)
    assert np.ptp(plain, axis=0).max() > 2 * np.pi  # whole turns count
    np.testing.assert_allclose(seen, plain, rtol=0, atol=1e-9)
