"""Beside which smooth causes one that switches on is tried."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from backend.diagnose.climb import Climb
from backend.diagnose.onset import Onset


def test_what_switches_on_is_tried_beside_the_likeliest_and_beside_each_member_of_the_best_pair(monkeypatch):
    climb: Any = object.__new__(Climb)
    monkeypatch.setattr(climb, "_takes_its_part", lambda cause: True)
    singles = {name: SimpleNamespace(names=(name,), fitted=SimpleNamespace(fraction=1.0)) for name in "abc"}
    singles["c"].fitted.fraction = 0.5
    climb.search = SimpleNamespace(tried={made.names: made for made in singles.values()})
    pair: Any = SimpleNamespace(candidates=tuple(SimpleNamespace(name=name) for name in "bc"))
    climb._onset = None
    assert climb._besides(pair, singles["a"], False, []) == [singles["a"], singles["b"]]
    assert climb._besides(pair, singles["b"], False, []) == [singles["b"]]
    assert climb._besides(SimpleNamespace(candidates=()), None, False, []) == []
    assert climb._besides(pair, singles["a"], True, []) == [singles["a"]]


@pytest.mark.parametrize(
    ("smooth", "play", "asked"), [(0.7, None, True), (0.9, None, False), (0.9, 0.7, True), (0.9, 0.95, False)]
)
def test_neither_is_the_larger_of_two_effects_where_none_takes_much_off(smooth, play, asked):
    climb: Any = object.__new__(Climb)

    def leaving(share, name):
        r = SimpleNamespace(size=1000)
        return SimpleNamespace(names=(name,), fitted=SimpleNamespace(fraction=1.0, chi2=1000.0 + 5e4 * share, r=r))

    climb.baseline, climb._onset = leaving(1.0, "drawn"), None
    likeliest, best = leaving(smooth, "smooth"), SimpleNamespace(candidates=())
    made = [] if play is None else [leaving(play, "play")]
    assert climb._besides(best, likeliest, False, made) == [likeliest] * asked


def test_what_is_enough_until_something_switches_on_is_a_partner_first(monkeypatch):
    climb: Any = object.__new__(Climb)
    monkeypatch.setattr(climb, "_takes_its_part", lambda cause: True)
    first, same, other = (SimpleNamespace(names=(n,), candidates=(1,), fitted=SimpleNamespace(fraction=f))
                          for n, f in (("a", 0.1), ("a", 1.0), ("b", 1.0)))  # fmt: skip
    climb.search = SimpleNamespace(tried={})
    climb._onset = Onset(0.1, cast(Any, first))
    best: Any = SimpleNamespace(candidates=(SimpleNamespace(name="c"),))
    assert climb._besides(best, other, False, []) == [first, other]
    assert climb._besides(best, same, False, []) == [first]  # not from where whole records led it
    assert climb._besides(best, None, True, []) == [first]  # beside an end of travel that is not enough alone
    climb._onset = Onset(0.1, cast(Any, SimpleNamespace(candidates=())))
    assert climb._besides(best, None, True, []) == []
