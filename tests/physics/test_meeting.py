"""Links that meet, against statics, the laws of impact and of friction."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.rollout import rollout
from tests.mechanisms import WEIGHTLESS, Z, bar, bar_inertia, body, drawing, effect
from tests.motions import follow

G, STEP_S = 9.81, 1e-3
LENGTH, MASS, RADIUS, RAIL = 0.2, 0.1, 0.01, 0.02
FRICTION = 0.3
ON_RAIL = RAIL + RADIUS


def touch(on: Sequence[str], first, second, **contact):
    """first, second: (start, end, radius) of each capsule."""
    capsules = {
        f"{what}_{side}_m": value
        for side, capsule in (("a", first), ("b", second))
        for what, value in zip(("start", "end", "radius"), capsule, strict=True)
    }
    return effect("touch", "link_contact", on, **capsules, **contact)


def over_a_rail(along=Z, height=0.0, slope=0.0, **contact):
    """A round bar above a round rail along x, in the xy plane; along z it rolls, along x it lies beside the rail."""
    half = 0.5 * LENGTH * np.array(along)
    solid = np.full(3, 0.5 * MASS * RADIUS**2)
    part = body("bar", (0, ON_RAIL + height, 0), Rotation.identity(), MASS, solid)
    met = touch(["bar", "ground"], (tuple(-half), tuple(half), RADIUS), ((-1, 0, 0), (1, 0, 0), RAIL), **contact)
    held = ("held", "planar", "ground", "bar", (0, 0, 0), Z)
    leaning = (G * np.sin(slope), -G * np.cos(slope), 0.0)
    return build(drawing("bar over a rail", [part], [held], [met], gravity=leaning))


def in_space(first, second, **contact):
    """Two free rods without weight, each (middle, unit direction)."""
    half = 0.5 * LENGTH
    rods = [
        bar(id, np.subtract(middle, half * np.array(along)), np.add(middle, half * np.array(along)), MASS)
        for id, (middle, along) in (("one", first), ("two", second))
    ]
    rod = ((0, 0, 0), (LENGTH, 0, 0), RADIUS)
    return build(drawing("two rods", rods, [], [touch(["one", "two"], rod, rod, **contact)], gravity=WEIGHTLESS))


@pytest.mark.parametrize("along", [Z, (1, 0, 0)], ids=["across", "side by side"])
def test_a_resting_bar_is_carried_with_its_weight(along):
    motion = follow(over_a_rail(along), STEP_S, 300)
    np.testing.assert_allclose(motion.path.touch[100:].sum(1), MASS * G, rtol=1e-5)
    np.testing.assert_allclose(motion.path.pose.position[:, 0, 1], ON_RAIL, atol=1e-8)  # the barrier's own distance
    if along != Z:  # both ends of the stretch that the two share
        np.testing.assert_allclose(np.sort(motion.path.touch[-1])[-2:], MASS * G / 2, rtol=1e-3)


def test_a_bar_rests_in_a_soft_rail_as_deep_as_its_weight_over_the_stiffness():
    stiffness = 1e4
    depth = MASS * G / stiffness
    motion = follow(over_a_rail(height=-depth, stiffness_n_per_m=stiffness), STEP_S, 300)
    np.testing.assert_allclose(motion.path.pose.position[:, 0, 1], ON_RAIL - depth, atol=1e-3 * depth)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_dropped_bar_rebounds_with_its_restitution(restitution):
    height = 0.02
    motion = follow(over_a_rail(height=height, restitution=restitution), STEP_S, 300)
    y, v = motion.path.pose.position[:, 0, 1], motion.path.velocity[:, 0, 1]
    blow, down = np.sqrt(2 * G * height), int(np.sqrt(2 * height / G) / STEP_S)
    assert v[down - 2] == pytest.approx(-blow, abs=3 * G * STEP_S)
    assert v[down + 4] == pytest.approx(restitution * blow, abs=6 * G * STEP_S)  # gravity goes on meanwhile
    assert y[down + 4 :].max() - ON_RAIL == pytest.approx(
        restitution**2 * height, abs=2 * blow * STEP_S * restitution + 1e-8
    )
    # With a rebound the gaps before and after a node are weighed: the node itself may lie beyond by a step's way.
    assert y.min() > ON_RAIL - blow * STEP_S * restitution - 1e-8


def test_energy_never_grows_where_bars_touch():
    height = 0.02
    for restitution, friction in ((0.0, 0.0), (0.5, 0.3), (1.0, 0.0)):
        model = over_a_rail(height=height, restitution=restitution, friction_coefficient=friction)
        motion = follow(model, STEP_S, 300, np.array([[0.5, 0, 0, 0, 0, 3.0]]))
        # At a blow a node's velocity is the mean of those before and after it, which is no speed of the bar.
        struck = (
            np.convolve(np.abs(np.gradient(motion.path.velocity[:, 0, 1])) > 5 * G * STEP_S, np.ones(3), "same") > 0
        )
        energy = motion.energy[~struck]
        assert 0 < struck.sum() < 100
        # A blow falls between two nodes: m v g h.
        assert np.max(energy - np.minimum.accumulate(energy)) < MASS * np.sqrt(2 * G * height) * G * STEP_S


def test_a_sliding_bar_begins_to_roll_with_two_thirds_of_its_speed():
    speed = 0.6
    motion = follow(over_a_rail(friction_coefficient=FRICTION), STEP_S, 300, np.array([[speed, 0, 0, 0, 0, 0]]))
    v, spin = motion.path.velocity[:, 0, 0], motion.path.velocity[:, 0, 5]
    # A solid cylinder: μ m g brakes it and m r² / 2 takes up turn, until v = -ω r.
    assert v[-1] == pytest.approx(2 * speed / 3, rel=1e-4)
    assert spin[-1] == pytest.approx(-v[-1] / RADIUS, rel=1e-4)
    sliding = motion.path.time_s < 0.8 * speed / (3 * FRICTION * G)
    slope = np.polyfit(motion.path.time_s[sliding], v[sliding], 1)[0]
    assert slope == pytest.approx(-FRICTION * G, rel=1e-4)


def test_a_bar_rolls_down_a_slope_with_two_thirds_of_the_fall():
    slope = 0.1
    motion = follow(over_a_rail(slope=slope, friction_coefficient=FRICTION), STEP_S, 300)
    gone = G * np.sin(slope) / 3 * motion.path.time_s[-1] ** 2
    assert motion.path.pose.position[-1, 0, 0] == pytest.approx(gone, rel=1e-4)


def test_a_bar_beside_a_rail_is_held_by_friction_below_its_angle():
    motion = follow(over_a_rail((1, 0, 0), slope=0.8 * np.arctan(FRICTION), friction_coefficient=FRICTION), STEP_S, 300)
    creep = np.diff(motion.path.pose.position[100::100, 0, 0]) / (100 * STEP_S)
    assert (creep > 0).all()
    assert (creep < 2e-6).all()  # STICK_RATE x 10 mm bar = its regularised law's


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("along", [(0, 1, 0), (1, 0, 0), (-1, 0, 0)], ids=["crossed", "side by side", "head to tail"])
def test_rods_part_with_their_restitution_and_share_their_momentum(restitution, along):
    speed = 0.5
    model = in_space(((0, 0, 0), (1, 0, 0)), ((0, 0, 0.03), along), restitution=restitution)
    motion = follow(model, STEP_S, 100, np.array([[0, 0, speed, 0, 0, 0], np.zeros(6)]))
    v, z = motion.path.velocity[-1], motion.path.pose.position[:, :, 2]
    assert v[1, 2] - v[0, 2] == pytest.approx(
        restitution * speed, abs=3e-3 * speed
    )  # κ / h is 1e-6 of the blow's energy
    assert v[0, 2] + v[1, 2] == pytest.approx(speed, rel=1e-9)
    np.testing.assert_allclose(v[:, 3:], 0.0, atol=1e-6)  # the blow is in the middle: neither turns
    assert (z[:, 1] - z[:, 0]).min() > 2 * RADIUS - speed * STEP_S * restitution - 1e-8


@pytest.mark.parametrize(("restitution", "friction"), [(0.0, 0.0), (0.6, 0.0), (0.0, 0.4)])
def test_a_blow_off_the_middle_keeps_momentum_and_makes_no_energy(restitution, friction):
    one, two = ((0, 0, 0), (1, 0, 0)), ((0.04, 0.05, 0.06), np.array([0.3, 0.9, 0.3]) / np.sqrt(0.99))
    model = in_space(one, two, restitution=restitution, friction_coefficient=friction)
    flying = np.array([[0.1, 0.2, 0.8, 1.0, 2.0, -1.0], [0, 0, -0.3, 2.0, -1.0, 0.5]])
    motion = follow(model, STEP_S, 120, flying)
    met = np.flatnonzero(motion.path.touch.max(1) > 1.0)
    before, after = met[0] - 1, met[-1] + 2
    np.testing.assert_allclose(motion.momentum[:, :3], np.tile(motion.momentum[0, :3], (121, 1)), atol=1e-12)
    size = np.linalg.norm(motion.momentum[0, 3:])
    # Central differences of a rod that spins at up to 36 rad/s: h² w² / 8 = 1.6e-4 of its share.
    assert np.abs(motion.momentum[after:, 3:] - motion.momentum[0, 3:]).max() < 2e-4 * size
    assert motion.kinetic[after] < 0.9 * motion.kinetic[before]
    assert np.ptp(motion.kinetic[after:]) < 2e-4 * motion.kinetic[after]


@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_skew_pendulums_that_hit_obey_the_law_of_impact(restitution):
    """Pins about z and about a skew axis: the bars cross in space, and each is struck at its own arm."""
    foot, axis = np.array([0.05, -0.12, -0.1]), np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    bars = [bar("hanging", (0, 0, 0), (0, -LENGTH, 0), MASS), bar("standing", foot, np.add(foot, (0, 0, LENGTH)), MASS)]
    pins = [
        ("one", "revolute", "ground", "hanging", (0, 0, 0), Z),
        ("two", "revolute", "ground", "standing", tuple(foot), tuple(axis)),
    ]
    rod = ((0, 0, 0), (LENGTH, 0, 0), RADIUS)
    met = touch(["hanging", "standing"], rod, rod, restitution=restitution)
    spin = 3.0
    motion = follow(
        build(drawing("skew pendulums", bars, pins, [met], gravity=WEIGHTLESS)),
        STEP_S / 2,
        300,
        np.array([[0.5 * LENGTH * spin, 0, 0, 0, 0, spin], np.zeros(6)]),
    )
    # Common normal of the two axes, by plain geometry.
    turned = Rotation.from_quat(motion.path.pose.quaternion.reshape(-1, 4), scalar_first=True)
    u, v = np.moveaxis(turned.apply([1.0, 0, 0]).reshape(-1, 2, 3), 1, 0)
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v), axis=1)[:, None]
    gap = np.abs(np.sum(normal * np.diff(motion.path.pose.position, axis=1)[:, 0], -1)) - 2 * RADIUS
    blow = int(np.argmax(motion.path.touch.max(1)))
    before, after = blow - 3, blow + 3
    closing, parting = (np.gradient(gap, motion.path.time_s)[node] for node in (before, after))
    assert closing < -0.1
    # The gap's slope itself turns by 1% in six steps.
    assert parting == pytest.approx(-restitution * closing, abs=0.02 * -closing)
    # One impulse along the normal changes both rates: p = I Δω / (dg/dq), the same at each pin.
    rates = motion.path.rate
    inertia = np.array([bar_inertia(MASS, LENGTH)[2] + MASS * LENGTH**2 / 4] * 2)
    inertia[1] = inertia[1] * (1 - axis[2] ** 2) + bar_inertia(MASS, LENGTH)[0] * axis[2] ** 2
    lever = np.array([closing / rates[before, 0], 0.0])
    lever[1] = (parting - lever[0] * rates[after, 0]) / rates[after, 1]
    impulse = inertia * (rates[after] - rates[before]) / lever
    assert impulse[0] == pytest.approx(impulse[1], rel=0.05)
    assert gap.min() > -spin * LENGTH * STEP_S * restitution - 1e-6


# A wider difference moves a blow into another step, where the slope is another.
SLOPES = {"radius_a_m": 1e-8, "friction_coefficient": 1e-5, "restitution": 1e-7}
AT = np.array([RADIUS, FRICTION, 0.5])


@eqx.filter_jit
def seen(model, at):
    """Where a dropped, sliding bar goes, and the slopes of that."""

    def path(at):
        values = {("touch", name): value for name, value in zip(SLOPES, at, strict=True)}
        plant = system(model.with_parameters(values), 1e-13)  # differences cannot bear the default's 1e-10
        begin = Start(drawn_pose(model, plant), jnp.array([[0.3, 0, 0, 0, 0, 2.0]]))
        moved = rollout(plant, begin, jnp.asarray(STEP_S), 120)
        return jnp.concatenate([moved.pose.position[:, :, :2].ravel(), moved.q.ravel()])

    return jax.vmap(lambda along: jax.jvp(path, (at,), (along,)), out_axes=(None, 0))(jnp.eye(3))


def test_slopes_in_radius_friction_and_restitution_agree_with_differences():
    model = over_a_rail(height=0.01, friction_coefficient=FRICTION, restitution=0.5)
    _, slopes = seen(model, jnp.asarray(AT))
    for column, name, unit in zip(np.asarray(slopes), SLOPES, np.eye(3), strict=True):
        by = SLOPES[name]
        # What friction's stopping rule leaves of a blow changes with the restitution: 1e-6 of the difference.
        within = 3e-6 if name == "restitution" else 1e-6
        up, down = (np.asarray(seen(model, jnp.asarray(AT + side * by * unit))[0]) for side in (1, -1))
        difference = (up - down) / (2 * by)
        assert np.linalg.norm(column) > 1e-3
        assert np.linalg.norm(column - difference) < within * np.linalg.norm(difference), name
