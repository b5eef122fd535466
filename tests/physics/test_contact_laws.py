"""What every motion with loose, bouncing and rubbing pins keeps, and what it never gains."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import Pose, Start, drawn_pose
from backend.model.system import system
from backend.simulate import kinematics
from backend.simulate.momentum import momentum
from backend.simulate.rollout import rollout
from backend.simulate.small import apply
from tests.mechanisms import bennett, document, effect, fourbar, free_pair, scissor, slider_crank
from tests.motions import follow

STEP_S, STEPS = 1e-3, 400
AROUND_BLOWS = 6  # nodes: one where parts strike shows the mean of both speeds, which is a dip
PINS = {"slider-crank": ["main", "crankpin", "wrist"]}


def drawn(name, **play):
    mechanism = {"four-bar": fourbar, "Bennett": bennett, "slider-crank": slider_crank, "scissor": lambda: scissor(2)}
    drawing = document(mechanism[name]())
    given = effect("play", "clearance", PINS.get(name, "all"), radial_m=5e-4, **play)
    drawing["effects"].append(given.model_dump(mode="json"))
    return build(parse_mechanism(drawing))


LAWS = ((0.0, 0.0), (0.2, 0.5), (0.0, 0.9), (0.2, 0.9), (0.0, 1.0))
LOOSE = [(name, *law) for name in ("four-bar", "slider-crank", "Bennett", "scissor") for law in LAWS]


@pytest.mark.parametrize(("name", "friction", "restitution"), LOOSE)
def test_energy_never_grows_where_pins_are_loose(name, friction, restitution):
    motion = follow(drawn(name, friction_coefficient=friction, restitution=restitution), STEP_S, STEPS, halvings=6)
    assert not motion.path.lost.any()
    seen = np.lib.stride_tricks.sliding_window_view(motion.energy, AROUND_BLOWS).max(1)
    growth = np.max(seen - np.minimum.accumulate(seen))
    # A pin that swings in its hole is far quicker than the linkage: its steps wobble; blows in a row hide in dips.
    assert growth < 3e-4 * motion.kinetic.max()


@pytest.fixture(scope="module")
def flight():
    """Momenta at the nodes of a pair that flies freely, its hinge loose, bouncing and rubbing."""
    drawing = document(free_pair())
    play = effect("play", "clearance", "all", radial_m=5e-4, friction_coefficient=0.3, restitution=0.7)
    drawing["effects"].append(play.model_dump(mode="json"))
    model = build(parse_mechanism(drawing))
    velocity = jnp.array([[0.3, 0.1, -0.2, 4, 2, -3], [-0.2, 0.3, 0.1, -2, 5, 1]])

    @eqx.filter_jit
    def momenta(model, step_s):
        plant = system(model, 1e-13)  # a step's error over h is a momentum
        path = rollout(plant, Start(drawn_pose(model, plant), velocity), step_s, 500, None, 6)

        def between(now: Pose, then: Pose):
            P = momentum(plant, now.increment(then), step_s, 1.0)
            R = kinematics.bodies(plant, now).rotation[:2]
            turning = apply(R, P[:, 3:]) + jnp.cross(now.position, P[:, :3])
            return jnp.concatenate([P[:, :3].sum(0), turning.sum(0)])

        first, second = (jax.tree.map(lambda leaf, s=part: leaf[s], path.pose) for part in (np.s_[:-1], np.s_[1:]))
        return jax.vmap(between)(first, second), path

    seen, path = momenta(model, jnp.asarray(STEP_S))
    assert not np.asarray(path.lost).any()
    assert np.ptp(np.asarray(path.wall)) > 1.0  # N: it strikes
    return np.asarray(seen)


def test_linear_momentum_is_kept_through_blows_and_friction(flight):
    assert np.abs(flight - flight[0])[:, :3].max() < 1e-10 * np.abs(flight[0, :3]).max()


def test_angular_momentum_is_kept_through_blows_and_friction(flight):
    assert np.abs(flight - flight[0])[:, 3:].max() < 1e-10 * np.abs(flight[0, 3:]).max()
