"""How sets of causes grow, are put together anew and are cut back."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose import climb as module
from backend.diagnose.climb import Climb


@pytest.mark.parametrize("fraction", [1.0, 0.5])
def test_a_pair_that_is_not_enough_has_its_shapes_free(monkeypatch, fraction):
    climb: Any = object.__new__(Climb)
    climb.search = None
    pair, shaped = SimpleNamespace(fitted=SimpleNamespace(fraction=fraction)), object()
    monkeypatch.setattr(module, "closer", lambda search, cause: shaped)
    monkeypatch.setattr(climb, "_judged", lambda cause: (cause, "judged"))
    assert climb._shaped(pair, "before") == ((shaped, "judged") if fraction == 1.0 else (pair, "before"))


def test_a_member_that_takes_little_off_fitted_and_held_out_experiments_is_not_named(monkeypatch):
    climb: Any = object.__new__(Climb)
    climb.scale, climb.large, little = 1.0, False, SimpleNamespace(power=1.0)
    held = {"abcd": 0.8, "abc": 1.0, "ab": 1.1, "ac": 1.2, "a": 1.1}
    fitted = {"abcd": 2.0, "abc": 2.0, "ab": 2.3, "ac": 2.35, "a": 4.0}
    made = {names: set_of(names, 100 * chi2) for names, chi2 in fitted.items()}
    climb.search = SimpleNamespace(tried={c.names: c for c in made.values()})
    climb.search.left = lambda cause, scale: SimpleNamespace(excess=held["".join(cause.names)])
    climb.searches = {id(made["ab"].fitted.subject): climb.search}
    monkeypatch.setattr(climb, "_by_fit", lambda cause: -cause.fitted.chi2)
    monkeypatch.setattr(climb, "_cancelled", lambda: False)
    monkeypatch.setattr(climb, "_tell", lambda words: None)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    monkeypatch.setattr(climb, "enough", lambda judged: False)
    assert climb.plain(made["ab"], little) == (made["ab"], little)  # of two a diagnosis may be sure
    assert not climb.large
    assert climb.plain(made["abc"], little) == (made["ab"], "judged")
    assert climb.large
    assert max(len(names) for names in climb.search.tried) == 2  # larger ones are withdrawn
    held |= {"ab": 1.5}
    made["ac"].fitted.chi2 = 250.0
    climb.search.tried = {c.names: c for c in made.values()}
    assert climb.plain(made["abc"], little) == (made["abc"], little)
    assert max(len(names) for names in climb.search.tried) == 3
    monkeypatch.setattr(climb, "enough", lambda judged: True)
    assert climb.plain(made["abc"], little) == (made["abc"], little)


def set_of(names: str, chi2: float) -> Any:
    fitted = SimpleNamespace(fraction=1.0, subject=1, chi2=chi2, r=SimpleNamespace(size=100))
    return SimpleNamespace(names=tuple(names), candidates=tuple(names), fitted=fitted)


def test_members_are_exchanged_as_long_as_that_is_worth_it_and_stays_in_one_model(monkeypatch):
    climb: Any = object.__new__(Climb)
    asked: list[str] = []
    cause = lambda name, subject: SimpleNamespace(  # noqa: E731
        names=(name,), candidates=(1, 2), fitted=SimpleNamespace(subject=subject)
    )
    first, second, stop = cause("first", 1), cause("second", 1), cause("stop", 2)
    climb.search = SimpleNamespace(exchange=lambda best: asked.append(best.names[0]), subject=1)
    likelier = {"first": second, "second": stop}
    monkeypatch.setattr(climb, "_most_probable", lambda best, worth: likelier[best.names[0]])
    monkeypatch.setattr(climb, "_judged", lambda cause: (cause, SimpleNamespace(excess=1.0)))
    monkeypatch.setattr(climb, "_cancelled", lambda: False)
    monkeypatch.setattr(climb, "_tell", lambda words: None)
    monkeypatch.setattr(climb, "enough", lambda judged: False)
    best, found = climb._exchanged(first, None)
    assert (best, found.excess, asked) == (second, 1.0, ["first", "second"])


@pytest.mark.parametrize(("power", "sought"), [(5.0, True), (50.0, False)])
def test_where_no_form_is_right_the_most_probable_set_is_the_answer(monkeypatch, power, sought):
    climb: Any = object.__new__(Climb)
    monkeypatch.setattr(climb, "enough", lambda judged: False)
    subject, left = object(), SimpleNamespace(excess=0.3)
    first, likelier, alias = (
        SimpleNamespace(names=(name,), candidates=(1,), fitted=SimpleNamespace(subject=subject, fraction=1.0))
        for name in "abc"
    )
    climb.at_base, climb.scale = SimpleNamespace(power=100.0), 1.0
    climb.search = SimpleNamespace(tried={first.names: first, likelier.names: likelier})
    monkeypatch.setattr(module, "complete", lambda search, best, scale: [alias] if scale == 2.0 else [])
    climb.searches = {id(subject): climb.search}
    monkeypatch.setattr(module, "scaled", lambda fitted, scale: fitted)
    monkeypatch.setattr(module, "softness", lambda fitted: 0.25)
    monkeypatch.setattr(climb, "_most_probable", lambda best, worth, size: likelier)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, left))
    monkeypatch.setattr(climb, "_tell", lambda words: None)
    assert climb.confirmed(first, SimpleNamespace(excess=1.7, power=power)) == (likelier, left)
    assert (alias.names in climb.search.tried) == sought  # what does the same, where most of the gap is gone


def test_a_set_that_is_found_so_ends_the_search_for_one(monkeypatch):
    climb, asked = growing_sets(monkeypatch, 1.0)
    found, enough = a_set("c+d"), SimpleNamespace(excess=0.0, p=1.0, noise=1.0)
    monkeypatch.setattr(climb, "_completed", lambda best, last: (found, enough))
    # Its members would be exchanged, in a real search.
    monkeypatch.setattr(climb, "_may_mislead", lambda cause: len(cause.candidates) > 1)
    assert climb.smooth([a_set("a")]) == (found, enough)
    assert len(asked) == 1


def test_what_is_likelier_in_longer_steps_is_seen_through_before_it_is_named(monkeypatch):
    rough, seen = (SimpleNamespace(names=("a",), fitted=of_steps(longer)) for longer in (True, False))
    climb: Any = object.__new__(Climb)
    climb.search = SimpleNamespace(tried={rough.names: rough})
    climb.searches = {id(SUBJECT): SimpleNamespace(seen_through=lambda cause: seen)}
    monkeypatch.setattr(climb, "_likeliest", lambda best, worth, size: climb.search.tried[rough.names])
    assert climb._most_probable(rough, 0.0) is seen


SUBJECT = object()


def of_steps(longer: bool) -> SimpleNamespace:
    return SimpleNamespace(in_longer_steps=longer, subject=SUBJECT)


@pytest.mark.parametrize(("followed", "asked_for"), [(1.0, ["a"]), (0.5, ["a", "a+b", "a+b+c"])])
def test_what_switches_on_is_asked_before_a_third_effect(monkeypatch, followed, asked_for):
    """Where a pair does not even follow the records a third may be what it lacks; nothing that switches on is seen."""
    climb, asked = growing_sets(monkeypatch, followed)
    best, left = climb.smooth([a_set("a", followed)])
    assert [parents[0].names for parents in asked] == [tuple(names.split("+")) for names in asked_for]
    if followed == 1.0:
        assert best.names == ("a", "b")
        asked.clear()
        best, _ = climb.larger(best, left, best, left)
        assert [parents[0].names for parents in asked] == [("a", "b"), ("a", "b", "c")]
    assert best.names == ("a", "b", "c", "d")


def test_what_switches_on_and_is_enough_asks_for_no_third(monkeypatch):
    climb, asked = growing_sets(monkeypatch, 1.0)
    pair, stop, left = a_set("a+b"), a_set("stop"), SimpleNamespace(excess=9.0, p=0.0, noise=1.0)
    enough = SimpleNamespace(excess=0.0, p=1.0, noise=1.0)
    assert climb.larger(stop, enough, pair, left) == (stop, enough)
    assert not asked
    monkeypatch.setattr(climb, "_accepted", lambda cause, best, judged, last: False)
    assert climb.larger(stop, left, pair, left) == (stop, left)  # sets of three were asked, and do not come up with it
    assert len(asked) == 2


@pytest.mark.parametrize(("alone", "freed"), [(118.0, ["tilt"]), (400.0, [])])
def test_what_is_nearly_enough_alone_is_asked_with_its_shape_free(monkeypatch, alone, freed):
    climb: Any = object.__new__(Climb)
    left = {"tilt": alone, "scale": 900.0, "scale+tilt": 100.0, "": 1100.0}

    def one(names: str) -> Any:
        made = a_set(names)
        made.fitted.chi2 = left[names]
        return made

    climb.baseline, asked = one(""), []
    climb.search = SimpleNamespace(
        without=lambda cause, member: one("".join(m for m in cause.candidates if m != member))
    )
    monkeypatch.setattr(climb, "_likelier_than", lambda best, found: (best, found), raising=False)
    monkeypatch.setattr(module, "closer", lambda search, cause: asked.append(*cause.names))
    climb._thinned(one("scale+tilt"), SimpleNamespace())
    assert asked == freed


def a_set(names: str, fraction: float = 1.0) -> Any:
    members = tuple(names.split("+"))
    return SimpleNamespace(
        names=members, candidates=members, fitted=SimpleNamespace(fraction=fraction, pressed=False, subject=None)
    )


def growing_sets(monkeypatch, fraction: float) -> tuple[Any, list[Any]]:
    """A climb in which each level finds one effect more, none of them enough, and the parents that it asked for."""
    climb: Any = object.__new__(Climb)
    asked: list[Any] = []
    left = SimpleNamespace(excess=9.0, p=0.0, noise=1.0)

    def level(parents, most, rival, place):
        asked.append(parents)
        return [a_set("+".join([*parents[0].names, "abcd"[len(parents[0].names)]]), fraction)]

    climb.baseline, climb.scale = a_set("", fraction), 1.0
    climb.search = SimpleNamespace(level=level, subject=None, look_again=lambda cause: None)
    for name, says in {
        "_leaders": lambda level: level, "_judged": lambda cause: (cause, left), "_tell": lambda words: None,
        "_may_mislead": lambda cause: False, "enough": lambda judged: judged.p > 0.5, "_cancelled": lambda: False,
        "_struck": lambda cause, judged: None, "_borne": lambda top, judged, depth: False, "_place": lambda cause: None,
        "_better": lambda *told: True, "_settled": lambda best, last: last.p > 0.5, "_accepted": lambda *told: True,
        **{name: lambda best, found, **told: (best, found)
           for name in ("_completed", "_likelier_than", "_shaped", "_thinned", "_narrowed", "_recombined")},
    }.items():  # fmt: skip
        monkeypatch.setattr(climb, name, says, raising=False)
    monkeypatch.setattr(module, "in_shape", lambda search, leaders: leaders)
    monkeypatch.setattr(module, "elsewhere", lambda search, best: [])
    return climb, asked
