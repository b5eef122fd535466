"""Which rows are redundant, which reactions that leaves open, and that the motion does not care."""

import json
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.report.run_summary import summary_json, summary_text
from backend.simulate.reduced import STRETCH, Kept, march_reduced, released
from backend.simulate.redundancy import let_go_at, redundancy
from backend.simulate.rollout import depart, march, trajectory
from backend.simulate.run import simulate
from backend.simulate.spectrum import matrix, rank_along, singular_values
from tests.mechanisms import (
    LEANING,
    Z,
    bar,
    bennett,
    document,
    double_pendulum,
    drawing,
    effect,
    fourbar,
    scissor,
    slider_crank,
    spatial_fourbar,
)

STEP_S = 1e-3


def parallelogram(angle):
    """A parallelogram whose crank stands at an angle to the ground."""
    crank, ground = 0.13 * np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.25, 0.0, 0.0])
    corners = [np.zeros(3), crank, crank + ground, ground]
    names = ["crank", "coupler", "rocker"]
    ends = ["ground", *names, "ground"]
    bars = [bar(name, corners[i], corners[i + 1]) for i, name in enumerate(names)]
    return drawing(
        "parallelogram", bars, [(f"j{i + 1}", "revolute", *ends[i : i + 2], corners[i], Z) for i in range(4)]
    )


def renamed_bennett():
    """Bennett's loop by the four-bar's names, so that one program moves both."""
    text = json.dumps(document(bennett()))
    for old, new in (
        ("link0", "crank"),
        ("link1", "coupler"),
        ("link2", "rocker"),
        *((f"j{k}", f"j{k + 1}") for k in (3, 2, 1, 0)),
    ):
        text = text.replace(f'"{old}"', f'"{new}"')
    return parse_mechanism(json.loads(text))


def leaning(mechanism, torque=0.0):
    """The drawing under weight out of its plane, its first joint driven by a steady torque."""
    drawn = document(mechanism)
    push = effect("push", "effort_offset", [drawn["joints"][0]["id"]], torque_n_m=torque)
    changed = {**drawn, "gravity_m_per_s2": list(LEANING), "effects": [push.model_dump(mode="json")]}
    return type(mechanism).model_validate(changed)


def placed(mechanism):
    model = build(mechanism)
    plant = eqx.filter_jit(system)(model, 1e-12)
    return plant, drawn_pose(model, plant)


def found(mechanism, threshold=None):
    return redundancy(*placed(mechanism), threshold)


_march = eqx.filter_jit(march)


def both_solves(mechanism, steps):
    """(plant, motion with compliance, motion with rows let go, how that went)."""
    plant, pose = placed(mechanism)
    start = Start(pose, jnp.zeros((plant.topology.slots, 6)))
    motion = eqx.filter_jit(depart)(plant, start)

    def stretch(system, carry, first):
        return _march(system, carry, jnp.asarray(STEP_S), STRETCH, None)

    def joined(parts):
        seen = jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[: steps + 1], *parts)
        return trajectory(seen, STEP_S)

    carry, given = (motion, jnp.zeros((), dtype=bool)), []
    for first in range(0, steps + 1, STRETCH):
        carry, seen = stretch(plant, carry, first)
        given.append(seen)
    let_go, kept = march_reduced(plant, (motion, jnp.zeros((), dtype=bool)), steps + 1, stretch)
    return plant, joined(given), joined(let_go), kept


@pytest.fixture(scope="module")
def turning_bennett():
    return both_solves(leaning(renamed_bennett(), torque=0.3), 450)


@pytest.fixture(scope="module")
def turning_parallelogram():
    return both_solves(leaning(parallelogram(1.2), torque=0.2), 450)


def test_a_planar_loop_repeats_what_holds_it_in_its_plane():
    fact = found(fourbar())
    assert (fact.rank, fact.mobility, len(fact.redundant)) == (17, 1, 3)
    assert {row for _, row in fact.redundant} <= {"z", "tilt_x", "tilt_y"}
    assert fact.not_unique == {f"j{k}": ("z", "tilt_x", "tilt_y") for k in (1, 2, 3, 4)}
    assert fact.shared == (("j1", "j2", "j3", "j4"),) * 3
    assert "3 redundant rows" in fact.sentence()
    assert "z, tilt_x, tilt_y at j1, j2, j3, j4 are not unique" in fact.sentence()


def test_an_open_chain_and_a_spatial_loop_without_spare_rows_have_unique_reactions():
    for mechanism in (double_pendulum(), spatial_fourbar(("spherical", "universal"))):
        fact = found(mechanism)
        assert (fact.redundant, fact.not_unique, fact.sentence()) == ((), {}, "")
        assert fact.unique.all()


def test_a_coupler_between_two_balls_is_named_as_idle():
    fact = found(spatial_fourbar())
    assert fact.mobility == 2
    (idle,) = [motion for motion in fact.motions if motion.idle]
    assert idle.bodies == ("coupler",)
    (moving,) = [motion for motion in fact.motions if not motion.idle]
    assert set(moving.bodies) == {"crank", "coupler", "rocker"}


def test_null_motions_open_no_row():
    plant, pose = placed(spatial_fourbar())
    J, length = matrix(plant, pose), float(plant.scale.length_m)
    for motion in redundancy(plant, pose).motions:
        rates = (motion.rates / np.array([length] * 3 + [1.0] * 3))[[b is not None for b in plant.topology.body_ids]]
        np.testing.assert_allclose(J @ rates.ravel(), 0.0, atol=1e-12)


def test_a_scissor_repeats_three_rows_for_every_cell_after_the_first():
    assert len(found(scissor(4)).redundant) == 9


@pytest.mark.parametrize("drawn", [fourbar, bennett, slider_crank, partial(scissor, 4)])
def test_the_kept_rows_say_all_that_the_rows_say(drawn):
    plant, pose = placed(drawn())
    fact = redundancy(plant, pose)
    kept = [i for i, row in enumerate(fact.rows) if row not in fact.redundant]
    values = singular_values(matrix(plant, pose)[kept])
    assert len(kept) == fact.rank
    assert values[-1] == pytest.approx(fact.kept_margin * fact.singular_values[fact.rank - 1])
    assert fact.kept_margin > 0.1
    assert fact.gap > 1e8


def test_a_threshold_of_the_readers_own_decides_what_counts_as_zero():
    nearly = found(parallelogram(1e-3))  # a milliradian from its change point
    smallest = nearly.singular_values[nearly.rank - 1] / nearly.singular_values[0]
    assert nearly.mobility == 1
    assert found(parallelogram(1e-3), 2 * smallest).mobility == 2
    for wrong in (0.0, 1.5):
        with pytest.raises(ValueError, match="between 0 and 1"):
            found(fourbar(), wrong)


def test_a_row_let_go_carries_nothing():
    plant, pose = placed(leaning(fourbar()))
    let_go = let_go_at(plant, pose)
    removed = let_go.rows
    start = Start(pose, jnp.zeros((plant.topology.slots, 6)))
    motion = eqx.filter_jit(depart)(plant, start)
    carry = (motion, jnp.zeros((), dtype=bool))
    _, seen = _march(released(plant, let_go), carry, jnp.asarray(STEP_S), STRETCH, None)
    assert removed.sum() == 3
    assert np.abs(np.asarray(seen.reaction)[:, removed]).max() < 1e-10  # N and N m, of 1 in the others
    assert np.abs(np.asarray(seen.reaction)[:, ~removed]).max() > 0.1


def test_both_solves_turn_bennetts_loop_alike(turning_bennett):
    plant, given, let_go, kept = turning_bennett
    q = np.asarray(given.q)
    assert np.ptp(q[:, 0]) > 2 * np.pi
    assert kept.carried == 0
    # Rows give way by ε λ, which depends on who carries: 1e-10 m here, and turns into phase over the turn.
    apart = np.abs(np.asarray(given.pose.position - let_go.pose.position)).max() / float(plant.scale.length_m)
    assert apart < 1e-8


def test_both_solves_pass_a_parallelogram_through_its_change_point_alike(turning_parallelogram):
    plant, given, let_go, _ = turning_parallelogram
    assert np.ptp(np.asarray(given.q)[:, 0]) > 2 * np.pi
    assert not np.asarray(let_go.lost).any()
    apart = np.abs(np.asarray(given.pose.position - let_go.pose.position)).max() / float(plant.scale.length_m)
    assert apart < 1e-8


def test_both_solves_hold_up_a_long_scissor_alike():
    # A cantilever whose kept rows carry ten times what they carry together with those let go.
    plant, given, let_go, kept = both_solves(leaning(scissor(8)), 75)
    assert kept.carried == 0
    apart = np.abs(np.asarray(given.pose.position - let_go.pose.position)).max() / float(plant.scale.length_m)
    assert apart < 1e-9


def test_reactions_differ_by_self_stress_alone(turning_bennett):
    plant, given, let_go, _ = turning_bennett
    difference = np.asarray(given.reaction - let_go.reaction)[100]
    assert np.abs(difference[:, :3]).max() > 0.1  # N
    J = matrix(plant, jax.tree.map(lambda leaf: leaf[100], given.pose))
    unit = np.array([float(plant.scale.length_m)] * 3 + [1.0] * 3)
    stress = (difference * unit)[plant.held_rows]
    # Reactions are exact to 1e-12 lengths over h², times the mass: 1e-8 N m.
    np.testing.assert_allclose(J.T @ stress, 0.0, atol=1e-6 * np.abs(stress).max())


def test_unique_reactions_are_the_same_in_both_solves(turning_parallelogram):
    plant, given, let_go, _ = turning_parallelogram
    unique = redundancy(plant, placed(leaning(fourbar()))[1]).unique  # of the same loop away from its change point
    a, b = np.asarray(given.reaction)[:50], np.asarray(let_go.reaction)[:50]
    np.testing.assert_allclose(a[:, unique], b[:, unique], atol=1e-6 * np.abs(a).max())
    assert np.abs((a - b)[:, ~unique]).max() > 1e-3 * np.abs(a).max()


def test_a_parallelogram_drawn_flat_has_one_freedom_more():
    assert found(parallelogram(0.7)).mobility == 1
    assert found(parallelogram(0.0)).mobility == 2


def test_the_spectrum_along_a_motion_shows_the_change_point(turning_parallelogram):
    plant, given, _, _ = turning_parallelogram
    along = rank_along(plant, given, every=3)
    crank = np.asarray(given.q)[::3, 0] + 1.2
    flat = np.abs(np.sin(crank))
    assert along.singular_values.shape == (151, 18)
    np.testing.assert_allclose(along.time_s, np.asarray(given.time_s)[::3])
    assert along.margin[flat < 0.05].max() < 0.2 * along.margin[flat > 0.9].min()
    near = rank_along(plant, given, every=1, threshold=1e-3)
    assert set(near.mobility) == {1, 2}
    assert (np.abs(np.sin(np.asarray(given.q)[:, 0] + 1.2))[near.mobility == 2] < 0.05).all()
    with pytest.raises(ValueError, match="every is 0"):
        rank_along(plant, given, every=0)


def test_a_summary_says_what_is_redundant_and_how_it_was_solved():
    run = simulate(fourbar(), 0.025, solve="reduced")
    said = summary_text(summary_json(run))
    assert "3 redundant rows" in said
    assert "reduced: 3 rows let go, chosen 1 time" in said
    report = summary_json(run)
    assert report["solve"] == "reduced"
    assert (report["redundancy"]["rank"], report["redundancy"]["mobility"]) == (17, 1)
    assert set(report["redundancy"]["reactions_not_unique"]) == {"j1", "j2", "j3", "j4"}


def test_an_unknown_solve_is_refused():
    with pytest.raises(ValueError, match="solve is 'svd'; choose one of compliance, reduced"):
        simulate(fourbar(), 0.1, solve="svd")  # pyright: ignore[reportArgumentType]


def test_steps_that_compliance_carried_are_told():
    mask = np.ones((1, 6), dtype=bool)
    assert Kept(((0, mask), (25, mask)), 25).sentence(100) == (
        "reduced: 6 rows let go, chosen 2 times; compliance carried 25 of 100 steps"
    )
