"""Covariances that are made no smaller than one another."""

import numpy as np

from backend.fit.misfit import largest


def test_units_of_the_values_do_not_matter():
    rng = np.random.default_rng(5)
    A, B = (m @ m.T for m in rng.standard_normal((2, 3, 3)))
    units = np.array([1e-6, 1.0, 3e5])  # a play in metres beside the stiffness of its wall
    scaled = largest(A * np.outer(units, units), B * np.outer(units, units))
    np.testing.assert_allclose(scaled, largest(A, B) * np.outer(units, units), rtol=1e-8)


def test_it_is_at_least_as_wide_as_both_and_no_wider_than_their_sum():
    rng = np.random.default_rng(6)
    for _ in range(20):
        A, B = (m @ m.T for m in rng.standard_normal((2, 4, 4)))
        C = largest(A, B)
        assert np.linalg.eigvalsh(C - A).min() > -1e-9 * np.trace(C)
        assert np.linalg.eigvalsh(C - B).min() > -1e-9 * np.trace(C)
        assert np.linalg.eigvalsh(A + B - C).min() > -1e-9 * np.trace(C)
