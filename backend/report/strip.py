"""Small graphics for tables: an interval against the truth, and a matrix of correlations."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from backend.report.quantity import shown
from backend.report.svg import element


def interval_strip(value: float, ci95: tuple[float | None, float | None] | None, truth: float | None = None) -> Markup:
    """The 95% interval as a bar, the estimate as a dot, the truth as an upright line.

    Where no truth is known the strip starts at zero instead: a bar far from it is a value that is there.
    """
    low, high = ci95 or (None, None)
    zero = 0.0 if truth is None else None
    given = [x for x in (value, low, high, truth, zero) if x is not None]
    span = (max(given) - min(given)) or abs(value) * 0.1 or 1.0
    start, end = min(given) - 0.15 * span, max(given) + 0.15 * span

    def at(x: float) -> float:
        return 140.0 * (x - start) / (end - start)

    parts = [element("path", class_="axis", d="M0 10H140")]
    if zero is not None:
        parts.append(element("path", class_="mark", d=f"M{at(zero):.1f} 3V17"))
    if low is not None and high is not None:
        parts.append(element("path", class_="interval", d=f"M{at(low):.1f} 10H{at(high):.1f}"))
    if truth is not None:
        meaning = element("title", f"truth {shown(truth)}")
        parts.append(element("path", meaning, class_="truth", d=f"M{at(truth):.1f} 2V18"))
    parts.append(element("circle", class_="estimate", cx=at(value), cy=10, r=3.5))
    return element("svg", *parts, class_="strip", viewBox="0 0 140 20", aria_hidden="true")


CELL = 46


def correlation_matrix(names: Sequence[str], matrix: Sequence[Sequence[float | None]]) -> Markup:
    """Correlations of fitted parameters: blue move together, red apart, the number in each cell."""
    left = 30 + max((len(name) for name in names), default=0) * 6.6
    width, height = left + CELL * len(names) + 4, CELL * len(names) + 22
    parts = []
    for i, name in enumerate(names):
        middle = CELL * (i + 0.5)
        parts.append(element("text", f"{name}  ({i + 1})", x=left - 8, y=middle + 4, text_anchor="end"))
        parts.append(element("text", str(i + 1), x=left + middle, y=height - 6, text_anchor="middle"))
        parts += [_cell(left + CELL * j, CELL * i, value) for j, value in enumerate(matrix[i])]
    drawing = element(
        "svg",
        *parts,
        class_="matrix",
        viewBox=f"0 0 {width:.0f} {height}",
        style=f"width:{width:.0f}px",
        role="img",
        aria_label="correlation of the fitted parameters",
    )
    return element("div", drawing, class_="scroll")


def _cell(x: float, y: float, value: float | None) -> Markup:
    tone = "none" if value is None else ("apart" if value < 0 else "together")
    strength = 0.0 if value is None else 0.85 * min(1.0, abs(value))
    number = "–" if value is None else f"{value:.2f}".replace("-", "−")
    square = element("rect", class_=tone, x=x, y=y, width=CELL - 2, height=CELL - 2, fill_opacity=f"{strength:.2f}")
    return square + element("text", number, x=x + CELL / 2 - 1, y=y + CELL / 2 + 4, text_anchor="middle")
