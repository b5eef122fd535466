"""Held-out experiments: what counts of them beside a cause."""

import numpy as np
import pytest

from tests.diagnose.test_diagnosis import COARSE_S, FEW, SIGMA, drawing, study

__all__ = ["drawing"]  # a fixture

pytestmark = pytest.mark.timeout(600)

WILD = (-40, -9)  # frames of the held-out record in which the tip was taken for something else
AWAY = 60.0  # noises


@pytest.fixture(scope="module")
def drawn(drawing):
    """A search whose first look at samples overlooked all wild ones, and the drawing fitted."""
    from backend.diagnose import noise
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    told = study(drawing, 4)
    tracks = told.held_out[0].tracks
    times = np.unique(tracks.time_s)
    for frame in WILD:
        tracks.loc[(tracks.time_s == times[frame]) & (tracks.marker == "tip"), "x_m"] += AWAY * SIGMA
    with pytest.MonkeyPatch.context() as blind:
        blind.setattr(noise, "good_samples", lambda data: np.isfinite(data.value))
        subject = prepare(told, library(drawing, SMOOTH, told.tolerances, FEW), COARSE_S)
    return Search(subject, lambda words: None, lambda: False).baseline().fitted, times[list(WILD)]


def test_a_sample_that_stands_alone_is_dropped_with_its_markers_other_coordinate(drawn):
    from backend.diagnose.lone import set_lone_aside

    fitted, wild = drawn
    (probe,), (keep,) = fitted.subject.held_out, fitted.subject.held_noise.keep
    assert keep.all()
    assert set_lone_aside(fitted)
    tip = np.array([c.at == "marker:tip" for c in probe.data.channels])[probe.data.channel]
    assert not keep[tip & np.isin(probe.data.time_s, wild)].any()
    assert np.sum(~keep) <= 2 * len(wild) + 2  # of 300 good ones one may be taken for wild
    assert not set_lone_aside(fitted)


def test_samples_that_stand_off_together_are_what_a_fit_misses(drawn):
    from backend.diagnose.lone import set_lone_aside

    fitted, _ = drawn
    (probe,), (keep,) = fitted.subject.held_out, fitted.subject.held_noise.keep
    keep[:] = True
    data = probe.data
    struck = np.isin(data.time_s, np.unique(data.time_s)[[-30, -29, -28]])
    data.value[struck] += AWAY * SIGMA
    set_lone_aside(fitted)
    data.value[struck] -= AWAY * SIGMA
    assert keep[struck].all()


def test_still_frames_in_which_a_marker_was_elsewhere_do_not_move_where_a_record_begins(drawn):
    fitted, _ = drawn
    probe = fitted.subject.chosen(fitted.subject.held_out[0], fitted.choice)
    clean, still = probe.settle(fitted.values), np.unique(probe.data.time_s[probe.data.still])
    tip = np.array([c.at == "marker:tip" for c in probe.data.channels])[probe.data.channel]
    elsewhere = tip & np.isin(probe.data.time_s, still[2:6])
    probe.data.value[elsewhere] += AWAY * SIGMA
    again = fitted.subject.chosen(fitted.subject.held_out[0], fitted.choice).settle(fitted.values)
    probe.data.value[elsewhere] -= AWAY * SIGMA
    assert np.all(np.abs(again - clean) < 0.2 * SIGMA / 0.1)
