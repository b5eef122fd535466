"""Ends of travel of different joints that stop a motion alike share what speaks for them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import ends
from backend.diagnose.belief import weigh
from backend.diagnose.ends import one_motion, same_end
from tests.diagnose.test_imitation import cause

CRANK, ROD = 0.06, 0.2  # m, of a slider-crank
AT = -1.17
RATE = (
    -CRANK / ROD * np.cos(AT) / np.sqrt(1.0 - (CRANK / ROD * np.sin(AT)) ** 2) - 1.0
)  # of the rod, a unit of the crank


@pytest.fixture(scope="module")
def motion():
    """A slider-crank that swings down to a stop of its crank and back, and a bar that swings by itself."""
    time = np.linspace(0.0, 3.0, 150)
    crank = np.stack([np.maximum(AT, a * np.cos(5.0 * time)) for a in (1.5, 1.3)])
    rod = -np.arcsin(CRANK / ROD * np.sin(crank))
    slide = CRANK * np.cos(crank) + ROD * np.cos(rod)
    return {"crank": crank, "rod": rod - crank, "slide": slide, "pin": rod, "bar": np.cos(3.1 * time) + 0.0 * crank}


@pytest.mark.parametrize("upper", [True, False])
def test_another_pin_of_the_loop_ends_where_it_stands_at_the_blow(motion, upper):
    met = same_end("crank", AT, False, "rod", upper, motion)
    if upper:
        assert met is not None
        assert met[0] == pytest.approx(-np.arcsin(CRANK / ROD * np.sin(AT)) - AT, abs=1e-3)
        assert met[1] == pytest.approx(RATE, rel=0.02)
    else:
        assert met is None  # it has been far below


def test_soft_ends_let_both_joints_farther(motion):
    free = motion["crank"] * 1.0
    free[free <= AT] = AT - 0.1 * np.linspace(0.0, 1.0, int(np.sum(free <= AT)))  # three hundredths of its way
    rod = -np.arcsin(CRANK / ROD * np.sin(free)) - free
    assert rod.max() - (-np.arcsin(CRANK / ROD * np.sin(AT)) - AT) > 2.0 * ends.ONE_CURVE * np.ptp(rod)
    met = same_end("crank", AT, False, "rod", True, {"crank": free, "rod": rod})
    assert met is not None
    assert met[0] == pytest.approx(-np.arcsin(CRANK / ROD * np.sin(AT)) - AT, abs=1e-3)


@pytest.mark.parametrize(
    ("joint", "upper"), [("slide", True), ("slide", False), ("pin", False), ("bar", True), ("bar", False)]
)
def test_a_joint_that_has_been_beyond_or_moves_by_itself_does_not_stop_alike(motion, joint, upper):
    """The slide stands there with the crank up as well as down, and goes farther in the swing up."""
    assert same_end("crank", AT, False, joint, upper, motion) is None


def stop(joint: str, end: str, at: float, log_z: float, *beside: str) -> Any:
    """A fitted end of travel, alone or beside other effects."""
    number = SimpleNamespace(name=f"joint_stop.{joint}.{end}", parameter=end)
    member = SimpleNamespace(kind="joint_stop", name=f"joint_stop:{joint}.{end}", on=(joint,), parameters=(number,))
    others = [SimpleNamespace(kind="air_drag", name=name) for name in beside]
    return SimpleNamespace(
        candidates=(member, *others), names=tuple(sorted([member.name, *beside])), values={number.name: at},
        log_z=log_z, fitted=None,
    )  # fmt: skip


def test_only_ends_that_stand_where_the_motion_is_stopped_are_one_motion(monkeypatch, motion):
    monkeypatch.setattr(ends, "passed", lambda fitted: motion)
    rod = -np.arcsin(CRANK / ROD * np.sin(AT)) - AT
    found = one_motion([
        stop("crank", "lower", AT, 9.0), stop("rod", "upper", rod + 0.3, 5.0), stop("slide", "upper", 0.2, 4.0),
        stop("bar", "upper", 1.0, 3.0), stop("crank", "lower", AT, 2.0, "air_drag:rod"),
        stop("rod", "upper", rod + 0.01, 1.0, "air_drag:rod"),
    ])  # fmt: skip
    assert found == [
        [("air_drag:rod", "joint_stop:crank.lower"), ("air_drag:rod", "joint_stop:rod.upper")],
    ]


def test_causes_of_one_motion_are_as_probable_as_each_other_and_together_as_before():
    sets = [cause("joint:a"), cause("joint:a", "camera"), cause("joint:a", "world")]
    sets[2] = replace(sets[2], fitted=replace(sets[2].fitted, r=0.99 * sets[2].fitted.r))
    apart = weigh(None, sets, 50, scale=1.0, unknown_log_z=0.0)
    names = [s.names for s in sets[1:]]
    tied = weigh(None, sets, 50, scale=1.0, unknown_log_z=0.0, one_motion=[names])
    of = lambda belief: {c.names: p for c, p in zip(belief.causes, belief.probability, strict=True)}  # noqa: E731
    before, after = of(apart), of(tied)
    assert before[names[1]] > 1.1 * before[names[0]]
    assert after[names[0]] == pytest.approx(after[names[1]])
    assert sum(after.values()) == pytest.approx(sum(before.values()))
    assert after[sets[0].names] == pytest.approx(before[sets[0].names])
