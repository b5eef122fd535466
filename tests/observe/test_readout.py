"""How long a rolling shutter takes, from bars that keep their lengths; the four-bar is in closed form."""

import numpy as np
import pytest

from backend.observe.bars import known_lengths
from backend.observe.bed import read_bed
from backend.observe.plane import Plane
from backend.observe.readout import Readout, dated, readout_of

from .filmed_fourbar import MARKERS, drawing, fourbar

BARS = known_lengths(drawing(), Plane(), MARKERS)
TOP_M, HIGH_M = 0.18, 0.36  # of the picture, on the bed
MARKS = [{"id": f"m{k}", "x_m": k % 2, "y_m": k // 2, "x_px": k % 2, "y_px": k // 2} for k in range(4)]


def seen(readout_s, rng, noise_m=3e-5, bent=0.0, frames=160, rate=240.0):
    """Times, places as seen and rows of a crank that swings at up to 8 rad/s; bent: relative error of a lens."""
    time_s = np.arange(frames) / rate
    place = lambda t: fourbar(1.0 + 1.5 * np.sin(5.3 * t))  # noqa: E731
    at = place(time_s)
    for _ in range(6):  # a point that moves meets its row at a later place
        row = (TOP_M - at[..., 1]) / HIGH_M
        own = time_s[:, None] + readout_s * row
        at = np.stack([place(own[:, m])[:, m] for m in range(len(MARKERS))], 1)
    at = at * (1 + bent * (at**2).sum(-1, keepdims=True) / 0.1**2)
    return time_s, at + noise_m * rng.standard_normal(at.shape), row


def test_the_bars_tell_the_readout_within_what_they_say():
    found = [readout_of(*seen(4e-3, np.random.default_rng(s)), BARS) for s in range(24)]
    score = np.array([(f.seconds - 4e-3) / f.sd_s for f in found])
    assert max(f.sd_s for f in found) < 2e-4
    assert 0.6 < np.sqrt(np.mean(score**2)) < 1.6  # 24 draws tell a deviation to 15%, 16 blocks each to 18%
    assert np.abs(score).max() < 4.5


def test_noise_of_the_speeds_does_not_make_it_smaller():
    found = [readout_of(*seen(4e-3, np.random.default_rng(s), noise_m=3e-4), BARS).seconds for s in range(24)]
    assert np.mean(found) == pytest.approx(4e-3, abs=4 * np.std(found) / np.sqrt(24))


def test_a_global_shutter_is_not_taken_for_a_rolling_one():
    for s in range(8):
        time_s, at, row = seen(0.0, np.random.default_rng(s), bent=1e-3)  # 0.1 mm at 0.1 m: a poor calibration
        bed, told = dated(read_bed(MARKS), readout_of(time_s, at, row, BARS))
        assert bed.readout_s == 0.0
        assert told == []


def test_a_mechanism_that_stands_still_tells_nothing():
    time_s, at, row = seen(4e-3, np.random.default_rng(0))
    still = np.broadcast_to(at[:1], at.shape) + 3e-5 * np.random.default_rng(1).standard_normal(at.shape)
    bed, told = dated(read_bed(MARKS), readout_of(time_s, still, row, BARS))
    assert (bed.readout_s, told) == (0.0, [])


def test_points_are_dated_by_what_the_bed_file_says_else_by_what_was_found():
    found = Readout(3.6e-3, 1e-4)
    bed, (said,) = dated(read_bed({"marks": MARKS}), found)
    assert bed.readout_s == 3.6e-3
    assert "readout_s of 3.60 ± 0.10 ms" in said
    bed, said = dated(read_bed({"marks": MARKS, "readout_s": 3.5e-3}), found)
    assert (bed.readout_s, said) == (3.5e-3, [])
    bed, (said,) = dated(read_bed({"marks": MARKS, "readout_s": 0.0}), found)
    assert bed.readout_s == 0.0
    assert "given as 0.00 ms" in said
