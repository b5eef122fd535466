"""Questions put to every effect of the catalogue, found by looking."""

import dataclasses
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.effects.__main__ import PAGE, VOCABULARY, page
from backend.effects.catalogue import catalogue, effect_of_kind, vocabulary
from backend.effects.effect import BodyView
from backend.effects.shapes import (
    AbstractBedFriction,
    AbstractBodyForce,
    AbstractClock,
    AbstractDrag,
    AbstractDryFriction,
    AbstractJointClearance,
    AbstractJointDamping,
    AbstractJointEffort,
    AbstractJointStop,
    AbstractLinkContact,
    AbstractRateFriction,
    AbstractShutter,
    AbstractStrut,
    AbstractView,
    Camera,
    Sight,
)
from tests.effects import rig

EFFECTS = catalogue()
DISSIPATIVE = (
    AbstractJointDamping,
    AbstractDryFriction,
    AbstractRateFriction,
    AbstractDrag,
    AbstractJointStop,
    AbstractJointClearance,
    AbstractLinkContact,
    AbstractBedFriction,
)


def of(*shapes):
    return [kind for kind, effect in EFFECTS.items() if issubclass(effect, shapes)]


def example(kind):
    """The effect alone, every parameter at a telling value."""
    rng = np.random.default_rng(3)
    numbers = {n: jnp.asarray(rng.uniform(0.2, 0.7, d.size).squeeze()) for n, d in EFFECTS[kind].declarations().items()}
    return EFFECTS[kind](**numbers)


@pytest.mark.parametrize("kind", EFFECTS)
def test_array_leaves_are_the_declared_parameters_and_nothing_else(kind):
    effect = EFFECTS[kind]
    leaves = [field.name for field in dataclasses.fields(effect) if not field.metadata.get("static")]
    assert leaves == list(effect.declarations())
    assert len(jax.tree.leaves(example(kind))) == len(leaves)
    assert all(eqx.is_inexact_array(leaf) for leaf in jax.tree.leaves(example(kind)))


@pytest.mark.parametrize("kind", EFFECTS)
def test_every_parameter_tells_its_meaning_and_a_default_inside_its_bounds(kind):
    for name, declared in EFFECTS[kind].declarations().items():
        assert declared.doc, name
        assert declared.unit, name
        for value in (declared.default,) if declared.default is not None else ():
            assert declared.lower is None or value >= declared.lower
            assert declared.upper is None or value <= declared.upper


def test_a_kind_without_a_file_is_refused_with_the_kinds_that_have_one():
    with pytest.raises(ValueError, match=r"'magnetism' cannot be simulated yet; simulated kinds: air_drag, "):
        effect_of_kind("magnetism")


def test_the_vocabulary_that_readers_of_drawings_use_is_fresh():
    assert json.loads(VOCABULARY.read_text("utf-8")) == vocabulary(), "run: python -m backend.effects"


def test_the_page_of_effects_is_fresh():
    assert PAGE.read_text("utf-8") == page(), "run: python -m backend.effects"


@pytest.fixture(scope="module")
def free_fall():
    return rig.motion(rig.bare())


def test_absent_means_zero_every_effect_at_its_default_leaves_the_motion_alone(free_fall):
    laden = rig.motion(rig.laden())
    # The solver leaves 1e-10 mechanism lengths a step, which a quarter of a second doubles a few times.
    np.testing.assert_allclose(laden.path.q, free_fall.path.q, atol=1e-9)
    np.testing.assert_allclose(laden.path.pose.position, free_fall.path.pose.position, atol=1e-9)


@pytest.mark.parametrize("kind", of(*DISSIPATIVE))
def test_a_dissipative_effect_only_takes_energy(kind, free_fall):
    # A wall that gives holds energy for a while, and at a rebound the mean of both velocities has less than either.
    values = {a: v for a, v in rig.present(kind).items() if a[1] not in ("stiffness_n_per_m", "restitution")}
    motion = rig.motion(rig.carrier(kind).with_parameters(values))
    wobble = np.abs(free_fall.energy - free_fall.energy[0]).max()  # a symplectic step's own h² oscillation
    rise = np.max(motion.energy - np.minimum.accumulate(motion.energy))
    assert rise <= 3 * wobble
    if kind != "joint_stop":  # its ends are out of reach here; tests/physics drives into them
        assert motion.energy[0] - motion.energy[-1] > 10 * wobble


def test_a_damper_beside_a_spring_only_takes_energy(free_fall):
    damper = {("extension_spring", "damping_n_s_per_m"): 0.3}
    motion = rig.motion(rig.laden().with_parameters(damper))
    wobble = np.abs(free_fall.energy - free_fall.energy[0]).max()
    assert np.max(motion.energy - np.minimum.accumulate(motion.energy)) <= 3 * wobble
    assert motion.energy[0] - motion.energy[-1] > 10 * wobble


@pytest.mark.parametrize("kind", [k for k in of(AbstractJointEffort, AbstractStrut) if k != "effort_offset"])
def test_a_stored_energy_moves_no_more_and_no_less_than_it_holds(kind, free_fall):
    values = {a: v for a, v in rig.present(kind).items() if "damping" not in a[1]}
    motion = rig.motion(rig.laden().with_parameters(values))
    assert np.abs(motion.path.q - free_fall.path.q).max() > 1e-4  # it did something
    assert np.ptp(motion.energy) < 1e-3 * motion.kinetic.max()  # h² (natural rate)², as in the laws


@pytest.mark.parametrize("kind", of(AbstractJointEffort, AbstractStrut))
def test_the_effort_is_the_slope_of_what_is_stored(kind):
    effect, at = example(kind), jnp.asarray(0.31)
    slope = jax.grad(effect.potential)(at)
    if any(d.drive for d in effect.declarations().values()):
        assert slope == 0.0  # a drive stores nothing
    else:
        felt = -effect.tension(at) if isinstance(effect, AbstractStrut) else effect.effort(at)
        assert float(felt) == pytest.approx(-float(slope), rel=1e-12)


def view(p_WC, velocity=(0.0, 0.0, 0.0)):
    return BodyView(
        jnp.asarray(p_WC),
        jnp.eye(3),
        jnp.asarray(velocity),
        jnp.zeros(3),
        jnp.asarray(0.3),
        jnp.zeros(3),
        jnp.eye(3),
        jnp.array([1.0, 0.0, 0.0]),
        jnp.ones(()),
    )


@pytest.mark.parametrize("kind", of(AbstractBodyForce))
def test_a_force_on_a_body_is_the_slope_of_what_is_stored_and_has_a_reaction(kind):
    effect, here, there = example(kind), jnp.array([0.1, 0.2, -0.3]), view([0.4, 0.0, 0.1])
    slope = jax.grad(lambda p: effect.potential(view(p), there))(here)
    on_a, on_b = effect.wrench(view(here), there)
    if any(d.drive for d in effect.declarations().values()):
        np.testing.assert_array_equal(slope, 0.0)
        np.testing.assert_allclose(on_a.force, -on_b.force)
        turned = on_a.torque + jnp.cross(here, on_a.force) + on_b.torque + jnp.cross(there.p_WC, on_b.force)
        np.testing.assert_allclose(turned, 0.0, atol=1e-15)  # no torque from nothing
    else:
        np.testing.assert_allclose(on_a.force, -slope, rtol=1e-12)


@pytest.mark.parametrize("kind", of(AbstractDrag))
def test_drag_never_pushes_along(kind):
    for velocity in np.random.default_rng(5).standard_normal((5, 3)):
        wrench = example(kind).wrench(view([0.0, 0.0, 0.0], velocity))
        assert float(wrench.force @ velocity) < 0


@pytest.mark.parametrize("kind", of(AbstractDryFriction))
def test_a_friction_limit_is_linear_in_the_load_and_never_negative(kind):
    effect, radius = example(kind), jnp.asarray(0.004)
    limits = np.array([effect.limit(jnp.asarray(load), radius) for load in (0.0, 1.0, 2.0)])
    assert (limits >= 0).all()
    assert limits[2] - limits[1] == pytest.approx(limits[1] - limits[0], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("kind", of(AbstractRateFriction))
def test_a_friction_limit_asks_how_fast_and_not_which_way_and_is_never_negative(kind):
    rates = jnp.linspace(0.0, 3.0, 7)
    limits, back = (np.asarray(jax.vmap(example(kind).limit)(sign * rates)) for sign in (1, -1))
    assert (limits >= 0).all()
    assert np.ptp(limits) > 0
    np.testing.assert_array_equal(limits, back)


CAMERA = Camera(jnp.array([0.0, 0.0, 1.0]), jnp.array([0.0, -1.0, 0.0]), jnp.array([0.1, 0.2, 0.0]), jnp.ones(()))
SIGHT = Sight(*np.random.default_rng(1).standard_normal((2, 4, 3)), np.linspace(-0.1, 1.0, 4), np.array(-0.2))


@pytest.mark.parametrize("kind", of(AbstractView))
def test_a_perfect_camera_reports_what_is_there(kind):
    effect = EFFECTS[kind](**{n: jnp.zeros(()) for n in EFFECTS[kind].declarations()})
    points = SIGHT.p_WP
    np.testing.assert_allclose(effect.view(SIGHT, CAMERA), points, atol=1e-15)
    assert np.abs(example(kind).view(SIGHT, CAMERA) - points).max() > 0.1


def test_a_tracker_is_right_in_the_first_frame_and_slides_off_from_there():
    drift = EFFECTS["tracker_drift"](x_m_per_s=jnp.asarray(0.1), z_m_per_s=jnp.asarray(0.0))
    off = np.asarray(drift.view(SIGHT, CAMERA) - SIGHT.p_WP)[:, 0]
    np.testing.assert_allclose(off, 0.1 * (SIGHT.time_s - SIGHT.began_s), rtol=1e-12)


@pytest.mark.parametrize("kind", of(AbstractShutter))
def test_a_shutter_that_opens_at_once_sees_all_points_at_one_time(kind):
    effect = EFFECTS[kind](**{n: jnp.zeros(()) for n in EFFECTS[kind].declarations()})
    np.testing.assert_array_equal(effect.delay(SIGHT, CAMERA), 0.0)
    assert np.abs(example(kind).delay(SIGHT, CAMERA)).max() > 0.1


@pytest.mark.parametrize("kind", of(AbstractClock))
def test_a_perfect_clock_reports_when_it_was(kind):
    effect = EFFECTS[kind](**{n: jnp.zeros(()) for n in EFFECTS[kind].declarations()})
    times = np.linspace(0.0, 3.0, 7)
    np.testing.assert_array_equal(effect.true_time(times), times)
    later = np.asarray(example(kind).true_time(times))
    assert np.abs(later - times).max() > 0.1
    assert (np.diff(later) > 0).all()


def loaded(model):
    """Every scalar parameter at a telling value at once, so that each derivative meets all the others."""
    # Typed: an array of Python's own number would change its type in a sum, and the program be compiled again.
    return {address: jnp.asarray(rig.sized(address), dtype=float) for address in rig.scalars(model)}


QUESTIONED = [
    pytest.param(address, id="-".join(address))
    for model in (rig.laden(), *map(rig.struck, rig.STRIKING))
    for address in rig.scalars(model)
]


@pytest.mark.parametrize("address", QUESTIONED)
def test_the_slope_in_every_parameter_agrees_with_differences(address):
    model = rig.carrier(address[0])
    values = loaded(model)
    unit = {a: jnp.asarray(a == address, dtype=float) for a in values}
    exact = np.asarray(rig.seen_and_slope(model, values, unit)[1])
    assert np.linalg.norm(exact) > 0
    # Where parts strike, a narrow difference shows the steps' own rounding and a wide one moves blows into other steps:
    # one of fourth order may be wide.
    striking = address[0] in rig.STRIKING
    weights = {1: 2 / 3, 2: -1 / 12} if striking else {1: 1 / 2}
    apart = []
    for share in 10.0 ** np.arange(-6, -2) if striking else (1e-3,):
        by = share * max(abs(float(values[address])), 1e-3)
        difference = 0.0
        for reach, weight in weights.items():
            moved = [{**values, address: values[address] + side * reach * by} for side in (1, -1)]
            up, down = (rig.seen_and_slope(model, there, unit)[0] for there in moved)
            difference += weight * np.asarray(up - down) / by
        apart.append(np.linalg.norm(exact - difference) / np.linalg.norm(difference))
    assert min(apart) <= 1e-5, apart
