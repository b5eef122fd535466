"""What the peers read from a drawing, where they start, and what they refuse."""

import ast
from pathlib import Path

import numpy as np
import pytest

from backend.blind import closure, drawn
from backend.mechanism.read import parse_mechanism

PEERS = (
    "drawing",
    "drawn",
    "contacts",
    "poses",
    "closure",
    "peer",
    "exudyn_model",
    "exudyn_contact",
    "exudyn_engine",
    "mujoco_model",
    "mujoco_loads",
    "mujoco_engine",
)


def read(document):
    return drawn.read_drawing(document, engine="test", kinds=frozenset({"extension_spring"}))


def test_the_peers_import_nothing_of_our_own_dynamics():
    folder = Path(drawn.__file__).parent
    for peer in PEERS:
        tree = ast.parse((folder / f"{peer}.py").read_text())
        names = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        ours = [name for name in names if name.startswith("backend.")]
        assert all(name.startswith(("backend.blind", "backend.mechanism")) for name in ours)
        assert not any(name.split(".")[0] in ("jax", "equinox", "scipy") for name in names)


def test_a_mechanism_and_its_document_are_the_same_to_a_peer(linkages, simulate):
    document = linkages.pendulum(0.5)
    from_file, parsed = (simulate(m, 0.1, 1e-3) for m in (document, parse_mechanism(document)))
    np.testing.assert_array_equal(from_file.joint_positions["j"], parsed.joint_positions["j"])


def test_a_run_starts_where_and_as_fast_as_it_is_told(linkages, simulate):
    motion = simulate(
        linkages.fourbar(),
        0.01,
        1e-3,
        initial_joint_positions={"j1": 0.3},
        initial_joint_velocities={"j1": 2.0},
    )
    assert motion.joint_positions["j1"][0] == pytest.approx(0.3, abs=1e-9)
    assert motion.joint_velocities["j1"][0] == pytest.approx(2.0, abs=1e-9)
    assert motion.constraint_error_m[0] < 1e-12
    q = motion.joint_positions
    # Around a planar loop the turns add up to nothing.
    assert sum(q[f"j{k}"][0] for k in range(1, 5)) == pytest.approx(0.0, abs=1e-9)
    rate = np.diff(q["j3"])[0] / np.diff(motion.time_s)[0]
    assert motion.joint_velocities["j3"][0] == pytest.approx(rate, rel=0.05)


def test_markers_ride_on_their_bodies(linkages, simulate):
    motion = simulate(linkages.pendulum(0.7), 0.2, 1e-3)
    tip, angle = motion.marker_position_m["tip"], 0.7 + motion.joint_positions["j"]
    expected = 0.2 * np.stack([np.sin(angle), -np.cos(angle), 0 * angle], 1)
    np.testing.assert_allclose(tip, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "repeated"), [("double_pendulum", 0), ("fourbar", 3), ("slider_crank", 3), ("bennett", 3)]
)
def test_rows_that_repeat_others_are_counted(linkages, name, repeated):
    drawing = read(getattr(linkages, name)())
    poses = closure.assemble(drawing)
    kept = sum(map(len, closure.independent_rows(drawing, poses)))
    assert closure.constraint_jacobian(drawing, poses).shape[0] - kept == repeated


@pytest.mark.parametrize("cells", [2, 4])
def test_each_closed_cell_of_a_scissor_repeats_three_rows(linkages, cells):
    drawing = read(linkages.scissor(cells))
    poses = closure.assemble(drawing)
    keep = closure.independent_rows(drawing, poses)
    assert closure.constraint_jacobian(drawing, poses).shape[0] - sum(map(len, keep)) == 3 * (cells - 1)
    assert closure.row_margin(drawing, poses, keep) == pytest.approx(1.0, abs=1e-9)


def test_bennetts_kept_rows_are_not_trusted_all_the_way(linkages):
    drawing = read(linkages.bennett())
    poses = closure.assemble(drawing)
    assert closure.row_margin(drawing, poses, closure.independent_rows(drawing, poses)) < 0.9


def test_rows_are_not_mistaken_for_repeated_at_a_dead_centre(linkages):
    drawing = read(linkages.slider_crank(angle=0.0))
    kept = closure.independent_rows(drawing, closure.assemble(drawing))
    assert sum(map(len, kept)) == 17  # 18 coordinates, one freedom


def test_a_drawing_rounded_to_seven_digits_is_closed_before_it_moves(linkages):
    document = linkages.fourbar()
    for part in document["bodies"]:
        part["pose"] = {key: np.round(value, 7).tolist() for key, value in part["pose"].items()}
    drawing = read(document)
    assert closure._miss(drawing, closure.drawn_poses(drawing)) > 1e-9
    assert closure._miss(drawing, closure.assemble(drawing)) < 1e-12


def test_an_effect_that_a_peer_cannot_imitate_is_named(linkages, simulate):
    bend = linkages.effect("bend", "link_flexibility", ["link"], stiffness_n_m_per_rad=1.0)
    with pytest.raises(ValueError, match=r'"bend".*has no link_flexibility'):
        simulate(linkages.pendulum(effects=[bend]), 0.1, 1e-3)


def test_a_stop_that_gives_is_refused_rather_than_taken_for_a_rigid_one(linkages, simulate):
    stop = linkages.effect("stop", "joint_stop", ["j"], upper=0.3, restitution=0.5)
    with pytest.raises(ValueError, match=r'"stop": stops are rigid here.*remove restitution'):
        simulate(linkages.pendulum(effects=[stop]), 0.1, 1e-3)


def test_a_joint_that_a_peer_cannot_imitate_is_named(linkages, simulate):
    document = linkages.pendulum()
    document["joints"][0]["type"] = "screw"
    with pytest.raises(ValueError, match='"j" is screw'):
        simulate(document, 0.1, 1e-3)


def test_an_unknown_joint_is_answered_with_the_known_ones(linkages, simulate):
    with pytest.raises(ValueError, match="hinge; known: j"):
        simulate(linkages.pendulum(), 0.1, 1e-3, initial_joint_velocities={"hinge": 1.0})


def test_rates_that_contradict_a_loop_are_refused(linkages, simulate):
    with pytest.raises(ValueError, match="contradict the loops"):
        simulate(linkages.fourbar(), 0.1, 1e-3, initial_joint_velocities={"j1": 1.0, "j2": 1.0})


def test_a_crank_that_cannot_reach_is_refused_with_the_gap(linkages, simulate):
    with pytest.raises(ValueError, match="stay open by"):
        simulate(linkages.slider_crank(0.15, 0.05, 0.1), 0.1, 1e-3, initial_joint_positions={"j1": 1.0})


def test_an_input_for_which_there_is_no_effect_is_refused(linkages, simulate):
    inputs = {"time_s": [0.0], "effect": ["motor"], "parameter": ["torque_n_m"], "value": [1.0]}
    with pytest.raises(ValueError, match=r"motor\.torque_n_m"):
        simulate(linkages.pendulum(), 0.1, 1e-3, inputs=inputs)
