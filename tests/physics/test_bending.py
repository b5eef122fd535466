"""Links that bend: two halves on a spring hinge, whole again when straight."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.flexible import split
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import free_motions
from tests.mechanisms import (
    WEIGHTLESS,
    Z,
    bar,
    bar_inertia,
    document,
    drawing,
    effect,
    fourbar,
    free_body,
    pendulum,
)
from tests.motions import crossings, follow, move, still

MASS, LENGTH, WIDTH = 0.1, 0.3, 0.01
HALF_INERTIA = bar_inertia(MASS / 2, LENGTH / 2, WIDTH)[2]
STIFFNESS = 2.0
STEP_S, STEPS = 5e-4, 800
K, B = ("bend", "stiffness_n_m_per_rad"), ("bend", "damping_n_m_s_per_rad")
ERRORS = {("longer", "relative"): 0.02, ("heavier", "relative"): 0.5}
DRAG = ("drag", "n_s_per_m")


def bend(on, stiffness=STIFFNESS, damping=0.0, **rest):
    given = {"stiffness_n_m_per_rad": stiffness, "damping_n_m_s_per_rad": damping, **rest}
    return effect("bend", "link_flexibility", [on], **given)


@cache
def linkage(*, bends):
    """The four-bar with drag and errors of its drawing at zero, its coupler rigid or not: two compiled programs."""
    felt = [
        effect("drag", "linear_drag", "all"),
        effect("longer", "length_error", ["coupler"]),
        effect("heavier", "mass_error", ["coupler"]),
    ]
    return build(fourbar([*felt, *([bend("coupler")] if bends else [])]))


@cache
def moved(stiffness=None, damping=0.0, step_s=STEP_S, drag=0.0):
    """800 steps from rest."""
    values = {DRAG: drag} if stiffness is None else {DRAG: drag, K: stiffness, B: damping}
    motion = follow(linkage(bends=stiffness is not None).with_parameters(values), step_s, STEPS)
    assert not motion.path.lost.any()
    return motion


def strip():
    """A weightless bar that bends in its plane."""
    section = bend("bar", axis=list(Z))
    return drawing("strip", [bar("bar", (0, 0, 0), (LENGTH, 0, 0), MASS)], [], [section], gravity=WEIGHTLESS)


def frequency(model, link, velocities, step_s=2.5e-4, steps=1000):
    """Of the bend, from its zero crossings [rad/s], and the motion.  velocities: (v_x, v_y, ω_z) of both halves."""
    velocity = np.zeros((model.topology.slots, 6))
    for half, (along, across, turn) in zip((link, f"{link}:far"), velocities, strict=True):
        velocity[model.topology.slot(half), [0, 1, 5]] = along, across, turn
    motion = follow(model, step_s, steps, velocity)
    times = crossings(motion.path.time_s, motion.path.q[:, model.topology.joint_ids.index(f"{link}:section")])
    return 2 * np.pi * (len(times) - 1) / (times[-1] - times[0]), motion


def mean_spring(omega, step_s=2.5e-4):
    """What a step leaves of a frequency: the spring takes the mean (q⁻ + 2q + q⁺)/4, tan(ωh/2) = Ωh/2."""
    return 2 / step_s * np.arctan(0.5 * omega * step_s)


@pytest.mark.parametrize("link", ["coupler", "stone"])
def test_a_link_cut_in_two_keeps_its_mass_its_centre_and_its_inertia(link):
    mechanism = fourbar([bend(link)]) if link == "coupler" else free_body([bend(link, axis=[0.3, 0.0, 1.0])])
    whole, cut = mechanism.body(link).inertial, split(mechanism)
    halves = [cut.body(id).inertial for id in (link, f"{link}:far")]
    mass = sum(h.mass_kg for h in halves)
    center = sum(h.mass_kg * np.array(h.center_of_mass_m) for h in halves) / mass
    inertia = np.zeros((3, 3))
    for half in halves:
        arm = np.array(half.center_of_mass_m) - center
        inertia += half.inertia_kg_m2.matrix() + half.mass_kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    assert mass == pytest.approx(whole.mass_kg, rel=1e-15)
    np.testing.assert_allclose(center, whole.center_of_mass_m, atol=1e-16)
    np.testing.assert_allclose(inertia, whole.inertia_kg_m2.matrix(), atol=1e-18)
    parse_mechanism(document(cut.model_copy(update={"effects": ()})))  # a drawing like any other


def test_half_of_a_slender_bar_is_a_slender_bar_of_half_its_length():
    half = split(strip()).body("bar:far").inertial
    assert half.center_of_mass_m == pytest.approx((0.75 * LENGTH, 0, 0), abs=1e-15)
    wanted = bar_inertia(MASS / 2, LENGTH / 2, WIDTH)
    np.testing.assert_allclose(np.diag(half.inertia_kg_m2.matrix()), wanted, rtol=1e-12)


def test_a_stiff_link_moves_as_a_rigid_one():
    rigid = moved().path.q
    apart = [np.abs(moved(k).path.q[:, :4] - rigid).max() for k in (3e2, 3e3, 1e9)]
    assert np.ptp(rigid) > 1.0
    assert apart[0] < 1e-3  # 2000 weights times lengths per rad
    assert 5 < apart[0] / apart[1] < 15  # in proportion to the compliance
    assert apart[2] < 1e-6  # 1e-10 lengths a step


def test_halves_of_a_longer_and_heavier_link_make_up_that_link():
    def masses(bends, ids):
        model = linkage(bends=bends).with_parameters(ERRORS)
        plant = eqx.filter_jit(system)(model)
        slots = [model.topology.slot(id) for id in ids]
        return [np.asarray(x)[slots] for x in (plant.mass, plant.center_of_mass, plant.inertia)]

    (mass,), (center,), (inertia,) = masses(False, ["coupler"])
    halves, centers, inertias = masses(True, ["coupler", "coupler:far"])
    arms = centers - center
    steiner = np.einsum("bi,bi->b", arms, arms)[:, None, None] * np.eye(3) - arms[:, :, None] * arms[:, None, :]
    assert halves.sum() == pytest.approx(mass, rel=1e-15)
    np.testing.assert_allclose(halves @ centers / mass, center, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose((inertias + halves[:, None, None] * steiner).sum(0), inertia, rtol=1e-12, atol=1e-18)


def test_a_stiff_link_feels_the_drag_of_a_rigid_one_and_a_couple_as_it_turns():
    rigid, stiff = moved(drag=0.2).path.q, moved(1e9, drag=0.2).path.q[:, :4]
    # Each half drags at its own centre, b/2 (L/4)² ω each, which the single force of a rigid link leaves out.
    assert np.abs(rigid - stiff).max() < 0.1 * np.abs(rigid - moved().path.q).max()


def test_a_free_bar_bends_at_the_frequency_of_its_halves():
    # Both turn about their own centres, which stay: ½ J θ'² / 2 and ½ k θ², with J of one half.
    expected = np.sqrt(2 * STIFFNESS / HALF_INERTIA)
    reach = 0.25 * LENGTH / 2
    omega, motion = frequency(build(strip()), "bar", [(0, reach - 0.25 * LENGTH * 0.5, -0.5), (0, 0, 0.5)])
    assert omega == pytest.approx(mean_spring(expected), rel=2e-5)  # crossings between samples
    assert np.ptp(motion.energy) < (expected * 2.5e-4) ** 2 * motion.kinetic.max()
    assert np.abs(motion.momentum - motion.momentum[0]).max() < 1e-7  # 1e-10 lengths, over h, times the mass


def test_a_hanging_bar_bends_at_the_second_frequency_of_two_linked_halves():
    # Centres at a and 3a below the pin; φ turns both halves, θ bends: the linear double pendulum.
    a, m = LENGTH / 4, MASS / 2
    inertia = m * a**2 * np.array([[10.0, 3.0], [3.0, 1.0]]) + HALF_INERTIA * np.array([[2.0, 1.0], [1.0, 1.0]])
    weight = m * 9.81 * a * np.array([[4.0, 1.0], [1.0, 1.0]])
    squares, shapes = eigh(weight + np.diag([0.0, STIFFNESS]), inertia)
    turn, fold = 0.1 * shapes[:, 1] / np.abs(shapes[:, 1]).max()
    model = build(pendulum(0.0, LENGTH, MASS, [bend("link")]))
    velocities = [(a * turn, 0, turn), (3 * a * turn + a * fold, 0, turn + fold)]
    omega, _ = frequency(model, "link", velocities)
    # The weight acts at q_k, not as a mean; it makes a hundredth of ω².
    assert omega == pytest.approx(mean_spring(np.sqrt(squares[1])), rel=1e-4)


def test_halving_the_step_quarters_the_error_of_a_bending_linkage():
    ends = [moved(1.0, 1e-3, h).path.q[round(0.2 / h)] for h in (1e-3, 5e-4, 2.5e-4)]
    ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
    assert 3.5 < ratio < 4.5


def test_energy_is_kept_by_a_springy_link_and_lost_by_a_damped_one():
    kept, lost = moved(2.0), moved(2.0, 1e-2)
    assert np.ptp(kept.energy) < 1e-3 * kept.kinetic.max()  # the rigid four-bar: 1e-4
    assert np.max(lost.energy - np.minimum.accumulate(lost.energy)) <= np.ptp(kept.energy)
    assert lost.energy[0] - lost.energy[-1] > 2 * np.ptp(kept.energy)


def test_a_start_leaves_a_link_straight():
    model = linkage(bends=True)
    plant = eqx.filter_jit(system)(model)
    motions = free_motions(plant, drawn_pose(model, plant))
    assert motions.shape[-1] == 1  # bending is not among the ways it is set up
    near, far = (motions[model.topology.slot(id), 3:] for id in ("coupler", "coupler:far"))
    np.testing.assert_allclose(near, far, atol=1e-9)


def test_the_motion_has_slopes_in_stiffness_and_damping():
    model = linkage(bends=True)
    at = {K: 2.0, B: 1e-3}

    @jax.jit
    def slopes(values):
        def end(values):
            made = model.with_parameters(dict(zip(at, values, strict=True)))
            return move(made, still(made), jnp.asarray(STEP_S), STEPS).path.q[-1]

        return jax.jacfwd(end)(values)

    exact = np.asarray(slopes(jnp.array(list(at.values()))))
    for column, address in enumerate(at):
        by = 1e-2 * at[address]
        up, down = (
            follow(model.with_parameters({**at, address: at[address] + s * by}), STEP_S, STEPS).path.q[-1]
            for s in (1, -1)
        )
        difference = (up - down) / (2 * by)
        # A hundredth of the value: third derivatives count 1e-4, phases of some ten bends a few times more.
        assert np.linalg.norm(exact[:, column] - difference) < 3e-3 * np.linalg.norm(difference)


def test_a_fourbar_with_a_springy_coupler_moves_as_exudyn_says():
    pytest.importorskip("exudyn", reason="the peer engine Exudyn is not installed")
    from backend.blind.exudyn_engine import simulate_exudyn

    hinge = "coupler:section"
    springs = (
        effect("spring", "torsion_spring", [hinge], stiffness_n_m_per_rad=1.0),
        effect("damper", "viscous_friction", [hinge], damping_n_m_s_per_rad=1e-3),
    )
    told = split(fourbar([bend("coupler")])).model_copy(update={"effects": springs})
    ours = moved(1.0, 1e-3, 2.5e-4).path
    peer = simulate_exudyn(told, 0.2, 5e-4, output_step_s=1e-2, extrapolated=True)
    assert np.ptp(ours.q[:, 4]) > 0.02
    for row, joint in enumerate(linkage(bends=True).topology.joint_ids):
        np.testing.assert_allclose(ours.q[::40, row], peer.joint_positions[joint], atol=1e-4)  # ours: h²


def test_effects_follow_the_half_that_carries_them():
    spring = effect("s", "extension_spring", ["coupler", "ground"], anchor_a_m=[0.2, 0, 0], anchor_b_m=[0.2, 0.4, 0])
    push = effect("p", "applied_force", ["coupler"], direction=[0, 1, 0], point_m=[0.01, 0, 0])
    drag = effect("d", "linear_drag", "all")
    rub = effect("r", "viscous_friction", "all", damping_n_m_s_per_rad=0.1)
    cut = split(fourbar([bend("coupler"), spring, push, drag, rub]))
    assert cut.effect("s").on == ("coupler:far", "ground")
    assert cut.effect("p").on == ("coupler",)
    assert cut.effect("d").on == ("crank", "coupler", "coupler:far", "rocker")
    assert cut.effect("r").on == ("j1", "j2", "j3", "j4")  # not the hinge inside the link
    assert cut.joint("j3").body_a == "coupler:far"
    assert cut.marker("knee").body == "coupler:far"


@pytest.mark.parametrize(
    ("mechanism", "sentence"),
    [
        (lambda: fourbar([bend("ground")]), "'ground' is fixed and cannot bend"),
        (lambda: free_body([bend("stone")]), "no joint of 'stone' turns about an axis to bend about; give `axis`"),
        (
            lambda: fourbar([bend("coupler"), effect("i", "inertia_error", ["coupler"], relative=0.1)]),
            "inertia_error cannot act on 'coupler', which bends",
        ),
        (
            lambda: fourbar([bend("coupler"), effect("more", "link_flexibility", "all")]),
            "'coupler' bends already; one section per link",
        ),
    ],
)
def test_what_cannot_bend_is_told_in_a_sentence(mechanism, sentence):
    with pytest.raises(ValueError, match=sentence):
        build(mechanism())
