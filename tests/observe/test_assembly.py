"""Dots named from how a mechanism holds together: any pose, dots that are nobody's, a rig that stands elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from backend.mechanism.read import read_mechanism
from backend.observe.assembly import assembling_of, put_together
from backend.observe.flat_mechanism import FlatMechanism
from backend.observe.label import label_dots
from backend.observe.plane import Plane
from backend.observe.project import AbstractView
from backend.observe.tracking_error import TrackingError

from .filmed_fourbar import MARKERS, drawing, fourbar

PX_PER_M = 2000.0
STICKER_M = 5e-4  # how far a dot lies from where it was drawn
SAMPLES = Path(__file__).parents[2] / "samples"


class Square(AbstractView):
    """A camera square to the bed."""

    def metres(self, px, height_m):
        return np.array([1, -1]) * px / PX_PER_M

    def pixels(self, xy_m, height_m):
        return np.array([1, -1]) * PX_PER_M * xy_m


def named(mechanism, drawn_m, dots_m, clicks=None):
    """Each marker's dot, in the order of the drawing."""
    eye, level = Square(), np.zeros(len(drawn_m))
    expected = dict(zip((m.id for m in mechanism.markers), eye.pixels(drawn_m, level), strict=True))
    at = {k: tuple(eye.pixels(p, level)) for k, p in (clicks or {}).items()}
    found = label_dots(expected, eye.pixels(dots_m, level), 20.0, at, assembling_of(mechanism, Plane(), eye, level))
    return list(found.values())


def shuffled(true_m, rng, strangers=2):
    """Dots with stickers off by half a millimetre, some that are nobody's, in any order; and where each marker's is."""
    stuck = true_m + STICKER_M * rng.standard_normal(true_m.shape)
    low, high = true_m.min(0) - 0.05, true_m.max(0) + 0.05
    others: list[np.ndarray] = []
    while len(others) < strangers:  # nearer than a sticker may lie, nobody could tell them apart
        p = rng.uniform(low, high)
        if np.hypot(*(true_m - p).T).min() > 0.01:
            others.append(p)
    order = rng.permutation(len(true_m) + strangers)
    return np.concatenate([stuck, np.array(others).reshape(-1, 2)])[order], np.argsort(order)[: len(true_m)].tolist()


@pytest.mark.parametrize("turn_deg", [0, 10, 30, 60, 90, 120, 150, 180, 210, 240, 270, 300, 330])
def test_a_crank_that_stands_anywhere_is_named(turn_deg):
    rng = np.random.default_rng(turn_deg)
    drawn, true = fourbar([1.0])[0], fourbar([1.0 + np.deg2rad(turn_deg)])[0]
    dots, own = shuffled(true, rng)
    assert named(drawing(), drawn, dots) == own


def scissor_at(flat, degrees):
    """The sample's markers with every bar at an angle to its length: one corner is held, another slides along y."""
    corner = flat.marker_at.min(0)
    across = np.unique(np.round(flat.marker_at[:, 0], 9))
    drawn = np.array([across[2] - across[0], np.ptp(flat.marker_at[:, 1])])  # what one bar spans
    turned = np.hypot(*drawn) * np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
    return corner + (flat.marker_at - corner) * turned / drawn


@pytest.mark.parametrize("degrees", [10, 25, 45, 60, 75])
def test_ten_cells_opened_farther_or_less_than_drawn_are_named(degrees):
    mechanism = read_mechanism(SAMPLES / "scissor" / "mechanism.json")
    flat = FlatMechanism(mechanism, Plane())
    true = scissor_at(flat, degrees)
    dots, own = shuffled(true, np.random.default_rng(degrees), strangers=0)
    assert named(mechanism, flat.marker_at, dots) == own
    poses = put_together(flat, true)
    assert flat.carried(poses, flat.marker_body, flat.marker_at)[0] == pytest.approx(true, abs=1e-6)


def test_a_rig_that_stands_elsewhere_on_the_bed_in_another_pose_is_named():
    rng, turn = np.random.default_rng(4), np.exp(0.7j)
    true = fourbar([2.5])[0] @ np.array([[turn.real, turn.imag], [-turn.imag, turn.real]]) + [0.03, -0.02]
    dots, own = shuffled(true, rng, strangers=0)
    assert named(drawing(), fourbar([1.0])[0], dots) == own


def test_two_dots_that_could_both_be_a_marker_are_doubtful_until_one_is_clicked():
    rng = np.random.default_rng(5)
    dots, own = shuffled(fourbar([2.5])[0], rng, strangers=0)
    knee = MARKERS.index("knee")
    dots = np.concatenate([dots, dots[[own[knee]]] + [0.002, 0.0]])
    with pytest.raises(TrackingError, match=r"doubtful which dots are knee\. Click"):
        named(drawing(), fourbar([1.0])[0], dots)
    assert named(drawing(), fourbar([1.0])[0], dots, clicks={"knee": dots[own[knee]]}) == own


def test_dots_that_are_no_such_mechanism_are_refused():
    dots = np.random.default_rng(6).uniform(-0.2, 0.2, (5, 2))
    with pytest.raises(TrackingError, match="doubtful"):
        named(drawing(), fourbar([1.0])[0], dots)
