"""Ends of travel of different joints that stop a motion alike."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import which
from backend.diagnose.library import Candidate
from backend.diagnose.switch import same_end
from backend.diagnose.which import Search
from backend.fit.free import FreeParameter

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


def end_of(joint: str, side: str, take: int) -> Candidate:
    """An end of a joint's travel, and the same with how much of a blow it gives back."""
    own, back = (
        FreeParameter("joint_stop", (joint,), joint, name, "", -9.0, 9.0, 0.0, (), 1.0)
        for name in (side, "restitution")
    )
    plain = Candidate("joint_stop", (joint,), (f"joint:{joint}",), frozenset(), (own,), ((take,),), "joint_stop", ((),))
    closer = replace(plain, parameters=(own, back), takes=((take,), (9,)), tries=((), (0.0,)))
    return replace(plain, closer=(closer,))


def test_every_end_that_stops_alike_is_fitted_from_where_its_joint_stands_with_the_same_blow(monkeypatch, motion):
    ends = [
        end_of("crank", "lower", 0),
        end_of("rod", "upper", 1),
        end_of("rod", "lower", 0),
        end_of("bar", "upper", 1),
    ]
    (blow,) = ends[0].closer
    begun = []

    def fit(subject, choice, start):
        begun.append((choice.candidates, start))
        return SimpleNamespace(chi2=1.0)

    monkeypatch.setattr(which, "passed", lambda fitted: motion)
    monkeypatch.setattr(which, "fit", fit)
    monkeypatch.setattr(which, "_from", lambda fitted, choice, values: values)
    choose = lambda *members: SimpleNamespace(candidates=members, name="")  # noqa: E731
    search: Any = object.__new__(Search)
    search.subject = SimpleNamespace(
        library=SimpleNamespace(candidates=ends), neutral=np.array([-1e3, 1e3]), choose=choose
    )
    search.cancelled, search.tell, search._keep_better = lambda: False, lambda words: None, lambda fitted: fitted
    values = dict(zip((p.name for p in blow.parameters), (-1.17, 0.04), strict=True))
    cause: Any = SimpleNamespace(candidates=(blow,), values=values, fitted=None)
    search.stopping_alike(cause)
    ((members, start),) = begun  # the rod's lower end and the bar do not stop alike
    assert members == ends[1].closer
    rod = -np.arcsin(CRANK / ROD * np.sin(-1.17))
    assert start == pytest.approx(
        {members[0].parameters[0].name: rod + 1.17, members[0].parameters[1].name: 0.04}, abs=1e-3
    )
