"""Bars of a gap: how far it shrinks, beside the noise."""

from __future__ import annotations

from markupsafe import Markup

from backend.mechanism.gap_report import Remainder
from backend.report.quantity import at_the_bench, shown
from backend.report.svg import element

WIDTH, LEFT, RIGHT, BAR, GAP, TOP = 520, 118, 78, 22, 12, 18


def shrink_bars(rest: Remainder, si: str, corrected: bool, title: str, note: str = "") -> Markup:
    """Rms error as drawn and, where one was found, with the best cause; across them, what a right model would leave."""
    unit, factor = at_the_bench(si) if si != "rad" else ("mrad", 1e3)
    rows = [("drawing as it is", rest.before_rms_m, "before"), ("with best cause", rest.after_rms_m, "after")]
    rows = rows if corrected else rows[:1]
    longest = max(rest.before_rms_m, rest.after_rms_m, rest.noise_rms_m, 1e-300)
    bottom = TOP + len(rows) * (BAR + GAP)

    def at(value: float) -> float:
        return LEFT + value / longest * (WIDTH - LEFT - RIGHT)

    parts = []
    for k, (name, value, tone) in enumerate(rows):
        y = TOP + k * (BAR + GAP)
        parts.append(element("text", name, x=LEFT - 8, y=y + BAR / 2 + 4, text_anchor="end"))
        parts.append(element("rect", class_=f"share {tone}", x=LEFT, y=y, width=at(value) - LEFT, height=BAR))
        beyond = max(at(value), at(rest.noise_rms_m))
        parts.append(
            element("text", f"{shown(factor * value)} {unit}", x=beyond + 6, y=y + BAR / 2 + 4, class_="value")
        )
    x = at(rest.noise_rms_m)
    parts.append(element("path", class_="floor", d=f"M{x:.1f} {TOP - 4}V{bottom - GAP + 4}"))
    words = f"noise {shown(factor * rest.noise_rms_m)} {unit}"
    parts.append(
        element(
            "text",
            words,
            x=x + (4 if x < WIDTH / 2 else -4),
            y=TOP - 7,
            text_anchor="start" if x < WIDTH / 2 else "end",
        )
    )
    parts.append(element("path", class_="axis", d=f"M{LEFT} {TOP - 4}V{bottom - GAP + 4}"))
    svg = element("svg", *parts, viewBox=f"0 0 {WIDTH} {bottom}", role="img", aria_label=title, class_="bars")
    caption = element("figcaption", element("b", title))
    return element("figure", caption, svg, element("p", note, class_="note") if note else "")
