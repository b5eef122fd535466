"""Turns: whatever is turned and turned back is where it was."""

import jax
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from backend.frames import quaternion

ROUNDING = 1e-14  # a few products of numbers below one
few = settings(max_examples=30, deadline=None)
numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = arrays(float, 3, elements=numbers)


@st.composite
def attitudes(draw):
    q = draw(arrays(float, 4, elements=numbers).filter(lambda q: np.linalg.norm(q) > 0.1))
    return q / np.linalg.norm(q)


@few
@given(attitudes(), vectors)
def test_a_step_is_the_increment_that_it_leaves_behind(q, phi):
    there = quaternion.advance(q, phi)
    np.testing.assert_allclose(quaternion.increment(q, there), phi, atol=10 * ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(there), 1.0, atol=ROUNDING)


@few
@given(attitudes(), attitudes())
def test_turning_twice_multiplies_rotation_matrices(p, q):
    both = quaternion.rotation(quaternion.multiply(p, q))
    np.testing.assert_allclose(both, quaternion.rotation(p) @ quaternion.rotation(q), atol=ROUNDING)


@few
@given(attitudes())
def test_the_conjugate_turns_back(q):
    np.testing.assert_allclose(quaternion.multiply(quaternion.conjugate(q), q), [1, 0, 0, 0], atol=ROUNDING)
    np.testing.assert_allclose(quaternion.rotation(quaternion.conjugate(q)), quaternion.rotation(q).T, atol=ROUNDING)


@few
@given(attitudes())
def test_a_rotation_matrix_keeps_lengths_and_handedness(q):
    R = np.asarray(quaternion.rotation(q))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=ROUNDING)


@few
@given(attitudes())
def test_minus_q_is_the_same_turn(q):
    np.testing.assert_allclose(quaternion.increment(q, -q), 0.0, atol=ROUNDING)


@few
@given(vectors, vectors)
def test_skew_is_the_cross_product(v, w):
    np.testing.assert_allclose(quaternion.skew(v) @ w, np.cross(v, w), atol=ROUNDING)


@few
@given(attitudes(), vectors)
def test_the_tangent_map_is_the_slope_of_the_increment(q, phi):
    there = quaternion.advance(q, phi)
    slope = jax.jacfwd(lambda turn: quaternion.increment(q, quaternion.advance(there, turn)))(np.zeros(3))
    np.testing.assert_allclose(quaternion.tangent_map(phi), slope, atol=1e2 * ROUNDING)
