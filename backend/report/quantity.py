"""Numbers as an engineer writes them: no more digits than are known, in a unit of the bench."""

from __future__ import annotations

import math

AT_THE_BENCH = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
"""SI unit -> (unit shown, factor). Millimetres appear in reports alone; files keep SI."""


def at_the_bench(unit: str) -> tuple[str, float]:
    """The unit that a report shows for an SI unit, and the factor to it."""
    return AT_THE_BENCH.get(unit, (unit, 1.0))


def shown(value: float | None, digits: int = 3) -> str:
    """A number to so many significant digits; an en dash where there is none.

    >>> shown(0.0123456), shown(-203.51), shown(2.1e-7), shown(None)
    ('0.0123', '−204', '2.1e−7', '–')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0.0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{mantissa}e{int(exponent)}".replace("-", "−")
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{places}f}".replace("-", "−")


def measured(value: float, sd: float | None) -> str:
    """A value with as many digits as its standard deviation leaves meaningful: two of the deviation.

    >>> measured(203.4863, 1.52), measured(0.011031, 0.0004), measured(0.5, None), measured(-1.4e-13, 39.0)
    ('203.5', '0.01103', '0.500', '0')
    """
    if sd is None or not math.isfinite(sd) or sd <= 0.0 or value == 0.0:
        return shown(value)
    size = math.floor(math.log10(sd))
    if round(value, 1 - size) == 0.0:
        return "0"
    known = math.floor(math.log10(abs(value))) - size + 2
    return shown(value, min(max(known, 2), 9))


PREFIXES = {-3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G"}
SCALED = ("N", "m", "s", "rad", "g", "Hz", "Pa", "J", "W")


def prefixed(size: float, unit: str) -> tuple[str, float]:
    """The unit with the SI prefix that puts a number of this size between 1 and 1000, and the factor to it.

    A unit that begins with a power, a fraction or a bare number keeps its form; a bare ratio becomes a percentage.

    >>> prefixed(4e-4, "N m"), prefixed(2.8e-7, "kg m^2"), prefixed(0.02, "m^2"), prefixed(0.03, "1")
    (('µN m', 1000000.0), ('µg m²', 1000000000.0), ('m²', 1.0), ('%', 100.0))
    """
    if unit in ("1", ""):
        return "%", 100.0
    first, space, rest = unit.partition(" ")
    if "/" in first:
        first, rest, space = unit.split("/", 1)[0], unit.split("/", 1)[1], "/"
    gram = first == "kg"
    base, factor = ("g", 1e3) if gram else (first, 1.0)
    if base not in SCALED or size == 0.0 or not math.isfinite(size):
        return _powers(unit), 1.0
    power = math.floor(math.log10(abs(size) * factor) / 3.0 + 1e-9)
    if base in ("m", "s", "rad"):
        power = min(power, 0)  # kilometres are no lengths of a linkage
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return PREFIXES[power] + base + space + _powers(rest), factor * 10.0 ** (-3 * power)


def _powers(unit: str) -> str:
    return unit.replace("^2", "²").replace("^3", "³").replace("^4", "⁴")
