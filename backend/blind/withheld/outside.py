"""What no library holds: a diagnosis should say that it does not know it, and where it lies."""

from __future__ import annotations

import numpy as np

from backend.blind.withheld.causes import kind
from backend.blind.withheld.laws import Change
from backend.blind.withheld.linkage import GRAVITY


@kind("friction_bump", "hinge", 0.02, 0.3, known=False)
def _bump(rig, i, size, rng):
    """A rough spot: dry friction near one angle alone."""
    low, high = rig.reach[i]
    width = float(0.12 * (high - low) * rng.uniform(0.5, 1.0))
    at = float(rng.uniform(low + 0.25 * (high - low), high - 0.25 * (high - low)))
    return {}, [
        Change("bump", i, size * rig.torque),
        Change("bump_at", i, at, sized=False),
        Change("bump_width", i, width, sized=False),
    ]


@kind("cogging", "hinge", 0.01, 0.2, known=False)
def _cog(rig, i, size, rng):
    """A magnetic detent: torque periodic in the angle, several times over the motion."""
    low, high = rig.reach[i]
    count = float(2 * np.pi * rng.uniform(2.5, 5.0) / max(high - low, 0.2))
    return {}, [
        Change("cog", i, size * rig.torque),
        Change("cog_count", i, count, sized=False),
        Change("cog_phase", i, float(rng.uniform(0, 2 * np.pi)), sized=False),
    ]


@kind("hysteresis", "hinge", 0.01, 0.15, known=False)
def _hysteresis(rig, i, size, rng):
    """A rubber bush or a cable: springy for part of the swing, then it yields."""
    low, high = rig.reach[i]
    width = float((high - low) * rng.uniform(0.15, 0.35))
    return {}, [Change("yielding", i, size * rig.torque), Change("yield_width", i, width, sized=False)]


@kind("kick", "hinge", 0.05, 0.8, signed=True, known=False)
def _kick(rig, i, size, rng):
    """A knock against the rig in the middle of the swing."""
    return {}, [
        Change("kick", i, size * rig.torque),
        Change("kick_at", i, float(rng.uniform(0.25, 0.7)), sized=False),
    ]


@kind("gust", "world", 0.02, 0.3, signed=True, known=False)
def _gust(rig, i, size, rng):
    """A breath of wind along all links."""
    lengths = sum(link.ends[1] - link.ends[0] for link in rig.linkage.links)
    force = size * rig.mass * GRAVITY / lengths * np.exp(1j * rng.uniform(-0.5, 0.5))
    return {}, [
        Change("gust", None, force),
        Change("gust_at", None, float(rng.uniform(0.2, 0.7)), sized=False),
        Change("gust_width", None, float(rng.uniform(0.05, 0.15)), sized=False),
    ]


@kind("slosh", "link", 0.03, 0.3, known=False)
def _slosh(rig, i, size, rng):
    """A load that swings by itself on a soft tie."""
    share = size * rig.mass / rig.linkage.links[i].mass
    rate = float(rig.rate * rng.uniform(1.3, 2.5))
    return {}, [Change("slosh", i, share), Change("slosh_rate", i, rate, sized=False)]


@kind("wobble", "marker", 0.002, 0.03, known=False)
def _wobble(rig, i, size, rng):
    """A sticker that flutters once the link moves."""
    return {}, [
        Change("wobble", i, size * rig.linkage.size),
        Change("wobble_hz", i, float(rng.uniform(2.0, 6.0)), sized=False),
        Change("wobble_phase", i, float(rng.uniform(0, 2 * np.pi)), sized=False),
    ]


@kind("wire", "hinge", 0.05, 0.8, known=False)
def _wire(rig, i, size, rng):
    """A wire that hangs slack, and pulls like a spring beyond some angle."""
    low, high = rig.reach[i]
    start = float(low + (high - low) * rng.uniform(0.4, 0.7))
    return {}, [Change("wire", i, size * rig.torque), Change("wire_from", i, start, sized=False)]


@kind("one_way_damper", "hinge", 0.01, 0.1, known=False)
def _one_way(rig, i, size, rng):
    """A check valve: viscous friction in one direction only. (Dry friction in one direction is dry friction in both
    with an offset, which a library has.)
    """
    return {}, [Change("one_way", i, size * rig.torque / rig.rate)]
