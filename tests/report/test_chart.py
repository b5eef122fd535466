"""Charts: what is drawn stands where the numbers say, and nothing that matters is thinned away."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.report.chart import BOTTOM, COLUMNS, HEIGHT, LEFT, TOP, Band, Chart, Series, thinned, ticks
from backend.report.quantity import measured, shown
from backend.report.strip import correlation_matrix, interval_strip
from backend.report.svg import element


def chart(*series: Series, **rest) -> Chart:
    return Chart("tip", "time [s]", "x [mm]", list(series), **rest)


def drawn_paths(svg: str, tone: str) -> list[list[tuple[float, float]]]:
    tree = ElementTree.fromstring(svg)
    paths = [e.get("d", "") for e in tree.iter("path") if tone in (e.get("class") or "").split()]
    return [[(float(x), float(y)) for x, y in re.findall(r"[ML]([\d.-]+) ([\d.-]+)", d)] for d in paths]


def test_a_straight_line_runs_from_corner_to_corner():
    x = np.linspace(0.0, 2.0, 11)
    (path,) = drawn_paths(chart(Series("", x, x)).svg(), "c0")
    assert path[0][0] == LEFT
    assert path[-1][0] == LEFT + COLUMNS
    rise = (HEIGHT - TOP - BOTTOM) / 1.12  # 6% of margin at both ends
    assert path[0][1] - path[-1][1] == pytest.approx(rise, abs=0.1)  # one decimal is written


def test_a_gap_in_the_measurements_is_a_gap_in_the_curve():
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    svg = chart(Series("", np.arange(5.0), y)).svg()
    assert re.search(r'class="line c0" d="M[^M]*M[^M]*"', svg)


def test_a_spike_of_one_sample_in_a_hundred_thousand_is_kept():
    y = np.zeros(100_000)
    y[54_321] = 1.0
    x, kept = thinned(np.arange(1e5), y)
    assert len(x) <= 2 * COLUMNS
    assert kept.max() == 1.0


def test_a_runaway_drawing_does_not_flatten_the_measurement():
    t = np.linspace(0.0, 1.0, 50)
    wild = Series("before", t, 1e6 * t, "before", framed=False)
    svg = chart(Series("measured", t, np.sin(t), "measured"), wild).svg()
    (path,) = drawn_paths(svg, "measured")
    heights = [y for _, y in path]
    assert max(heights) - min(heights) > 0.4 * (HEIGHT - TOP - BOTTOM)


def test_a_chart_of_a_constant_and_of_nothing_measured_still_has_axes():
    t = np.linspace(0.0, 1.0, 5)
    for y in (np.full(5, 3.0), np.full(5, np.nan), np.zeros(5)):
        svg = chart(Series("", t, y), bands=[Band("", t, y - 1, y + 1)]).svg()
        assert "nan" not in svg
        assert "inf" not in svg
        ElementTree.fromstring(svg)


def test_a_logarithmic_axis_leaves_out_what_has_no_logarithm():
    y = np.array([0.0, 1e-12, 1e-3])
    (path,) = drawn_paths(chart(Series("", np.arange(3.0), y), log_y=True).svg(), "c0")
    assert len(path) == 2


def test_names_from_a_drawing_cannot_become_markup():
    svg = Chart("<script>alert(1)</script>", "t", "y", [Series("<b>", np.arange(2.0), np.arange(2.0))]).svg()
    assert "<script" not in svg
    assert "<b>" not in svg.replace("<b>&lt;", "")
    assert element("text", '"', x='"') == '<text x="&#34;">&#34;</text>'


@given(st.floats(-1e5, 1e5), st.floats(1e-4, 1e5))
def test_ticks_lie_inside_evenly_and_read_as_what_they_are(low, span):
    at, text = ticks(low, low + span, 5)
    assert 2 <= len(at) <= 7
    slack = 1e-6 * span
    assert low - slack <= at[0]
    assert at[-1] <= low + span + slack
    steps = np.diff(at)
    assert np.allclose(steps, steps[0], rtol=1e-6)
    assert len(set(text)) == len(text)


def test_a_value_shows_two_digits_of_its_standard_deviation():
    assert measured(203.4863, 1.52) == "203.5"
    assert measured(-3.163, 0.11) == "−3.16"
    assert measured(0.011031, 4e-4) == "0.01103"
    assert shown(None) == "–"


def test_the_strip_puts_truth_and_interval_in_order():
    svg = interval_strip(1.0, (0.8, 1.2), truth=1.1)
    low, high = map(float, re.search(r'class="interval" d="M([\d.]+) 10H([\d.]+)"', svg).groups())
    truth = float(re.search(r'd="M([\d.]+) 2V18"', svg).group(1))
    estimate = float(re.search(r'cx="([\d.]+)"', svg).group(1))
    assert low < estimate < truth < high


def test_the_correlation_matrix_says_every_number_and_where_there_is_none():
    svg = correlation_matrix(["a", "b"], [[1.0, -0.25], [-0.25, None]])
    assert svg.count("−0.25") == 2
    assert "–" in svg
