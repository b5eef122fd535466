"""Programs traced once and read back: by another function object, as another process would, with the same answers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate.assemble import let_go
from backend.simulate.rollout import rollout
from backend.simulate.shelf import SUFFIX, Shelved
from tests.mechanisms import effect, fourbar


class Thing(eqx.Module):
    weight: jax.Array
    name: str = eqx.field(static=True)
    rows: tuple[int, ...] = eqx.field(static=True)


@pytest.fixture
def folder(tmp_path):
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def counted():
    """A function and the number of times it was traced."""
    traced = []

    def turned(thing: Thing, power: int, x):
        traced.append(thing.name)
        return jnp.sin(thing.weight * x) ** power + sum(thing.rows), {"cos": jnp.cos(x)}["cos"]

    return turned, traced


THING = Thing(jnp.arange(3.0), "crank", (1, 2))
X = np.linspace(0.0, 1.0, 3)


def test_what_is_read_back_answers_as_what_was_traced(folder):
    first, traced = counted()
    expected = first(THING, 2, X)
    traced.clear()
    for _ in range(2):
        for one, other in zip(Shelved(first, ["power"])(THING, 2, X), expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-15)
    assert len(traced) == 1  # the second reads what the first wrote
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 1


@pytest.mark.parametrize(
    "other",
    [
        (Thing(THING.weight, "rocker", (1, 2)), 2, X),
        (Thing(THING.weight, "crank", (1, 3)), 2, X),
        (Thing(jnp.arange(3), "crank", (1, 2)), 2, X),
        (THING, 3, X),
        (THING, 2, X[:1]),
    ],
    ids=["name", "static numbers", "type of number", "static argument", "shape"],
)
def test_another_layout_is_another_program(folder, other):
    function, traced = counted()
    Shelved(function, ["power"])(THING, 2, X)
    np.testing.assert_allclose(Shelved(function, ["power"])(*other)[0], function(*other)[0], rtol=1e-15)
    assert len(traced) == 3  # of which one is the plain call


def test_other_numbers_are_the_same_program(folder):
    function, traced = counted()
    shelved = Shelved(function, ["power"])
    shelved(THING, 2, X)
    found = shelved(Thing(THING.weight + 1.0, "crank", (1, 2)), 2, X)[0]
    assert len(traced) == 1
    np.testing.assert_allclose(found, np.sin((np.arange(3.0) + 1.0) * X) ** 2 + 3, rtol=1e-15)


def test_a_layout_that_holds_a_function_is_not_kept(folder):
    function, _ = counted()
    strange = Thing(THING.weight, lambda: None, (1, 2))  # type: ignore[arg-type]
    Shelved(function, ["power"])(strange, 2, X)
    assert not list(folder.glob(f"*{SUFFIX}"))


def test_a_file_cut_short_is_traced_again(folder):
    function, traced = counted()
    Shelved(function, ["power"])(THING, 2, X)
    (path,) = folder.glob(f"*{SUFFIX}")
    path.write_bytes(path.read_bytes()[:100])
    Shelved(function, ["power"])(THING, 2, X)
    assert len(traced) == 2


def test_inside_another_transformation_it_is_an_ordinary_function(folder):
    function, _ = counted()
    shelved = Shelved(function, ["power"])
    slope = jax.vmap(jax.grad(lambda x: shelved(Thing(jnp.ones(()), "crank", ()), 2, x)[0]))(X)
    np.testing.assert_allclose(slope, np.sin(2 * X), atol=1e-15)


def test_a_motion_and_its_slope_are_kept_with_the_compiled_kernel_in_them(folder):
    model = build(fourbar([effect("v", "viscous_friction", "all", damping_n_m_s_per_rad=1e-4)]))

    def slope(damping):
        def end(damping):
            plant = system(model.with_parameters({("v", "damping_n_m_s_per_rad"): damping}))
            return rollout(plant, let_go(plant, drawn_pose(model, plant)), 1e-3, 5).q[-1]

        return jax.jvp(end, (damping,), (jnp.ones(()),))

    kept = Shelved(slope)(jnp.array(1e-4))
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 1
    for one, other in zip(kept, jax.jit(slope)(jnp.array(1e-4)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
