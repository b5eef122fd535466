"""Markers that do not stay where their body has them: names exchanged, dots lost; a camera that leans is none of it."""

import numpy as np
import pytest

from backend.mechanism.rigid import rigid_findings
from tests.mechanism.swings import TIME, filmed, pendulum


def told(table):
    return list(rigid_findings(table, pendulum()))


def since(table, time_s, **names):
    """Names taken for each other from a time on."""
    later = table["time_s"] >= time_s
    return table.assign(marker=table["marker"].where(~later, table["marker"].replace(names)))


@pytest.mark.parametrize("lean", [0.0, 0.2])
@pytest.mark.parametrize("planar", [True, False])
def test_nothing_is_said_of_a_body_that_is_rigid(lean, planar):
    assert told(filmed(lean=lean, planar=planar)) == []


def test_single_wild_samples_are_left_to_the_fit():
    table = filmed()
    table.loc[table.index[60:68:4], ["x_m", "y_m"]] += 0.1
    assert told(table) == []
    assert told(since(since(table, 0.5, tip="middle", middle="tip"), 0.5 + 1 / 120, tip="middle", middle="tip")) == []


def test_markers_that_exchange_their_names_from_one_sample_to_the_next_are_named_with_the_time():
    (said,) = told(since(filmed(), 1.0, tip="tail", tail="tip"))
    assert 'markers "tip" and "tail" exchange their places at 1 s, from one sample to the next' in said


def test_markers_that_exchange_their_names_while_none_is_seen_are_found_by_their_distances():
    table = since(filmed(), 1.0, tip="middle", middle="tip")
    (said,) = told(table[(table["time_s"] < 0.9) | (table["time_s"] > 1.05)])
    assert "from 1.058 s on, and a body is rigid: with the names of" in said
    assert 'with the names of "tip" and "middle" exchanged since then it is; exchange them there' in said


@pytest.mark.parametrize("jitter", [0.0, 1e-4])
def test_a_marker_that_never_moves_on_a_body_that_does_is_named(jitter):
    table = filmed()
    lost = table["marker"] == "tip"
    table.loc[lost, ["x_m", "y_m"]] = np.array([0.1, -0.2]) + jitter * np.random.default_rng(3).random((TIME.size, 2))
    (said,) = told(table)
    assert 'on body "link"' in said
    assert '"tip" does not move; check that it was tracked' in said


def test_a_marker_that_is_another_bodys_is_named():
    table = filmed()
    lost = table["marker"] == "tip"
    table.loc[lost, "x_m"] = 0.1 * np.sin(5 * TIME)
    (said,) = told(table)
    assert '"tip" is the one that strays; check its name and its body' in said
