"""Ends of travel: never passed, and the blow keeps nothing."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.rollout import rollout
from tests.mechanisms import body, document, effect, pendulum, sliding_mass
from tests.motions import follow

STEP_S, STEPS, SPEED, END = 1e-3, 1000, 0.8, 0.2


def hit(speed, gravity=(0.0, 0.0, 0.0), step_s=STEP_S, steps=STEPS, **wall):
    stop = effect("stop", "joint_stop", ["rail"], lower=-0.1, upper=END, **wall)
    model = build(sliding_mass([stop], gravity=gravity))
    return follow(model, step_s, steps, np.array([[speed, 0, 0, 0, 0, 0]]))


@pytest.mark.parametrize(("speed", "end"), [(SPEED, END), (-SPEED, -0.1)])
def test_a_block_that_hits_its_stop_stays_there(speed, end):
    motion = hit(speed)
    q = motion.path.q[:, 0]
    assert q.max() <= END + 1e-9
    assert q.min() >= -0.1 - 1e-9
    arrived = int(abs(end) / SPEED / STEP_S)
    np.testing.assert_allclose(q[arrived + 5 :], end, atol=SPEED * STEP_S)  # it stops inside the last step before
    assert np.abs(motion.path.rate[arrived + 50 :, 0]).max() < 1e-2 * SPEED
    assert not motion.path.lost.any()


@pytest.mark.parametrize("step_s", [1e-3, 1e-4])
def test_a_blow_takes_the_energy_however_short_the_step(step_s):
    motion = hit(0.5 * END / (step_s * STEPS) * 4, step_s=step_s)
    assert motion.kinetic[-1] < 1e-3 * motion.kinetic[0]


def test_a_block_stops_alike_beside_a_heavy_one_that_nothing_joins_to_it():
    stop = effect("stop", "joint_stop", ["rail"], upper=END)
    rub = effect("rub", "coulomb_friction", ["rail"], friction_force_n=0.05)
    alone = document(sliding_mass([stop, rub], gravity=(1.0, 0.0, 0.0)))

    def beside(mass):
        (rail,) = alone["joints"]
        other = body("other", (0, 0, 0), Rotation.identity(), mass, mass * np.array([4e-4, 6e-4, 8e-4]))
        joints = [rail, {**rail, "id": "more", "body_b": "other"}]
        drawn = alone | {"bodies": [*alone["bodies"], other], "joints": joints}
        return follow(build(parse_mechanism(drawn)), STEP_S, STEPS).path.q[:, 0]

    # What is little for the heavy one kept the light one up to 0.7 mm off its stop.
    np.testing.assert_allclose(beside(5e5), beside(0.5), rtol=0, atol=1e-8)


def test_a_block_pressed_on_its_stop_rests_on_it_with_its_weight():
    motion = hit(0.0, gravity=(9.81, 0.0, 0.0))
    assert motion.path.q[-1, 0] == pytest.approx(END, abs=1e-5)
    assert np.abs(motion.path.rate[-1, 0]) < 1e-6
    assert (motion.path.q[:, 0] <= END + 1e-9).all()


def test_energy_never_grows_at_a_stop():
    motion = hit(SPEED, gravity=(-3.0, 0.0, 0.0))
    assert np.max(motion.energy - np.minimum.accumulate(motion.energy)) < 1e-3 * motion.kinetic[0]


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_soft_end_gives_way_as_a_spring_of_its_stiffness_and_throws_back_what_it_keeps(restitution):
    """The law that loads with stiffness 2 k / (1 + e²) and unloads with e² of that (Walton and Braun 1986)."""
    mass, stiffness = 0.5, 2e3
    motion = hit(SPEED, step_s=0.25 * STEP_S, steps=1600, restitution=restitution, stiffness_n_per_m=stiffness)
    depth = SPEED * np.sqrt(mass * (1.0 + restitution**2) / (2.0 * stiffness))
    assert motion.path.q.max() - END == pytest.approx(depth, rel=0.03)
    if restitution > 0.0:
        assert motion.path.rate[-1, 0] == pytest.approx(-restitution * SPEED, rel=0.02, abs=1e-3)
    else:
        assert abs(motion.path.rate[-1, 0]) < 2e-2 * SPEED


@pytest.mark.parametrize(("end", "lost"), [(-0.6, False), (1.5, True)])
def test_a_search_soon_gives_up_a_bar_that_begins_far_behind_a_rigid_end(end, lost):
    """A trial step of a fit may put an end there; to hold it still took a thousand iterations in every step."""
    model = build(pendulum(0.9, effects=[effect("end", "joint_stop", ["pin"], lower=end, upper=3.0)]))
    plant = system(model)
    begun = Start(drawn_pose(model, plant), jnp.zeros((model.topology.slots, 6)))
    last = jnp.asarray(STEPS)
    path = eqx.filter_jit(rollout)(plant, begun, STEP_S, STEPS, halvings=8, until=last)
    assert bool(path.lost[-1]) == lost
    taken = np.asarray(path.iterations)[~np.asarray(path.lost)]
    assert taken.sum() < 10 * STEPS
