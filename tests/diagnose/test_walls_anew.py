"""Walls that nobody states: where they begin, and which of several beginnings is followed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import closer as module
from backend.diagnose.cause import Cause
from backend.diagnose.closer import allowing_for_walls, closer
from backend.diagnose.library import SMOOTH
from backend.diagnose.switched import ways

ROWS = 100


def member(name: str, family: str, starts: dict[str, float], closer: tuple[Any, ...] = ()) -> Any:
    numbers = tuple(SimpleNamespace(name=f"{name}.{n}", start=at) for n, at in starts.items())
    return SimpleNamespace(name=name, family=family, parameters=numbers, closer=closer)


SOFT, STIFF = (member("stop", "joint_stop", {"lower": 0.0, "stiffness": k}) for k in (1e2, 1e4))
HARD = member("stop", "joint_stop", {"lower": 0.0}, (SOFT, STIFF))
SCALE = member("scale", SMOOTH, {"relative": 0.0})
SEARCH: Any = SimpleNamespace(subject=SimpleNamespace(library=SimpleNamespace(candidates=[HARD, SCALE])))


@pytest.mark.parametrize(
    ("members", "told"),
    [
        ((HARD,), [((SOFT,), {}), ((STIFF,), {})]),
        ((STIFF,), []),
        ((HARD, SCALE), [((SOFT, SCALE), {}), ((STIFF, SCALE), {})]),
        ((STIFF, SCALE), [((SOFT, SCALE), {"stop.stiffness": 1e2}), ((STIFF, SCALE), {"stop.stiffness": 1e4})]),
    ],
    ids=["hard alone", "free alone", "hard beside another", "free beside another"],
)
def test_walls_that_came_free_alone_begin_anew_beside_another_cause(members, told):
    fitted: Any = SimpleNamespace(choice=SimpleNamespace(candidates=members))
    assert list(ways(SEARCH, fitted)) == told


@pytest.mark.parametrize(
    ("second", "followed", "best"),
    [(26.6, ["stiff", "soft"], 20.0), (40.0, ["stiff"], 30.0)],
    ids=["as near at first", "behind at first"],
)
def test_a_way_that_is_as_near_at_first_is_followed_to_the_end_too(monkeypatch, second, followed, best):
    asked = []

    def about(parent, choice, x, shares):
        asked.append(choice)
        return SimpleNamespace(chi2={"stiff": 30.0, "soft": 20.0}[choice] * ROWS, r=np.zeros(ROWS))

    first = [SimpleNamespace(choice="stiff", x=None, chi2=26.4), SimpleNamespace(choice="soft", x=None, chi2=second)]
    monkeypatch.setattr(module, "opened", lambda search, fitted: first)
    monkeypatch.setattr(module, "ways", lambda search, fitted: iter(first))
    monkeypatch.setattr(module, "log_evidence", lambda fitted: -fitted.chi2)
    monkeypatch.setattr(module, "Cause", lambda fitted, log_z, simpler: SimpleNamespace(
        fitted=fitted, log_z=log_z, names=("stop",)
    ))  # fmt: skip
    search: Any = SimpleNamespace(
        cancelled=lambda: False, opened={}, tell=lambda words: None, fit_about=about, tried={}
    )
    cause: Any = SimpleNamespace(
        names=("stop",), log_z=-1e9, fitted=SimpleNamespace(chi2=345.0 * ROWS, r=np.zeros(ROWS))
    )
    found = closer(search, cause)
    assert asked == followed
    assert found.fitted.chi2 == best * ROWS
    assert closer(search, cause) is cause  # not asked again, nor what came of it
    assert closer(search, found) is found
    assert asked == followed


@pytest.mark.parametrize(
    ("members", "left", "allowed"),
    [((HARD,), 90.0, True), ((HARD,), 110.0, False), ((STIFF,), 90.0, False), ((SCALE,), 90.0, False)],
    ids=["hard", "soft ones leave more", "free already", "no walls"],
)
def test_walls_that_are_enough_as_assumed_are_known_beside_those_that_come(monkeypatch, members, left, allowed):
    open_walls = SimpleNamespace(choice=None, x=None, chi2=left, r=np.zeros(ROWS), fraction=1.0)
    monkeypatch.setattr(module, "opened", lambda search, fitted: [open_walls])
    search: Any = SimpleNamespace(
        cancelled=lambda: False, opened={}, tell=lambda words: None, fit_about=lambda *about: open_walls
    )
    fitted: Any = SimpleNamespace(choice=SimpleNamespace(candidates=members), chi2=100.0, fraction=1.0)
    cause = Cause(fitted, -50.0)
    found = allowing_for_walls(search, cause)
    assert (found.fitted, found.log_z) == (cause.fitted, cause.log_z)
    assert found.otherwise is (open_walls if allowed else None)
