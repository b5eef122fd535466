"""Forms that contain simpler ones: tried where the simpler came out best, and everywhere if that pays."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose.which import Search


def form(kind: str, joint: str) -> Any:
    return SimpleNamespace(kind=kind, name=f"{kind}:{joint}")


def end(candidate: Any, chi2: float) -> Any:
    return SimpleNamespace(chi2=chi2, choice=SimpleNamespace(candidates=(candidate,)))


class Looking(Search):
    """A search whose fits end where a table says."""

    def __init__(self, ends: dict[str, float]):
        self.ends, self.order, self.begun = ends, [], []

    def _join(self, parent, about, candidate, fits, rival, simple=None):
        self.order.append(candidate.name)
        self.begun.append(simple.choice.candidates[-1].name)
        fits.append(end(candidate, self.ends[candidate.name]))


@pytest.mark.parametrize(
    ("at_best", "tried"),
    [(60.0, ["stribeck:j6", "stribeck:j3", "stribeck:j1"]), (95.0, ["stribeck:j6"])],
)
def test_a_form_that_pays_where_the_simpler_was_best_is_tried_at_every_place(at_best: float, tried: list[str]):
    search: Any = Looking({"stribeck:j6": at_best, "stribeck:j3": 10.0, "stribeck:j1": 200.0})
    fits = [end(form("coulomb", joint), chi2) for joint, chi2 in (("j3", 120.0), ("j6", 100.0), ("j1", 300.0))]
    wider = {f"coulomb:{joint}": [form("stribeck", joint)] for joint in ("j1", "j3", "j6")}
    search._widen(None, None, wider, fits, None)
    assert search.order == tried
    assert search.begun == [name.replace("stribeck", "coulomb") for name in tried]  # where the simpler one ended
    assert min(fits, key=lambda f: f.chi2).chi2 == (10.0 if len(tried) > 1 else at_best)
