"""What acts in a reality beside weight and inertia: each law's effort from angle, rate and its own memory.

LuGre: Canudas de Wit, Olsson, Åström, Lischinsky (1995); Bouc-Wen: Wen (1976); Stribeck as a bristle's limit.
"""

from __future__ import annotations

import numpy as np

from backend.blind.withheld.contact import STOP_LOSS_S_PER_RAD, hunt_crossley
from backend.blind.withheld.laws import Laws
from backend.blind.withheld.linkage import Linkage

BRISTLE_RAD = 4e-4  # how far a stuck pin turns before it slides
BRISTLE_M = 3e-5  # and a stuck slide
CREEP_RAD_PER_S = 0.1  # where a smooth sign of the rate stands for the bristles
CREEP_M_PER_S = 1e-2
BRISTLE_DAMPING_S = 4e-3  # σ1 over σ0: presliding swings die within a few
SLOSH_LOSS = 0.05  # of critical
KICK_S = 0.012  # half width of a kick


def joint_effort(laws: Laws, time_s: float, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Effort along each pin's coordinate (rows, joints) that needs no memory [N m or N]."""
    effort = laws.offset - laws.viscous * rate - laws.stiffness * angle
    if laws.has("lower", "upper"):
        over, under = angle - laws.upper, laws.lower - angle
        effort = effort - hunt_crossley(over, rate, laws.stop_stiffness, STOP_LOSS_S_PER_RAD)
        effort = effort + hunt_crossley(under, -rate, laws.stop_stiffness, STOP_LOSS_S_PER_RAD)
    if laws.has("one_way"):
        effort = effort - laws.one_way * np.maximum(rate, 0.0)
    if laws.has("cog"):
        effort = effort + laws.cog * np.sin(laws.cog_count * angle + laws.cog_phase)
    if laws.has("wire"):
        effort = effort - laws.wire * np.maximum(angle - laws.wire_from, 0.0)
    if laws.has("kick"):
        effort = effort + laws.kick * np.exp(-0.5 * ((time_s - laws.kick_at) / KICK_S) ** 2)
    return effort


def friction(
    laws: Laws,
    angle: np.ndarray,
    rate: np.ndarray,
    load: np.ndarray,
    bristle: np.ndarray | None,
    turning: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Dry friction (rows, joints) [N m or N] under pin loads [N], and how fast its bristles bend.

    bristle: bent by a share of what they bear, -1 to 1; None takes a smooth sign of the rate.
    """
    limit = laws.coulomb + laws.rub * load
    if laws.has("bump"):
        limit = limit + laws.bump * np.exp(-0.5 * ((angle - laws.bump_at) / np.maximum(laws.bump_width, 1e-9)) ** 2)
    creep = np.where(turning, CREEP_RAD_PER_S, CREEP_M_PER_S)
    level = 1.0
    if laws.has("stribeck_excess"):
        level = 1 + laws.stribeck_excess * np.exp(-((rate / np.maximum(laws.stribeck_rate, 1e-9)) ** 2))
    if bristle is None:
        return -limit * level * np.tanh(rate / creep), np.zeros_like(rate)
    bend = np.where(turning, BRISTLE_RAD, BRISTLE_M)
    dry = (laws.coulomb + laws.rub + laws.bump) > 0
    bending = dry * (rate - np.abs(rate) * bristle / level) / bend
    # The bristles' own damping fades as they slide (Olsson 1996), or it would add a viscous friction.
    fading = np.exp(-((rate / creep) ** 2))
    return -limit * (bristle + BRISTLE_DAMPING_S * fading * bending), bending


def strut(linkage: Linkage, laws: Laws, gap: np.ndarray, leaving: np.ndarray) -> np.ndarray:
    """What the drawn springs pull on their first ends, complex (rows, springs) [N]; gap: from b to a [m], leaving: how
    fast it changes [m/s].
    """
    length = np.abs(gap)
    along = gap / np.maximum(length, 1e-9)
    k = np.array([s.stiffness for s in linkage.springs]) * (1 + laws.stiffer)
    free = np.array([s.free_length for s in linkage.springs])
    return -along * (k * (length - free) + laws.preload + laws.damping * np.real(np.conj(along) * leaving))


def hysteresis(laws: Laws, rate: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bouc-Wen's torque of a springy part that yields (rows, joints) [N m], and its memory's rate."""
    width = np.where(laws.yield_width > 0, laws.yield_width, 1.0)
    return -laws.yielding * z, (rate - 0.5 * np.abs(rate) * z - 0.5 * rate * np.abs(z)) / width


def slosh(laws: Laws, mass: np.ndarray, p: np.ndarray, v: np.ndarray, fall: np.ndarray, state: np.ndarray):
    """A load that hangs from each link's centre by a soft spring: its pull (rows, links), and its memory's rate."""
    x, u = (part[:, ::2] + 1j * part[:, 1::2] for part in np.split(state, 2, 1))
    load = mass * laws.slosh
    w = laws.slosh_rate
    pull = load * (w**2 * (x - p) + 2 * SLOSH_LOSS * w * (u - v))
    acceleration = np.where(load > 0, fall - pull / np.where(load > 0, load, 1.0), 0.0)
    out = np.empty_like(state)
    half = state.shape[1] // 2
    speed = np.where(load > 0, u, 0.0)
    out[:, 0:half:2], out[:, 1:half:2] = np.real(speed), np.imag(speed)
    out[:, half::2], out[:, half + 1 :: 2] = np.real(acceleration), np.imag(acceleration)
    return pull, out


def gust(laws: Laws, time_s: float) -> np.ndarray:
    """A breath of wind: force per metre of link (rows,), complex [N/m]."""
    return laws.gust * np.exp(-0.5 * ((time_s - laws.gust_at) / np.maximum(laws.gust_width, 1e-9)) ** 2)


def base_place(laws: Laws, time_s: float | np.ndarray) -> np.ndarray:
    """Where a shaking base is, complex [m]."""
    return laws.sway * np.sin(2 * np.pi * laws.sway_hz * time_s + laws.sway_phase)


def base_acceleration(laws: Laws, time_s: float) -> np.ndarray:
    """The acceleration of a shaking base, complex (rows,) [m/s²]."""
    return -((2 * np.pi * laws.sway_hz) ** 2) * base_place(laws, time_s)
