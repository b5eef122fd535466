"""Charts as inline SVG: they print, scale, follow light and dark, and need no library in the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from backend.report.quantity import shown
from backend.report.svg import element, joined, path

WIDTH, HEIGHT = 520, 250
LEFT, RIGHT, TOP, BOTTOM = 66, 10, 12, 40
LETTER = 7.5  # width of one, of the numbers under an axis
COLUMNS = WIDTH - LEFT - RIGHT

Style = Literal["line", "dashed", "points", "cloud"]


@dataclass(frozen=True)
class Series:
    """One curve, or a cloud: points in no order, of which none is left out.

    tone: which colour of the page (`measured`, `before`, `after`, or `c0` to `c7`).
    framed: whether the axes make room for all of it; a drawing without friction may run far off the paper.
    """

    name: str
    x: Float[np.ndarray, "n"]
    y: Float[np.ndarray, "n"]
    tone: str = "c0"
    style: Style = "line"
    framed: bool = True


@dataclass(frozen=True)
class Band:
    """A shaded strip between two curves, such as twice the standard deviation of the noise."""

    name: str
    x: Float[np.ndarray, "n"]
    lower: Float[np.ndarray, "n"]
    upper: Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Stretch:
    """A part of the x axis that is pointed out, from start to end."""

    name: str
    start: float
    end: float


@dataclass(frozen=True)
class Chart:
    """Axes and what stands in them. marks: vertical lines (x, meaning), such as the release.

    y_range: lowest and highest that must be seen, so that charts side by side can share a scale.
    """

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    bands: Sequence[Band] = ()
    marks: Sequence[tuple[float, str]] = ()
    log_y: bool = False
    note: str = ""
    stretches: Sequence[Stretch] = ()
    y_range: tuple[float, float] | None = None

    def svg(self) -> Markup:
        """The chart as one figure element."""
        axes = _Axes.around(self)
        drawing = element(
            "svg",
            axes.drawn(self.x_label, self.y_label),
            _inside(
                *(_stretch(axes, stretch) for stretch in self.stretches),
                *(_mark(axes, x, meaning) for x, meaning in self.marks),
                *(_band(axes, band) for band in self.bands),
                *(_curve(axes, series) for series in self.series),
            ),
            class_="chart",
            viewBox=f"0 0 {WIDTH} {HEIGHT}",
            role="img",
            aria_label=self.title,
            data_box=f"{LEFT},{RIGHT},{TOP},{BOTTOM}",
            data_range=f"{axes.x0:.9g},{axes.x1:.9g},{axes.y0:.9g},{axes.y1:.9g}",
            data_log="1" if axes.log else None,
        )
        caption = element("figcaption", element("b", self.title), _legend(self))
        note = element("p", self.note, class_="note") if self.note else ""
        return element("figure", caption, drawing, note)


@dataclass(frozen=True)
class _Axes:
    """Where numbers land on the paper; y is log10 of the number where `log` is set."""

    x0: float
    x1: float
    y0: float
    y1: float
    log: bool

    @classmethod
    def around(cls, chart: Chart) -> _Axes:
        framed = [s for s in chart.series if s.framed] or chart.series
        xs = [s.x for s in framed] + [b.x for b in chart.bands]
        ys = [s.y for s in framed] + [edge for b in chart.bands for edge in (b.lower, b.upper)]
        ys += [np.array(chart.y_range)] if chart.y_range else []
        x0, x1 = _range(xs)
        if chart.log_y:
            y0, y1 = _range([np.log10(y[y > 0]) for y in ys], margin=0.06)
        else:
            y0, y1 = _range(ys, margin=0.06)
            y0, y1 = _widened(y0, y1, [s.y for s in chart.series if not s.framed])
        return cls(x0, x1, y0, y1, chart.log_y)

    def px(self, x: np.ndarray | float) -> np.ndarray:
        return LEFT + (np.asarray(x, float) - self.x0) / (self.x1 - self.x0) * COLUMNS

    def py(self, y: np.ndarray | float) -> np.ndarray:
        value = np.asarray(y, float)
        if self.log:
            value = np.log10(np.where(value > 0, value, np.nan))
        return HEIGHT - BOTTOM - (value - self.y0) / (self.y1 - self.y0) * (HEIGHT - TOP - BOTTOM)

    def drawn(self, x_label: str, y_label: str) -> Markup:
        bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
        parts = []
        for x, text in zip(*ticks(self.x0, self.x1, 6), strict=True):
            at = float(self.px(x))
            parts.append(element("path", class_="grid", d=f"M{at:.1f} {TOP}V{bottom}"))
            inside = at + LETTER * len(text) / 2 < WIDTH
            place, anchor = (at, "middle") if inside else (WIDTH, "end")
            parts.append(element("text", text, x=place, y=bottom + 15, text_anchor=anchor))
        for y, text in zip(*self._y_ticks(), strict=True):
            at = float(self.py(y))
            parts.append(element("path", class_="grid", d=f"M{LEFT} {at:.1f}H{right}"))
            parts.append(element("text", text, x=LEFT - 6, y=at + 4, text_anchor="end"))
        parts.append(element("path", class_="axis", d=f"M{LEFT} {TOP}V{bottom}H{right}"))
        parts.append(element("text", x_label, x=(LEFT + right) / 2, y=HEIGHT - 6, text_anchor="middle"))
        beside = f"translate(13 {(TOP + bottom) / 2}) rotate(-90)"
        parts.append(element("text", y_label, transform=beside, text_anchor="middle"))
        return joined(*parts)

    def _y_ticks(self) -> tuple[list[float], list[str]]:
        if not self.log:
            return ticks(self.y0, self.y1, 5)
        decades = range(math.ceil(self.y0), math.floor(self.y1) + 1)
        if len(decades) < 2:  # under two decades, round numbers of the linear kind serve better
            at, _ = ticks(10**self.y0, 10**self.y1, 4)
            at = [y for y in at if y > 0]
            return at, [shown(y) for y in at]
        shown_decades = decades[:: math.ceil(len(decades) / 6)]
        return [10.0**d for d in shown_decades], [f"1e{d}".replace("-", "−") for d in shown_decades]


def ticks(low: float, high: float, about: int) -> tuple[list[float], list[str]]:
    """Round numbers between low and high, steps of 1, 2 or 5, and their texts with equal decimals.

    >>> ticks(0.0, 1.0, 5)
    ([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], ['0.0', '0.2', '0.4', '0.6', '0.8', '1.0'])
    """
    raw = (high - low) / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = power * next(m for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    places = max(0, -math.floor(math.log10(step) + 1e-9))
    at = [round(i * step, places + 3) for i in range(first, last + 1)]
    most = max(abs(low), abs(high))
    if most >= 1e6 or most < 1e-2:
        digits = 1 + max(0, math.ceil(math.log10(most / step)))
        return at, [shown(value, digits) for value in at]
    return at, [f"{value:.{places}f}".replace("-", "−") for value in at]


def thinned(
    x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"], columns: int = COLUMNS
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest sample of each pixel column: the page stays light and no spike is lost."""
    if len(x) <= 3 * columns:
        return x, y
    edges = np.linspace(0, len(x), columns + 1).astype(int)[:-1]
    groups = np.split(np.arange(len(x)), edges[1:])
    kept: list[int] = []
    for group in groups:
        values = y[group]
        if np.all(np.isnan(values)):
            kept.append(group[0])
        else:
            kept += sorted({int(group[np.nanargmin(values)]), int(group[np.nanargmax(values)])})
    return x[kept], y[kept]


def _inside(*drawn: Markup) -> Markup:
    """What is drawn, cut off at the axes: a nested svg shows nothing outside its own box."""
    box = (LEFT, TOP, COLUMNS, HEIGHT - TOP - BOTTOM)
    shown_box = " ".join(map(str, box))
    return element("svg", *drawn, x=box[0], y=box[1], width=box[2], height=box[3], viewBox=shown_box, class_="inside")


def _curve(axes: _Axes, series: Series) -> Markup:
    if series.style in ("points", "cloud"):
        sparse = math.ceil(len(series.x) / (COLUMNS / 2)) or 1  # else dots hide the curve
        keep = slice(None, None, 1 if series.style == "cloud" else sparse)
        px, py = axes.px(series.x[keep]), axes.py(series.y[keep])
        good = np.isfinite(px) & np.isfinite(py)
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(px[good], py[good], strict=True))
        return element("path", class_=f"{series.style} {series.tone}", d=dots)
    x, y = thinned(series.x, series.y)
    return element("path", class_=f"{series.style} {series.tone}", d=path(axes.px(x), axes.py(y)))


def _band(axes: _Axes, band: Band) -> Markup:
    keep = slice(None, None, math.ceil(len(band.x) / COLUMNS) or 1)
    x = np.concatenate([band.x[keep], band.x[keep][::-1]])
    y = np.concatenate([band.lower[keep], band.upper[keep][::-1]])
    return element("path", class_="band", d=path(axes.px(x), axes.py(y)) + "Z")


def _mark(axes: _Axes, x: float, meaning: str) -> Markup:
    if not axes.x0 <= x <= axes.x1:
        return Markup("")
    at = float(axes.px(x))
    line = element("path", class_="mark", d=f"M{at:.1f} {TOP}V{HEIGHT - BOTTOM}")
    return line + element("text", meaning, class_="mark", x=at + 4, y=TOP + 9)


def _stretch(axes: _Axes, stretch: Stretch) -> Markup:
    start, end = float(axes.px(stretch.start)), float(axes.px(stretch.end))
    return element("rect", class_="stretch", x=start, y=TOP, width=max(end - start, 1.0), height=HEIGHT - TOP - BOTTOM)


def _legend(chart: Chart) -> Markup:
    keys = [(s.name, f"key {s.tone} {s.style}") for s in chart.series] + [(b.name, "key band") for b in chart.bands]
    keys += [(name, "key stretch") for name in dict.fromkeys(s.name for s in chart.stretches)]
    return element("span", *(element("span", name, class_=look) for name, look in keys if name), class_="legend")


def _range(arrays: Sequence[np.ndarray], margin: float = 0.0) -> tuple[float, float]:
    finite = [a[np.isfinite(a)] for a in map(np.asarray, arrays)]
    finite = [a for a in finite if a.size]
    if not finite:
        return 0.0, 1.0
    low, high = min(float(a.min()) for a in finite), max(float(a.max()) for a in finite)
    if high - low <= 1e-12 * max(abs(low), abs(high)):  # a constant still deserves an axis
        spread = abs(low) * 0.1 or 1.0
        return low - spread, high + spread
    return low - margin * (high - low), high + margin * (high - low)


def _widened(low: float, high: float, others: Sequence[np.ndarray]) -> tuple[float, float]:
    """Room for curves that need not fit, up to as much again on either side."""
    below, above = _range([np.append(y, [low, high]) for y in others]) if others else (low, high)
    return max(below, low - (high - low)), min(above, high + (high - low))
