"""Forms that contain simpler ones: tried where the simpler came out best, everywhere if that pays, and given back."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import closer as module
from backend.diagnose import run, same_motion, which
from backend.diagnose.closer import coming_up
from backend.diagnose.same_motion import elsewhere, of_its_shape
from backend.diagnose.which import Search


class Form(SimpleNamespace):
    __hash__ = object.__hash__


def form(kind: str, joint: str) -> Any:
    return Form(kind=kind, name=f"{kind}:{joint}")


def wide(kind: str, joint: str) -> Any:
    return Form(**vars(form(kind, joint)), tries=("some shape",))


def end(candidate: Any, chi2: float) -> Any:
    return SimpleNamespace(chi2=chi2, choice=SimpleNamespace(candidates=(candidate,)), in_longer_steps=False)


class Looking(Search):
    """A search whose fits end where a table says."""

    def __init__(self, ends: dict[str, float]):
        self.ends, self.order, self.begun = ends, [], []

    def _join(self, parent, about, candidate, fits, rival, simple=None):
        self.order.append(candidate.name)
        self.begun += [simple.choice.candidates[-1].name] if simple else []
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


def test_a_form_is_not_tried_beside_a_simpler_one_at_its_place(monkeypatch):
    dry, worn, elsewhere_ = form("coulomb", "j1"), wide("stribeck", "j1"), form("coulomb", "j2")
    for every in (dry, worn, elsewhere_):
        every.sought, every.places = False, ()
    search: Any = Looking({every.name: 100.0 for every in (dry, worn, elsewhere_)})
    search.forms = set()
    search.subject = SimpleNamespace(library=SimpleNamespace(candidates=[dry, worn, elsewhere_]))
    monkeypatch.setattr(search, "screen", lambda cause: SimpleNamespace(early=None, gain=lambda candidate: 1.0))
    monkeypatch.setattr(search, "promising", lambda about, plain, *how_many: plain)
    monkeypatch.setattr(search, "_leading", lambda joined: [])
    monkeypatch.setattr(which, "is_new", lambda candidate, cause: candidate.name not in cause.names)
    forms = {dry.name: [worn]}
    monkeypatch.setattr(which, "containing", lambda about, free: forms if worn in free else {})
    for names, tried in (
        ((), [dry.name, elsewhere_.name, worn.name]),
        ((worn.name,), [elsewhere_.name]),
        ((dry.name,), [elsewhere_.name]),
        ((elsewhere_.name,), [dry.name, worn.name]),
    ):
        search.order.clear()
        search.level([SimpleNamespace(names=names, candidates=names)], 8)
        assert search.order == tried


def test_a_simpler_form_is_tried_in_the_place_of_one_that_contains_it(monkeypatch):
    simple, wider, other = form("coulomb", "j1"), wide("stribeck", "j1"), wide("spring", "j1")
    rest: Any = SimpleNamespace(names=(other.name,))
    search: Any = Looking({simple.name: 1.0})
    search.tried = {(other.name,): rest}
    search.subject = SimpleNamespace(library=SimpleNamespace(candidates=[simple, form("coulomb", "j2"), wider, other]))
    monkeypatch.setattr(search, "screen", lambda cause: cause)
    monkeypatch.setattr(search, "without", lambda cause, member: SimpleNamespace(names=()))
    monkeypatch.setattr(which, "is_new", lambda candidate, cause: candidate.name not in cause.names)
    monkeypatch.setattr(
        which, "containing", lambda about, free: {simple.name: [wider], "coulomb:j2": [form("x", "j2")]}
    )
    monkeypatch.setattr(which, "in_order", lambda fitted: True)
    monkeypatch.setattr(search, "keep", lambda fitted: search.tried.setdefault((simple.name, other.name), fitted))
    made = search.simpler(SimpleNamespace(candidates=(wider, other)))
    assert search.order == [simple.name]
    assert [m.choice.candidates for m in made] == [(simple,)]


def test_a_form_that_contains_a_simpler_one_is_tried_wherever_it_may_act(monkeypatch):
    library = [shaped("stribeck", joint) for joint in ("j1", "j2", "j3", "j4")]
    other = form("spring", "j4")
    search: Any = Looking({})
    search.tried = {("spring:j4", "stribeck:j1"): None, ("spring:j4", "stribeck:j2"): None}
    search.cancelled, search.tell = lambda: False, lambda words: None
    search.subject = SimpleNamespace(
        library=SimpleNamespace(candidates=[*library, other]), choose=lambda *members: members
    )
    other.tries, other.overlaps = (), lambda c: False
    monkeypatch.setattr(same_motion, "beyond", lambda fitted, given: given)
    monkeypatch.setattr(
        same_motion, "of_its_shape", lambda fitted, about, member, c: None if c.name == "stribeck:j3" else {"x": 1}
    )
    monkeypatch.setattr(same_motion, "begun_from", lambda fitted, choice, values: values)
    monkeypatch.setattr(search, "fit_about", lambda parent, choice, *begun: SimpleNamespace(chi2=1.0, choice=choice))
    monkeypatch.setattr(same_motion, "in_order", lambda fitted: True)
    monkeypatch.setattr(search, "keep", lambda fitted: [c.name for c in fitted.choice])
    cause: Any = SimpleNamespace(candidates=(library[0], other), fitted=None)
    made = elsewhere(search, cause)
    assert made == [["spring:j4", "stribeck:j4"]]


def shaped(kind: str, joint: str) -> Any:
    return SimpleNamespace(
        **vars(form(kind, joint)), tries=((), (), (0.1,)), sizes=np.array([True, True, False]), sought=False,
        overlaps=lambda c: False,
    )  # fmt: skip


def test_a_form_moved_to_another_pin_keeps_its_shape_and_does_as_much_there():
    first, second = (of(joint) for joint in ("j1", "j2"))
    fitted: Any = SimpleNamespace(
        choice=SimpleNamespace(parameters=first.parameters, start=np.array([0.0, 0.0, 0.1])),
        values=np.array([0.4, 0.2, 3.0]),
    )
    slopes = {"j1": np.diag([1.0, 1.0, 0.0]), "j2": np.diag([2.0, 2.0, 0.0])}  # the second turns twice as far
    about: Any = SimpleNamespace(signature=lambda candidate: slopes[candidate.on[0]])
    assert of_its_shape(fitted, about, first, second) == {"j2.static": 0.2, "j2.sliding": 0.1, "j2.speed": 3.0}
    slopes["j2"] = -slopes["j2"]  # friction does not drive
    assert of_its_shape(fitted, about, first, second) is None


def of(joint: str) -> Any:
    names = ("static", "sliding", "speed")
    numbers = [SimpleNamespace(name=f"{joint}.{n}", parameter=n, start=0.0, lower=0.0, upper=10.0) for n in names]
    return SimpleNamespace(on=(joint,), parameters=tuple(numbers), sizes=np.array([True, True, False]))


def test_others_of_a_kind_are_as_free_in_their_shape_as_the_likeliest(monkeypatch):
    def rubs(joint: str, log_z: float, kind: str = "coulomb", fraction: float = 1.0) -> Any:
        fitted = SimpleNamespace(fraction=fraction)
        return SimpleNamespace(names=(f"{kind}:{joint}",), log_z=log_z, fitted=fitted, candidates=(form(kind, joint),))

    search: Any = Looking({})
    asked: list[str] = []
    monkeypatch.setattr(module, "closer", lambda search, cause: asked.append(cause.names[0]) or cause)
    leader, better = rubs("j1", 100.0), rubs("j1", 130.0)
    others = [
        leader, rubs("j2", 71.0), rubs("j3", 69.0), rubs("j4", 99.0, "viscous"), rubs("j5", 99.0),
        rubs("j6", 99.0, fraction=0.5),
    ]  # fmt: skip
    assert [c.names[0] for c in coming_up(search, leader, better, others)] == asked == ["coulomb:j5", "coulomb:j2"]
    assert coming_up(search, leader, leader, others) == []


@pytest.mark.parametrize(("left", "freed"), [(1.02, False), (1.5, True)])
def test_a_shape_is_freed_where_something_is_left_for_it(monkeypatch, left, freed):
    inquiry: Any = object.__new__(run._Inquiry)
    fitted = SimpleNamespace(fraction=1.0, chi2=left * 5000, r=np.zeros(5000))
    leader, better = (SimpleNamespace(names=("rub:j1",), log_z=z, fitted=fitted) for z in (5.0, 9.0))
    other = SimpleNamespace(names=("rub:j2",), log_z=4.0, fitted=fitted)
    inquiry.search = None
    monkeypatch.setattr(run, "closer", lambda search, cause: better)
    monkeypatch.setattr(run, "coming_up", lambda search, leader, better, causes: [])
    assert inquiry.shaped([other, leader]) == [other, better if freed else leader]
    assert inquiry.shaped([]) == []
