"""The demonstration's reality: honest about the friction, filmed so that it can be measured."""

from pathlib import Path

import numpy as np
import pytest

from backend.demo.reality import FRAMES_PER_S, HELD_S, LOAD_N, TRUTH, filmed, real_motion, with_load_and_pivots
from backend.mechanism.read import read_mechanism
from backend.observe.bed import read_bed

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "fourbar" / "mechanism.json"


@pytest.fixture(scope="module")
def drawn():
    return with_load_and_pivots(read_mechanism(SAMPLE))


@pytest.fixture(scope="module")
def swing(drawn):
    return real_motion(drawn, 0.0)


def test_the_drawing_knows_nothing_of_the_friction_that_it_is_to_find(drawn):
    assert {effect.kind for effect in drawn.effects} == {"applied_force"}
    assert all(name.split(":")[0] not in {e.kind for e in drawn.effects} for name in TRUTH)


def test_the_real_linkage_is_held_still_and_then_let_go(swing):
    times, places = swing
    held = times <= HELD_S
    assert np.ptp(places["B"][held], axis=0).max() == 0.0
    assert np.ptp(places["B"], axis=0).max() > 0.05  # m: the crank is 40 mm long and swings wide
    np.testing.assert_allclose(np.diff(times), 1 / FRAMES_PER_S, rtol=1e-9)  # rounding of the clock


def test_its_bars_keep_their_lengths_and_its_pivots_their_places(swing):
    _, places = swing
    crank = np.linalg.norm((places["B"] - places["A"])[:, [0, 2]], axis=1)
    np.testing.assert_allclose(crank, 0.040, atol=1e-6)  # m; the engine closes joints to about 1e-8
    assert max(np.ptp(places[pivot], axis=0).max() for pivot in "AD") == 0.0


def test_the_unseen_load_is_no_small_change(drawn, swing):
    _, loaded = real_motion(drawn, LOAD_N)
    apart = np.linalg.norm(loaded["B"] - swing[1]["B"], axis=1)
    assert apart.max() > 0.03  # m: far above what is measured to 0.02 mm


def test_the_clip_comes_with_the_bed_and_heights_that_the_tracker_needs(tmp_path, swing):
    times, places = swing
    few = {marker: p[:6] for marker, p in places.items()}
    bed = read_bed(filmed(tmp_path / "clip.mp4", times[:6], few, places, lambda done, total: None))
    assert len(bed.marks) >= 4
    assert bed.lens is not None
    assert set(bed.marker_height_m) == set(places)
