"""Mechanisms at random: sizes, masses, proportions and markers that no method can have been tuned to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from backend.blind.withheld.linkage import GRAVITY, Link, Linkage, Pin, Spring

Rng = np.random.Generator


def _between(rng: Rng, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _bar(rng: Rng, id: str, start: complex, end: complex, density: float, straight: bool = True) -> Link:
    """A flat bar that reaches a little beyond its pins, with something screwed on somewhere, and two markers."""
    along = end - start
    length = abs(along)
    width = float(rng.uniform(0.04, 0.1) * length + 0.004)
    over = 0.5 * width
    bar = density * (length + 2 * over) * rng.uniform(0.7, 1.4)
    extra, at = bar * rng.uniform(0.05, 0.5), complex(rng.uniform(0.1, 0.9) * length, rng.uniform(-0.3, 0.3) * width)
    mass = bar + extra
    centre = (bar * 0.5 * length + extra * at) / mass
    inertia = bar * ((length + 2 * over) ** 2 + width**2) / 12 + bar * abs(0.5 * length - centre) ** 2
    inertia += extra * (abs(at - centre) ** 2 + 0.2 * width**2)
    spots = [rng.uniform(0.25, 0.5), rng.uniform(0.75, 1.0)]
    marks = tuple(complex(s * length, rng.uniform(-0.35, 0.35) * width) for s in spots)
    ends = (-over, length + over)
    return Link(id, start, float(np.angle(along)), mass, centre, inertia, ends, width, marks, straight)


def pendulum(rng: Rng) -> Linkage:
    """One bar on one pin."""
    length, angle = _between(rng, 0.12, 0.6), rng.uniform(-0.4, 0.4)
    tip = length * np.exp(1j * (angle - np.pi / 2))
    link = _bar(rng, "arm", 0j, tip, _between(rng, 0.2, 1.5))
    return Linkage("pendulum", (link,), (_pin(rng, "j1", 0, 1, 0j),), (0,), ((-1.8 - angle, 1.8 - angle),))


def double_pendulum(rng: Rng) -> Linkage:
    """Two bars, one on the other."""
    one, two = _between(rng, 0.1, 0.35), _between(rng, 0.1, 0.35)
    density = _between(rng, 0.2, 1.5)
    elbow = one * np.exp(1j * (rng.uniform(-0.3, 0.3) - np.pi / 2))
    tip = elbow + two * np.exp(1j * (rng.uniform(-0.3, 0.3) - np.pi / 2))
    links = (_bar(rng, "upper", 0j, elbow, density), _bar(rng, "lower", elbow, tip, density))
    pins = (_pin(rng, "j1", 0, 1, 0j), _pin(rng, "j2", 1, 2, elbow))
    return Linkage("double pendulum", links, pins, (0, 1), ((-1.0, 1.0), (-1.2, 1.2)))


def fourbar(rng: Rng) -> Linkage:
    """Crank, coupler and rocker hanging from two pins of the ground."""
    ground = _between(rng, 0.12, 0.35)
    crank, coupler, rocker = (ground * rng.uniform(*r) for r in ((0.45, 0.8), (0.7, 1.1), (0.7, 1.1)))
    far = ground * np.exp(1j * rng.uniform(-0.25, 0.25))
    knee = crank * np.exp(1j * (-np.pi / 2 + rng.uniform(-0.3, 0.3)))
    knee2 = _elbow(knee, far, coupler, rocker, -1)
    density = _between(rng, 0.2, 1.5)
    links = (
        _bar(rng, "crank", 0j, knee, density),
        _bar(rng, "coupler", knee, knee2, density),
        _bar(rng, "rocker", far, knee2, density),
    )
    pins = (
        _pin(rng, "j1", 0, 1, 0j),
        _pin(rng, "j2", 1, 2, knee),
        _pin(rng, "j3", 2, 3, knee2),
        _pin(rng, "j4", 0, 3, far),
    )
    return Linkage("four-bar", links, pins, (0,), ((-1.3, 1.3),))


def slider_crank(rng: Rng) -> Linkage:
    """A crank, a rod and a block on a slanting rail."""
    crank = _between(rng, 0.05, 0.15)
    rod = crank * rng.uniform(2.2, 3.5)
    rail = np.exp(1j * rng.uniform(-0.35, 0.35))
    pin = crank * rail * np.exp(1j * (-np.pi / 2 + rng.uniform(-0.3, 0.3)))
    inside = pin / rail
    wrist = rail * (inside.real + np.sqrt(rod**2 - inside.imag**2))
    density = _between(rng, 0.3, 1.5)
    links = (
        _bar(rng, "crank", 0j, pin, 2 * density),
        _bar(rng, "rod", pin, wrist, density),
        _block(rng, "block", wrist, rail, density * rod * rng.uniform(0.3, 1.0)),
    )
    pins = (
        _pin(rng, "j1", 0, 1, 0j),
        _pin(rng, "j2", 1, 2, pin),
        _pin(rng, "j3", 2, 3, wrist),
        Pin("j4", 0, 3, wrist, complex(rail)),
    )
    return Linkage("slider-crank", links, pins, (0,), ((-1.3, 1.3),))


def scissor(rng: Rng) -> Linkage:
    """Three crossed pairs in a row, hinged at one foot, the other foot in a vertical slot; a spring holds it open."""
    cells, half, angle = 3, _between(rng, 0.05, 0.12), float(rng.uniform(0.55, 0.85))
    c, s = half * np.cos(angle), half * np.sin(angle)
    density = _between(rng, 0.2, 0.8)
    links, pins = [], []
    for i in range(cells):
        x = 2 * c * i
        links.append(_bar(rng, f"a{i + 1}", complex(x, -s), complex(x + 2 * c, s), density))
        links.append(_bar(rng, f"b{i + 1}", complex(x, s), complex(x + 2 * c, -s), density))
        a, b = 2 * i + 1, 2 * i + 2
        pins.append(_pin(rng, f"cross{i + 1}", a, b, complex(x + c, 0)))
        if i:
            pins.append(_pin(rng, f"top{i}", a - 2, b, complex(x, s)))
            pins.append(_pin(rng, f"bottom{i}", b - 2, a, complex(x, -s)))
    shoe = _block(rng, "shoe", complex(0, s), 1 + 0j, 0.3 * density * half)
    links.append(shoe)
    pins += [
        _pin(rng, "root", 0, 1, complex(0, -s)),
        _pin(rng, "heel", 2, 7, complex(0, s)),
        Pin("slot", 0, 7, 1j * s, 1j),
    ]
    weight = sum(link.mass for link in links) * GRAVITY
    stiff = weight / half * rng.uniform(4.0, 9.0)
    spring = Spring("s1", 1, 2, 0j, 0j, float(stiff), float(2 * s * rng.uniform(0.85, 1.15)))
    order = [p.id for p in pins]
    return Linkage("scissor", tuple(links), tuple(pins), (order.index("root"),), ((-0.35, 0.35),), (spring,))


def fivebar(rng: Rng) -> Linkage:
    """Two cranks and two couplers that meet: two freedoms in one loop."""
    ground = _between(rng, 0.12, 0.3)
    cranks, couplers = (ground * rng.uniform(*r, 2) for r in ((0.5, 0.8), (0.9, 1.2)))
    left = cranks[0] * np.exp(1j * (-np.pi / 2 + rng.uniform(-0.3, 0.2)))
    right = ground + cranks[1] * np.exp(1j * (-np.pi / 2 + rng.uniform(-0.2, 0.3)))
    tip = _elbow(left, right, couplers[0], couplers[1], -1)
    density = _between(rng, 0.2, 1.5)
    links = (
        _bar(rng, "left", 0j, left, density),
        _bar(rng, "left_coupler", left, tip, density),
        _bar(rng, "right_coupler", right, tip, density),
        _bar(rng, "right", complex(ground), right, density),
    )
    pins = (
        _pin(rng, "j1", 0, 1, 0j),
        _pin(rng, "j2", 1, 2, left),
        _pin(rng, "j3", 2, 3, tip),
        _pin(rng, "j4", 4, 3, right),
        _pin(rng, "j5", 0, 4, complex(ground)),
    )
    return Linkage("five-bar", links, pins, (0, 4), ((-0.8, 0.8), (-0.8, 0.8)))


def sixbar(rng: Rng) -> Linkage:
    """Watt's second chain: a four-bar whose rocker, a plate of three pins, drives a second rocker."""
    first = fourbar(rng)
    crank, coupler, rocker = first.links
    far, knee2 = first.pins[3].at, first.pins[2].at
    size = abs(far)
    arm = size * rng.uniform(0.5, 0.7) * np.exp(1j * rng.uniform(-1.9, -1.6)) + far
    third = far + size * rng.uniform(0.8, 1.1)
    link, last = size * rng.uniform(0.8, 1.1), size * rng.uniform(0.6, 0.9)
    knee3 = _elbow(arm, third, link, last, -1)
    density = rocker.mass / abs(knee2 - far)
    plate = _bar(rng, "rocker", far, knee2, density, straight=False)
    links = (
        crank,
        coupler,
        plate,
        _bar(rng, "link", arm, knee3, density),
        _bar(rng, "output", complex(third), knee3, density),
    )
    pins = (
        *first.pins,
        _pin(rng, "j5", 3, 4, complex(arm)),
        _pin(rng, "j6", 4, 5, knee3),
        _pin(rng, "j7", 0, 5, complex(third)),
    )
    return Linkage("six-bar", links, pins, (0,), ((-0.9, 0.9),))


def _pin(rng: Rng, id: str, a: int, b: int, at: complex) -> Pin:
    return Pin(id, a, b, complex(at), None, float(rng.uniform(0.0015, 0.005)))


def _block(rng: Rng, id: str, at: complex, along: complex, mass: float) -> Link:
    side = float(rng.uniform(0.02, 0.05))
    marks = (complex(0.3 * side, 0.2 * side), complex(-0.3 * side, 0.25 * side))
    angle = float(np.angle(along))
    return Link(id, complex(at), angle, mass, 0j, mass * side**2 / 6, (-side / 2, side / 2), side, marks, False)


def _elbow(one: complex, two: complex, first: float, second: float, side: int) -> complex:
    """The point `first` from one and `second` from two, to the given side of the line; nan where they do not meet."""
    d = abs(two - one)
    x = (d**2 + first**2 - second**2) / (2 * d)
    y = np.sqrt(complex(first**2 - x**2)).real
    if first**2 < x**2:
        return complex("nan")
    return one + (two - one) / d * complex(x, side * y)


DEVELOPED: dict[str, Callable[[Rng], Linkage]] = {
    "pendulum": pendulum,
    "double pendulum": double_pendulum,
    "four-bar": fourbar,
    "slider-crank": slider_crank,
    "scissor": scissor,
}
UNSEEN: dict[str, Callable[[Rng], Linkage]] = {"five-bar": fivebar, "six-bar": sixbar}
