"""Ends of travel of different joints that stop a motion alike."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.switch import same_end

CRANK, ROD = 0.06, 0.2  # m, of a slider-crank


def on(joint: str) -> Any:
    return SimpleNamespace(on=(joint,))


@pytest.fixture(scope="module")
def motion():
    """A slider-crank that swings down to a stop of its crank and back, and a bar that swings by itself."""
    time = np.linspace(0.0, 3.0, 150)
    crank = np.stack([np.maximum(-1.17, a * np.cos(5.0 * time)) for a in (1.5, 1.3)])
    rod = -np.arcsin(CRANK / ROD * np.sin(crank))
    slide = CRANK * np.cos(crank) + ROD * np.cos(rod)
    return {"crank": crank, "rod": rod - crank, "slide": slide, "pin": rod, "bar": np.cos(3.1 * time) + 0.0 * crank}


@pytest.mark.parametrize(("joint", "upper"), [("rod", True), ("rod", False)])
def test_another_pin_of_the_loop_ends_where_it_stands_at_the_blow(motion, joint, upper):
    at = -1.17
    end = same_end(on("crank"), at, on(joint), upper, motion)
    rod = -np.arcsin(CRANK / ROD * np.sin(at))
    if upper:
        assert end == pytest.approx(rod - at, abs=1e-3)
    else:
        assert end is None  # it has been far below


@pytest.mark.parametrize(
    ("joint", "upper"), [("slide", True), ("slide", False), ("pin", False), ("bar", True), ("bar", False)]
)
def test_a_joint_that_has_been_beyond_or_moves_by_itself_does_not_stop_alike(motion, joint, upper):
    """The slide stands there with the crank up as well as down, and goes farther in the swing up."""
    assert same_end(on("crank"), -1.17, on(joint), upper, motion) is None
