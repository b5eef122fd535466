"""Tables of who acts on whom: sums, and their transposes without loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.model.incidence import added, gathered, picked

RNG = np.random.default_rng(3)
ROWS = jnp.asarray(RNG.standard_normal((5, 2, 3)))
WHICH = np.array([4, 0, 0, 5, 2, 0, 0, 0, 0])  # 5 is none; six ask for row 0
TABLE = np.array([[1, 3], [5, 0], [5, 5]])


def with_none(rows):
    return np.concatenate([rows, np.zeros_like(rows[:1])])


def test_rows_are_picked_and_summed_as_their_table_says():
    np.testing.assert_array_equal(picked(ROWS, WHICH), with_none(ROWS)[WHICH])
    np.testing.assert_allclose(gathered(ROWS, TABLE), with_none(ROWS)[TABLE].sum(1), rtol=1e-15)
    assert picked(ROWS, np.zeros(0, dtype=int)).shape == (0, 2, 3)
    assert gathered(jnp.zeros((0, 6)), np.zeros((4, 1), dtype=int)).shape == (4, 6)


def test_rows_are_added_to_the_places_they_name():
    to = np.array([1, 1, 3, 1, 7])  # the last goes nowhere
    expected = np.zeros((7, 2, 3))
    np.add.at(expected, to[:4], np.asarray(ROWS)[:4])
    np.testing.assert_allclose(added(ROWS, to, 7), expected, rtol=1e-15)


MAPS = {
    "picked": lambda rows: picked(rows, WHICH),
    "gathered": lambda rows: gathered(rows, TABLE),
    "added": lambda rows: added(rows, np.array([1, 1, 1, 1, 1]), 3),
}


@pytest.mark.parametrize("name", MAPS)
def test_slopes_transposes_and_batches_are_those_of_the_matrix_that_the_table_is(name):
    function = MAPS[name]
    matrix = np.moveaxis(np.array([function(unit) for unit in np.eye(5)[:, :, None]])[:, :, 0], 0, 1)
    expected = np.einsum("mn,nij->mij", matrix, ROWS)
    np.testing.assert_allclose(jax.jvp(function, (ROWS,), (ROWS,))[1], expected, atol=1e-15)
    back = RNG.standard_normal(expected.shape)
    pulled = jax.vjp(function, ROWS)[1](back)[0]
    np.testing.assert_allclose(pulled, np.einsum("mn,mij->nij", matrix, back), atol=1e-15)
    each = jax.vmap(function, 1, 1)(ROWS)
    np.testing.assert_allclose(each, expected, atol=1e-15)


@pytest.mark.parametrize("name", MAPS)
def test_a_transpose_compiles_without_a_loop_over_rows(name):
    pull = jax.jit(lambda back: jax.vjp(MAPS[name], ROWS)[1](back)[0])
    text = pull.lower(jax.eval_shape(MAPS[name], ROWS)).compile().as_text() or "while("
    assert "while(" not in text
    assert "scatter(" not in text
