"""A loop whose slopes go round with it, beside JAX's own while loop, and beside loops written out in Python."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from backend.simulate.loop import loop
from backend.simulate.slopes import varied

MOST = 40


def wanted(given, state):
    """Until what is left is small."""
    return (state[0] < given[1]) & (jnp.abs(state[1]) > 1e-3)


def onward(given, state):
    """A decaying number, and one that counts without slopes."""
    k, x, seen = state
    return k + 1, x * jnp.cos(given[0]) - 0.1 * x**2, seen + lax.stop_gradient(x)


def ours(rate, x):
    """State: (rounds, x, sum of x without its slopes)."""
    given = (rate, jnp.asarray(MOST))
    return loop(wanted, onward, given, (jnp.asarray(0), varied(x, given), jnp.zeros(())))


def theirs(rate, x):
    """The same by JAX's while loop."""
    given, begin = (rate, jnp.asarray(MOST)), (jnp.asarray(0), x, jnp.zeros(()))
    return lax.while_loop(lambda s: wanted(given, s), lambda s: onward(given, s), begin)


@pytest.mark.parametrize("compiled", [False, True], ids=["eager", "compiled"])
def test_it_ends_where_jax_does(compiled):
    """Alone, and several side by side that end at different rounds."""
    run = jax.jit(ours) if compiled else ours
    for mine, other in zip(run(0.7, 1.0), theirs(0.7, 1.0), strict=True):
        np.testing.assert_array_equal(mine, other)
    rates = jnp.array([0.3, 0.7, 1.2])
    several = jax.vmap(run, (0, None))(rates, 1.0)
    alone = [theirs(rate, 1.0) for rate in rates]
    assert len({int(one[0]) for one in alone}) == 3
    for mine, other in zip(several, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(mine, jnp.stack(other), rtol=1e-14)


@pytest.mark.parametrize("compiled", [False, True], ids=["eager", "compiled"])
def test_its_slopes_are_those_of_jax(compiled):
    """One direction, two together, where only what is given varies, and where several loops go side by side."""

    def end(run):
        return lambda both: run(both[0], both[1])[1]

    mine, other, at = end(jax.jit(ours) if compiled else ours), end(theirs), jnp.array([0.7, 1.0])
    along = jnp.array([1.0, 2.0])
    np.testing.assert_allclose(jax.jvp(mine, (at,), (along,)), jax.jvp(other, (at,), (along,)), rtol=1e-13)
    np.testing.assert_allclose(jax.jacfwd(mine)(at), jax.jacfwd(other)(at), rtol=1e-13)
    only = [jax.jacfwd(lambda rate, f=f: f(jnp.stack([rate, 1.0])))(0.7) for f in (mine, other)]
    np.testing.assert_allclose(*only, rtol=1e-13)
    starts = jnp.stack([at, 0.5 * at, 1.5 * at])
    every = [jax.vmap(jax.jacfwd(f))(starts) for f in (mine, other)]
    np.testing.assert_allclose(*every, rtol=1e-13)
    curved = [jax.jacfwd(jax.jacfwd(f))(at) for f in (mine, other)]
    np.testing.assert_allclose(*curved, rtol=1e-12)


def test_what_begins_without_a_slope_and_gets_one_is_refused():
    """A slope that the state does not carry would be lost without a word."""

    def end(rate):
        given = (rate, jnp.asarray(MOST))
        return loop(wanted, onward, given, (jnp.asarray(0), jnp.asarray(1.0), jnp.zeros(())))[1]

    with pytest.raises(TypeError, match="varied"):
        jax.jvp(end, (0.7,), (1.0,))
