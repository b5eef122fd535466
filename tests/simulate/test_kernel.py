"""The compiled kernel beside the same functions in JAX: same numbers, same derivatives, whoever runs them."""

import os
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.frames import quaternion
from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.model.topology import Topology, lay_out
from backend.simulate import kinematics, linear
from backend.simulate.kernel import call
from backend.simulate.kernel.build import NoCompiler, compiler, library
from backend.simulate.kernel.build import build as build_kernel
from backend.simulate.rollout import rollout
from tests.mechanisms import effect, fourbar, scissor, slider_crank


def pinned(moving: str, *pairs: str, struts: tuple[str, ...] = ()) -> Topology:
    """Bodies are letters, 'g' is the ground; a pair is two letters."""
    joints = [(f"j{i}", "revolute", *pair) for i, pair in enumerate(pairs)]
    return lay_out(list(moving), ["g"], joints, [(a, b) for a, b in struts])


TOPOLOGIES = {
    "one body": pinned("a", "ga"),
    "chain": pinned("abcde", "ga", "ab", "bc", "cd", "de"),
    "four-bar": pinned("abc", "ga", "ab", "bc", "cg"),
    "scissor": build(scissor(4)).topology,
    "unequal widths": pinned(
        "abcdefgh".replace("g", "i"), "ga", "ab", "ac", "ad", "ae", "ef", "bf", "fh", struts=("hi",)
    ),
    "two grounded chains": pinned("abcd", "ga", "ab", "gc", "cd"),
    "free-floating": pinned("abc", "ab", "bc", struts=("ac",)),
    "no joints": pinned("ab", struts=("ab",)),
    "three abreast": pinned("abcdef", "ga", "gb", "gc", "ad", "be", "cf", "de", "fe", struts=("dg",)),
    "five abreast": pinned("abcdefhijk", "ga", "gb", "gc", "gd", "ge", "af", "bh", "ci", "dj", "ek", "fj", "ih"),
}


@pytest.fixture(scope="module")
def kernel():
    """Whether the engine used to run with the kernel; built here where that has not happened."""
    try:
        compiler()
    except NoCompiler as missing:
        pytest.skip(f"the compiled kernel cannot be tested: {missing}")
    build_kernel()
    call._loaded.cache_clear()


def run(switch: str, monkeypatch, function, *arguments, target: str = call.FACTOR):
    """The value of a function compiled with the kernel on or off, and proof that it was."""
    monkeypatch.setenv(call.SWITCH, switch)
    jax.clear_caches()
    compiled = jax.jit(lambda *a: function(*a))  # a new function, so that nothing compiled before is met
    assert (target in compiled.lower(*arguments).as_text()) == (switch == "on")
    return compiled(*arguments)


def agree(one, other, within: float) -> None:
    """Entry by entry, relative to the largest."""
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=within * np.abs(b).max(initial=1e-300))


def matrix(topology: Topology, seed: int = 0, batch: tuple[int, ...] = (), coupled: bool = False):
    """Random blocks with a heavy diagonal, rows of a joint that carry nothing or depend on each other, a right side."""
    draw = np.random.default_rng(seed)
    joints, others = len(topology.joints), len(topology.struts)
    bodies = draw.normal(size=(*batch, topology.slots, 6, 6)) + 30.0 * np.eye(6)
    left = draw.normal(size=(*batch, joints, 6, 12))
    right = left + 0.1 * draw.normal(size=left.shape)
    stiffness = draw.uniform(size=(*batch, joints, 6)) * (np.arange(6) < 4)
    if coupled:
        stiffness = draw.normal(size=(*batch, joints, 6, 6)) / 3.0
    couplings = draw.normal(size=(*batch, others, 12, 12))
    rhs = draw.normal(size=(*batch, topology.slots, 6))
    return tuple(jnp.asarray(x) for x in (bodies, left, stiffness, right, couplings)), jnp.asarray(rhs)


def answer(topology: Topology, blocks, rhs):
    return linear.solve(linear.factor(topology, *blocks), rhs)


def dense(topology: Topology, blocks) -> np.ndarray:
    """The whole matrix, written out."""
    bodies, left, stiffness, right, others = map(np.asarray, blocks)
    if stiffness.ndim == 2:
        stiffness = stiffness[:, :, None] * np.eye(6)
    full = np.zeros((topology.slots + 1, 6, topology.slots + 1, 6))
    for slot, own in enumerate(bodies):
        full[slot, :, slot] += own
    links = [*(a.T @ k @ b for a, k, b in zip(left, stiffness, right, strict=True)), *others]
    for pair, link in zip(topology.links, links, strict=True):
        for i, row in enumerate(np.minimum(pair, topology.slots)):
            for k, column in enumerate(np.minimum(pair, topology.slots)):
                full[row, :, column] += link[6 * i : 6 * i + 6, 6 * k : 6 * k + 6]
    n = 6 * topology.slots
    return full[:-1, :, :-1].reshape(n, n)


WELL = 1e-12  # relative: the matrices' condition is below 1e3, and rounding 1e-16


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("name", TOPOLOGIES)
def test_either_way_solves_the_dense_matrix_and_its_transpose(name, coupled, kernel, monkeypatch):
    topology = TOPOLOGIES[name]
    check(topology, *matrix(topology, coupled=coupled), monkeypatch)


@pytest.mark.parametrize("name", ["one body", "scissor", "five abreast"])
def test_pivots_are_sought_where_none_stand_on_the_diagonal(name, kernel, monkeypatch):
    topology = TOPOLOGIES[name]
    (bodies, *links), rhs = matrix(topology)
    bodies = (bodies - 30.0 * jnp.eye(6) + 30.0 * jnp.roll(jnp.eye(6), 2, 0)).at[:, 0, 0].set(0.0)
    check(topology, (bodies, *links), rhs, monkeypatch)


def check(topology: Topology, blocks, rhs, monkeypatch) -> None:
    """The same factors and solutions either way, and those of the dense matrix."""
    full, b = dense(topology, blocks), np.ravel(rhs)
    assert np.linalg.cond(full) < 1e3

    def answers(blocks, b):
        factored = linear.factor(topology, *blocks)
        x, pull = jax.vjp(lambda rhs: linear.solve(factored, rhs), b)
        return factored, x.ravel(), pull(b)[0].ravel()

    on, off = (run(switch, monkeypatch, answers, blocks, rhs) for switch in ("on", "off"))
    agree(on, off, WELL)
    agree(on[1:], (np.linalg.solve(full, b), np.linalg.solve(full.T, b)), WELL)


@pytest.mark.parametrize("switch", ["on", "off"])
def test_vmap_runs_over_systems_right_hand_sides_and_both(switch, kernel, monkeypatch):
    topology = TOPOLOGIES["unequal widths"]
    blocks, rhs = matrix(topology, batch=(3, 4))

    def batched(blocks, rhs):
        own = jax.vmap(jax.vmap(lambda m, b: answer(topology, m, b)))(blocks, rhs)
        first = linear.factor(topology, *(x[0, 0] for x in blocks))
        shared = jax.vmap(jax.vmap(lambda b: linear.solve(first, b)))(rhs)
        rows = jax.vmap(lambda m: linear.factor(topology, *m))(tuple(x[:, 0] for x in blocks))
        mixed = jax.vmap(lambda b: jax.vmap(linear.solve)(rows, b), in_axes=1, out_axes=1)(rhs)
        return own, shared, mixed

    found = [np.asarray(x) for x in run(switch, monkeypatch, batched, blocks, rhs)]
    plain, b = [np.asarray(x) for x in blocks], np.asarray(rhs)
    for i, k in np.ndindex(3, 4):
        full = [dense(topology, [x[at] for x in plain]) for at in ((i, k), (0, 0), (i, 0))]
        agree([x[i, k].ravel() for x in found], [np.linalg.solve(m, b[i, k].ravel()) for m in full], WELL)


@pytest.mark.parametrize("switch", ["on", "off"])
def test_a_singular_or_spoilt_matrix_ends_without_an_answer(switch, kernel, monkeypatch):
    topology = TOPOLOGIES["four-bar"]
    (bodies, *links), rhs = matrix(topology)

    def spoilt(by, rhs):
        return answer(topology, (by * bodies, *(0.0 * link for link in links)), rhs)

    x = run(switch, monkeypatch, jax.vmap(spoilt, (0, None)), jnp.array([0.0, jnp.nan, jnp.inf]), rhs)
    assert not np.isfinite(x).any()


@pytest.mark.parametrize("draw", [fourbar, slider_crank, lambda: scissor(3)])
def test_either_way_gives_the_rows_of_joints_and_their_change(draw, kernel, monkeypatch):
    plant, random = system(build(draw())), np.random.default_rng(3)

    def rows(moved):
        placed = kinematics.Bodies(moved[:, :3], quaternion.rotation(moved[:, 3:]))
        return kinematics.rows(plant, placed)

    count = plant.topology.slots + len(plant.fixed_position)
    moved, by = random.normal(size=(2, 5, count, 7))  # torn apart: no row is zero, and shear shows every entry

    def both(moved, by):
        return jax.vmap(lambda m, b: jax.jvp(rows, (m,), (b,)))(moved, by)

    on, off = (run(s, monkeypatch, both, moved, by, target=call.ROWS) for s in ("on", "off"))
    agree(on, off, WELL)


@pytest.mark.parametrize("draw", [fourbar, slider_crank, lambda: scissor(3)])
def test_either_way_what_joints_measure_changes_the_same_forwards_and_backwards(draw, kernel, monkeypatch):
    plant, random = system(build(draw())), np.random.default_rng(5)
    count, joints = plant.topology.slots + len(plant.fixed_position), len(plant.topology.joints)
    drawn = {"axes_a": (joints, 3, 3), "axes_b": (joints, 3, 3), "point_a": (joints, 3), "point_b": (joints, 3)}
    shapes = [(count, 3), (count, 4), *drawn.values(), (joints, 6)]

    def measures(position, attitude, *others):
        *frames, impulses = others
        made = eqx.tree_at(lambda s: [getattr(s, name) for name in drawn], plant, frames)
        placed = kinematics.Bodies(position, quaternion.rotation(attitude))
        jacobian = jax.lax.stop_gradient(kinematics.rows(made, placed).jacobian)
        return (
            kinematics.rows(made, placed).value,
            kinematics.pulled(made, placed, jacobian, impulses),
            kinematics.coordinates(made, placed),
        )

    def slopes(at, by, worth):
        """Forwards; backwards, sample by sample; and backwards through a batch whose samples share what was drawn."""
        each = jax.vmap(lambda at, by: jax.jvp(measures, at, by))(at, by)
        alone = jax.vmap(lambda at, worth: jax.vjp(measures, *at)[1](worth))(at, worth)
        shared = [x[0] for x in at[2:]]
        together = jax.vjp(jax.vmap(measures, (0, 0, *[None] * 5)), *at[:2], *shared)[1](worth)
        still = jax.vjp(lambda x: measures(x, *(x[0] for x in at[1:])), at[0][0])[1](tuple(x[0] for x in worth))
        return each, alone, together, still

    def drawn_anew(shapes):
        return tuple(jnp.asarray(random.normal(size=(4, *shape))) for shape in shapes)

    worth = drawn_anew([(joints, 6), (joints, 12), (joints,)])
    given = drawn_anew(shapes), drawn_anew(shapes), worth
    on, off = (run(s, monkeypatch, slopes, *given, target=call.SLOPES_BACK) for s in ("on", "off"))
    agree(on, off, WELL)


def position(model, damping):
    """Positions over 0.2 s from rest."""
    plant = system(model.with_parameters({("v", "damping_n_m_s_per_rad"): damping}), 1e-12)
    begin = Start(drawn_pose(model, plant), jnp.zeros((model.topology.slots, 6)))
    return rollout(plant, begin, 1e-3, 200).pose.position


VISCOUS = [effect("v", "viscous_friction", "all", damping_n_m_s_per_rad=1e-4)]


def test_a_fourbar_moves_the_same_either_way(kernel, monkeypatch):
    model = build(fourbar(VISCOUS))
    on, off = (run(s, monkeypatch, lambda d: position(model, d), jnp.array(1e-4)) for s in ("on", "off"))
    assert np.ptp(on, axis=0).max() > 0.01
    np.testing.assert_allclose(on, off, rtol=0, atol=1e-12)  # m; rows are closed to 1e-12 lengths of 0.25 m


@pytest.mark.nightly
def test_a_scissor_and_its_derivatives_move_the_same_either_way(kernel, monkeypatch):
    model, smooth = build(scissor(2, VISCOUS)), 80  # steps before it falls flat, where rounding grows

    def motion(damping):
        moved, push = jax.linearize(lambda d: position(model, d), damping)
        adjoint = jax.linear_transpose(push, damping)(moved.at[smooth:].set(0.0))[0]
        return moved, push(jnp.ones(()))[:smooth], adjoint

    on, off = (run(switch, monkeypatch, motion, jnp.array(1e-4)) for switch in ("on", "off"))
    assert np.ptp(on[0], axis=0).max() > 0.01
    np.testing.assert_allclose(on[0], off[0], rtol=0, atol=1e-12)  # m; rows are closed to 1e-12 lengths of 0.2 m
    agree(on[1:], off[1:], 1e-8)  # rows of 1/ε = 2e10 leave this rounding in either path's derivatives


def test_second_derivatives_are_refused_with_a_remedy(kernel, monkeypatch):
    plant = system(build(fourbar()))
    pose = drawn_pose(build(fourbar()), plant)

    def turn(x):
        placed = kinematics.bodies(plant, eqx.tree_at(lambda p: p.position, pose, pose.position + x))
        return kinematics.rows(plant, placed).value.sum() ** 2

    with pytest.raises(NotImplementedError, match="LINKTWIN_KERNEL=off"):
        run("on", monkeypatch, lambda x: jax.jvp(jax.grad(turn), (x,), (x,)), jnp.ones(3), target=call.SLOPES)
    topology = TOPOLOGIES["chain"]
    blocks, rhs = matrix(topology)
    with pytest.raises(NotImplementedError, match="LINKTWIN_KERNEL=off"):
        run("on", monkeypatch, jax.grad(lambda b: jnp.sum(answer(topology, (b, *blocks[1:]), rhs))), blocks[0])


THREADED = """
import os, jax, jax.numpy as jnp, numpy as np
from backend.simulate import linear
from tests.simulate.test_kernel import TOPOLOGIES, answer, matrix
topology = TOPOLOGIES["three abreast"]
blocks, rhs = matrix(topology, batch=(300,))
together = jax.jit(jax.vmap(lambda m, b: answer(topology, m, b)))(blocks, rhs)
alone = jax.jit(lambda m, b: answer(topology, m, b))
print(max(float(abs(together[i] - alone([x[i] for x in blocks], rhs[i])).max()) for i in range(300)))
"""


def test_a_batch_spread_over_threads_gives_every_sample_its_own_answer(kernel):
    threads = {"XLA_FLAGS": "", call.SWITCH: "on", "PYTHONPATH": str(Path(__file__).parents[2])}
    said = subprocess.run(
        [sys.executable, "-c", THREADED], env={**os.environ, **threads}, capture_output=True, text=True, check=True
    )
    assert float(said.stdout) == 0.0


def test_the_kernel_stands_aside_where_it_was_made_from_something_else(kernel, monkeypatch):
    assert library() is not None
    monkeypatch.setattr(jax, "__version__", "0.0")
    assert library() is None


def test_building_goes_on_without_a_compiler(tmp_path):
    said = subprocess.run(
        [sys.executable, "-m", "backend.simulate.kernel"],
        env={**os.environ, "CXX": str(tmp_path / "absent")},
        capture_output=True,
        text=True,
    )
    assert said.returncode == 0
    assert "without its compiled kernel" in said.stdout
    assert "absent" in said.stdout
