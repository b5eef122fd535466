"""Dots named from how a mechanism holds together: any pose, dots that are nobody's, a rig that stands elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from backend.mechanism.read import parse_mechanism, read_mechanism
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


def rig(joints, markers):
    """A flat rig of parts as drawn at the world's own axes: (joint type, part, part, x, y) and (part, x, y)."""
    still = {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}
    inertia = {"xx": 1e-5, "yy": 1e-5, "zz": 1e-5, "xy": 0.0, "xz": 0.0, "yz": 0.0}
    inertial = {"mass_kg": 0.05, "center_of_mass_m": [0.0, 0.0, 0.0], "inertia_kg_m2": inertia}
    parts = dict.fromkeys(b for _, *pair, _, _ in joints for b in pair if b != "ground")
    frames = [{**still, "position_m": [x, y, 0.0]} for *_, x, y in joints]
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "rig", "gravity_m_per_s2": [0.0, 0.0, -9.81], "effects": [],
            "bodies": [{"id": "ground", "fixed": True, "pose": still},
                       *({"id": b, "pose": still, "inertial": inertial} for b in parts)],
            "joints": [{"id": f"j{k}", "type": kind, "body_a": a, "body_b": b, "frame_a": at, "frame_b": at}
                       for k, ((kind, a, b, _, _), at) in enumerate(zip(joints, frames, strict=True))],
            "markers": [{"id": f"m{k}", "body": b, "position_m": [x, y, 0.0]} for k, (b, x, y) in enumerate(markers)],
        }
    )  # fmt: skip


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "mechanism",
    [
        rig(  # a press: a crank of 6 mm throw, without a dot
            [("revolute", "ground", "crank", 0, 0), ("revolute", "crank", "rod", 0.006, 0),
             ("revolute", "rod", "rocker", 0.15, 0.02), ("revolute", "rocker", "ground", 0.15, -0.1)],
            [("rod", 0.03, 0.0), ("rod", 0.12, 0.015), ("rocker", 0.15, -0.03)],
        ),
        rig(  # two bearings of one shaft
            [("revolute", "ground", "hub", 0, 0), ("revolute", "ground", "hub", 0, 0), ("fixed", "hub", "arm", 0, 0)],
            [("arm", 0.1, 0.0), ("arm", 0.05, 0.02)],
        ),
    ],
    ids=["press", "shaft"],
)  # fmt: skip
def test_pins_too_close_to_tell_a_turn_end_no_search(mechanism):
    flat = FlatMechanism(mechanism, Plane())
    poses = put_together(flat, flat.marker_at)
    assert flat.carried(poses, flat.marker_body, flat.marker_at)[0] == pytest.approx(flat.marker_at, abs=1e-6)


def test_a_sticker_beyond_what_is_allowed_does_not_give_its_name_to_a_stranger():
    """A pendulum of 50 mm as drawn, its sticker 2 mm too far out, and a stranger on the arc of its marker."""
    pendulum = rig([("revolute", "ground", "arm", 0, 0)], [("arm", 0.05, 0.0)])
    stranger = 0.05 * np.array([np.cos(2.3), np.sin(2.3)])
    with pytest.raises(TrackingError, match="doubtful which dots are m0"):
        named(pendulum, np.array([[0.05, 0.0]]), np.array([[0.052, 0.0], stranger]))
    assert named(pendulum, np.array([[0.05, 0.0]]), np.array([[0.052, 0.0]])) == [0]
