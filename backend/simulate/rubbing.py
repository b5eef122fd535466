"""Dry friction of the joints: what share of its limit it bears over the time w around q_k that a step stands for.

Bristles bend by p before they slide (Canudas de Wit et al. 1995, without their damping): along a way η they bear
du/dη = (1 - u sign η) / p, a sign where p = 0.  Three things keep that of second order in the step: it is a mean over
w, of which half lies before q_k; where a joint turns back or stops within w, the share β of w until then is foretold
from its rate and from what the step before took off that, and is known; and the way in w is that of the mean rate
where friction is soft (w times the rate is less than the bristles bend), yet that of the rate to come where it is not,
so that what stands still is held.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

CREEPING = 20.0  # times the rate below which friction holds: a joint as slow may be held, and turns nowhere
SOFTEST = 0.97  # share of the mean rate in the way of soft friction: with all of it what is held would ring for ever
SHORTEST = 1e-12  # share of w that may be over before a stop: nothing is divided by 0


class Rubbing(NamedTuple):
    """Of each joint, known at q_k.  Ways and displacements are in rad or m."""

    limit: Float[Array, "joints"]
    """Of dry friction at q_k, without what the load adds [N m or N]."""
    before: Float[Array, "joints"]
    """β."""
    first: Float[Array, "joints"]
    """Mean share that is borne until the stop."""
    borne: Float[Array, "joints"]
    """Share that is borne from then on, to begin with."""
    bends: Float[Array, "joints"]
    """p."""
    lead: Float[Array, "joints"]
    """Way after the stop for each unit of the step's displacement,"""
    rest: Float[Array, "joints"]
    """and without any."""
    stick: Float[Array, "joints"]
    """Way below which a sign is rounded off."""


def foretell(
    limit: Float[Array, "joints"],
    bends: Float[Array, "joints"],
    hold: Float[Array, "joints"],
    onset: Float[Array, "joints"],
    borne: Float[Array, "joints"],
    rate: Float[Array, "joints"],
    quickening: Float[Array, "joints"],
    step_s: float | Array,
    weight_s: Array,
) -> Rubbing:
    """What is known of a step's friction before it is solved.

    hold, onset: rates below which friction holds, and sets in.  borne: share of the limit at the middle of the step
    before.  rate, quickening: there, and how it changed per second to get there.
    """
    slowing = rate * quickening < 0.0
    until = jnp.where(slowing, -rate / jnp.where(slowing, quickening * weight_s, 1.0), 0.0)
    before = jnp.where(until < 1.0, until, 0.0) * rate**2 / (rate**2 + (CREEPING * hold) ** 2)
    sharp = _over(jnp.abs(rate) * step_s, bends) * _over(jnp.abs(quickening) * weight_s, onset)
    mean = SOFTEST * (1.0 - sharp)
    span, left = jnp.maximum(before, SHORTEST) * weight_s, (1.0 - before) * weight_s
    way, slow = span * (1.0 - 0.5 * mean) * rate, hold + onset
    stops = before > 0.0
    return Rubbing(
        limit,
        before,
        _mean(borne, way, bends, span * slow),
        _after(borne, way, bends, span * slow),
        bends,
        left * (1.0 - 0.5 * mean) / step_s,
        jnp.where(stops, 0.0, left * 0.5 * mean * rate),
        left * slow,
    )


def share(at: Rubbing, moved: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Of its limit, that friction bears on average over w where the step moves the joints."""
    return at.before * at.first + (1.0 - at.before) * _mean(at.borne, _way(at, moved), at.bends, at.stick)


def stiffness(
    at: Rubbing, limit: Float[Array, "joints"], dry: Float[Array, "joints"], moved: Float[Array, "joints"]
) -> Float[Array, "joints"]:
    """By how much friction's impulse changes with the displacement, where it carries `dry` of an impulse `limit`.

    The primal-dual slope of Chan, Golub and Mulet (1999): equal to the true one at the root, yet it keeps Newton's
    method steady while a joint changes between sticking and sliding.
    """
    way, left = _way(at, moved), (1.0 - at.before) * limit
    now = jnp.clip(dry + at.before * limit * at.first, -left, left)
    rounded = _rounded(way, at.stick)
    return at.lead * (left + now * way / rounded) / (2.0 * at.bends + rounded)


def steepest(at: Rubbing, limit: Float[Array, "joints"], moved: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """What that is at most."""
    return at.lead * (1.0 - at.before) * limit / (2.0 * at.bends + _rounded(_way(at, moved), at.stick))


def borne_after(at: Rubbing, moved: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """Share of the limit that friction bears at the middle of the step, -1 to 1."""
    return _after(at.borne, _way(at, moved), at.bends, at.stick)


def softened(at: Rubbing, factor: float | Array) -> Rubbing:
    """The same friction, where it holds only below a higher rate."""
    return at._replace(stick=at.stick * factor)


def _over(large: Array, small: Array) -> Float[Array, "joints"]:
    """1 where friction is sharp, its steps larger than what it gives; 0 where they are much smaller."""
    return jnp.where(small > 0.0, large / (large + jnp.where(small > 0.0, small, 1.0)), 1.0)


def _way(at: Rubbing, moved: Float[Array, "joints"]) -> Float[Array, "joints"]:
    return at.lead * moved + at.rest


def _rounded(way: Float[Array, "joints"], stick: Float[Array, "joints"]) -> Float[Array, "joints"]:
    """|η|, rounded off where friction holds."""
    return jnp.sqrt(way**2 + stick**2)


def _mean(borne: Array, way: Array, bends: Array, stick: Array) -> Float[Array, "joints"]:
    """Mean share along a way, from a share borne at its beginning."""
    return (2.0 * bends * borne + way) / (2.0 * bends + _rounded(way, stick))


def _after(borne: Array, way: Array, bends: Array, stick: Array) -> Float[Array, "joints"]:
    """Share at the end of a way: exp(-x) of the rest is left, as 1 / (1 + x + x²/2)."""
    rounded = _rounded(way, stick)
    sign, long = way / rounded, rounded * (bends + 0.5 * rounded)
    return sign + (borne - sign) * bends**2 / (bends**2 + long)
