"""Bars of shares with their 95% intervals: what a parameter does alone, and with all that it does with others."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from backend.mechanism.ensemble_report import Share, VariedParameter
from backend.report.quantity import shown
from backend.report.svg import element

BAR, GAP, WIDTH, PER_LETTER = 11, 9, 760, 6.6


def share_bars(parameters: Sequence[VariedParameter]) -> Markup:
    """Two bars a parameter, in the order given; those without shares are left out."""
    known = [p for p in parameters if p.total and p.first_order]
    if not known:
        return Markup("")
    left = min(12 + max(len(p.name) for p in known) * PER_LETTER, 0.5 * WIDTH)
    limits = [edge for p in known for s in (p.first_order, p.total) if s for edge in s.ci95]
    low, high = min(0.0, *limits), max(1.0, *limits)
    one = 2 * BAR + GAP
    bottom = one * len(known) + 6

    def at(share: float) -> float:
        return left + (share - low) / (high - low) * (WIDTH - left - 60)

    parts = []
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(element("path", class_="grid", d=f"M{at(tick):.1f} 0V{bottom}"))
        parts.append(element("text", f"{tick:g}", x=at(tick), y=bottom + 15, text_anchor="middle"))
    for k, p in enumerate(known):
        top = one * k + 4
        parts.append(element("text", p.name, x=left - 8, y=top + BAR + 4, text_anchor="end"))
        for share, tone, y in ((p.total, "c0", top), (p.first_order, "c1", top + BAR)):
            if share:
                parts.append(_bar(share, tone, at, y))
    drawing = element(
        "svg",
        *parts,
        viewBox=f"0 0 {WIDTH} {bottom + 20}",
        role="img",
        aria_label="share of each parameter in whether it jams",
    )
    legend = element(
        "span",
        element("span", "total: with all it does together with others", class_="key c0 line"),
        element("span", "first order: alone", class_="key c1 line"),
        class_="legend",
    )
    note = "Share in the variance of jammed or free; thin lines: 95%. At 0, a closer tolerance would change nothing."
    caption = element("figcaption", element("b", "What decides whether it jams"), legend)
    return element("figure", caption, drawing, element("p", note, class_="note"), class_="wide")


def _bar(share: Share, tone: str, at, y: float) -> Markup:
    middle, (low, high) = y + BAR / 2, share.ci95
    start, end = sorted((at(0.0), at(share.value)))
    meaning = element("title", f"{shown(share.value)} ({shown(low)} to {shown(high)})")
    bar = element("rect", meaning, class_=f"share {tone}", x=start, y=y + 1, width=end - start, height=BAR - 2)
    whisker = element("path", class_="axis", d=f"M{at(low):.1f} {middle:.1f}H{at(high):.1f}")
    return bar + whisker
