"""Slopes along what moves, and of what is known already."""

import functools

import jax
import jax.numpy as jnp
import pytest

from backend.simulate.slopes import along, known


def test_a_known_value_is_kept_and_its_slopes_are_those_of_what_it_comes_from():
    def motion(x):
        return known(jnp.sin, jnp.sin(jax.lax.stop_gradient(x)), x)

    assert float(motion(0.3)) == pytest.approx(jnp.sin(0.3))
    assert float(jax.grad(motion)(0.3)) == pytest.approx(jnp.cos(0.3))
    assert float(jax.jvp(motion, (0.3,), (2.0,))[1]) == pytest.approx(2.0 * jnp.cos(0.3))
    steps = jax.make_jaxpr(motion)(0.3)
    assert str(steps).count("= sin") == 1  # computed before, not again


def test_slopes_are_taken_along_what_moves_alone():
    product = jax.custom_jvp(lambda x, y: x * y)
    product.defjvp(functools.partial(along, lambda x, y: x * y), symbolic_zeros=True)
    assert float(jax.grad(product)(2.0, 3.0)) == 3.0
    assert float(jax.grad(product, 1)(2.0, 3.0)) == 2.0
    both = jax.make_jaxpr(lambda x: jax.jvp(lambda x: product(x, 3.0), (x,), (1.0,)))(2.0)
    assert str(both).count("= mul") == 2  # the product, and one of the two terms of its slope
