"""A set that stays far behind the best one on its way is not followed to the end of the records."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import growing
from backend.diagnose import which as module
from backend.diagnose.fitted import BEHIND
from backend.diagnose.which import Search


@pytest.mark.parametrize("behind", [0.9, 1.1])
@pytest.mark.parametrize("best", [0.3, 7.0], ids=["the best is at the noise", "the best leaves something"])
def test_a_set_far_behind_over_the_first_of_the_records_is_given_up(monkeypatch, best, behind):
    samples, fitted = 100, []

    def fit(subject, choice, start, fractions, ahead, coarse):
        fitted.append(fractions[0])
        left = behind * BEHIND * max(best, 1.0) * samples
        return SimpleNamespace(x=start, chi2=left, r=np.empty(samples))

    monkeypatch.setattr(module, "fit", fit)
    monkeypatch.setattr(module, "mean_square", lambda rival, share: best)
    search: Any = object.__new__(Search)
    search.subject, search.least, search.parts = None, {}, {}
    parent: Any = SimpleNamespace(longer=None)
    rival: Any = SimpleNamespace(names=("a",), fitted=SimpleNamespace(chi2=1.0))
    made = search._near(rival, parent, None, np.zeros(2), (0.35, 1.0))
    assert (made is None) == (behind > 1.0)
    assert fitted == ([0.35] if made is None else [0.35, 1.0])
    fitted.clear()
    assert search._near(None, parent, None, np.zeros(2), (0.35, 1.0)) is not None
    assert fitted == [0.35, 1.0]


def test_sets_of_a_climb_must_come_near_the_best_so_far(monkeypatch):
    from backend.diagnose import climb as sets

    top, second = (SimpleNamespace(names=(n,), fitted=SimpleNamespace(fraction=0.5, pressed=False)) for n in "ab")
    climb: Any = object.__new__(sets.Climb)
    asked: list[Any] = []
    climb.baseline = top
    climb.search = SimpleNamespace(level=lambda parents, most, rival, place: asked.append((parents, rival)) or [])
    left = SimpleNamespace(excess=1.0, p=0.0)
    for name, says in {
        "_leaders": lambda level: level, "_judged": lambda cause: (cause, left), "_tell": lambda words: None,
        "_may_mislead": lambda cause: False, "enough": lambda judged: False, "_struck": lambda cause, judged: None,
        "_little": lambda *told: False, "_out_of_reach": lambda *told: False,
        "_place": lambda cause: None, "_narrowed": lambda best, found: (best, found),
        "_recombined": lambda best, found: (best, found),
    }.items():  # fmt: skip
        monkeypatch.setattr(climb, name, says, raising=False)
    top.candidates = second.candidates = ("a",)
    cancelled = iter([False] + [True] * 9)
    monkeypatch.setattr(climb, "_cancelled", lambda: next(cancelled))
    climb.smooth([top, second])
    assert asked == [([top, second], top)]


@pytest.mark.parametrize("followed", [True, False])
def test_a_set_that_falls_far_behind_on_its_way_is_not_followed_to_the_end(monkeypatch, followed):
    """Over the first half one leaves noise, one less than four times that, one more; over the whole all they like.
    Where no set follows the whole, those of the half are seen through.
    """
    samples, asked = 100, []
    left = {("near", 0.5): 0.9 * BEHIND, ("far", 0.5): 1.1 * BEHIND, ("near", 1.0): 9.0 * BEHIND}

    def end(choice: str, share: float) -> Any:
        chi2, miss = left.get((choice, share), 1.0) * samples, 0.0 if followed or share < 1.0 else growing.REACH
        return SimpleNamespace(choice=choice, x=None, fraction=share, chi2=chi2, r=np.empty(samples), miss=miss)

    def fit(subject, choice, start, fractions, max_iterations, ahead, coarse):
        asked.append((choice, *fractions, coarse))
        return end(choice, *fractions)

    monkeypatch.setattr(growing, "fit", fit)
    made = growing.stretched(None, [end(choice, 0.25) for choice in ("good", "near", "far")])
    share = 1.0 if followed else 0.5
    assert [(f.choice, f.fraction) for f in made] == [("good", share), ("near", share)]
    half = [("good", 0.5, True), ("near", 0.5, True), ("far", 0.5, True)]
    whole = [("good", 1.0, False), ("near", 1.0, False)]
    assert asked == half + whole + ([] if followed else [("good", 0.5, False), ("near", 0.5, False)])
