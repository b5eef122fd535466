"""What is asked although what is there is enough: one more effect, and play where a pair may imitate it."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose import beyond_smooth, which
from backend.diagnose.climb import HINT, Climb
from backend.diagnose.standards import STRICT
from backend.diagnose.which import Search

ROWS = 1000


def cause(*names: str, chi2: float = ROWS, fraction: float = 1.0) -> Any:
    fitted = SimpleNamespace(chi2=chi2, fraction=fraction, r=SimpleNamespace(size=ROWS))
    members = tuple(SimpleNamespace(name=n, places=(n.partition(":")[2],)) for n in names)
    return SimpleNamespace(names=names, candidates=members, fitted=fitted)


@pytest.mark.parametrize(
    ("p", "held_out", "directed", "fraction", "hinted"),
    [
        (0.5 * HINT, None, 0.5 * STRICT, 1.0, True),
        (0.5 * HINT, None, 2.0 * STRICT, 1.0, False),
        (2.0 * HINT, 0.5 * HINT, 0.5 * STRICT, 1.0, True),
        (2.0 * HINT, 2.0 * HINT, 0.5 * STRICT, 1.0, False),
        (0.5 * HINT, None, 0.5 * STRICT, 0.5, False),
    ],
    ids=["in one of the library", "in none of it", "held-out experiments say so", "nothing says so", "not followed"],
)
def test_one_more_effect_is_asked_where_what_is_left_points_at_one(p, held_out, directed, fraction, hinted):
    climb: Any = object.__new__(Climb)
    about = SimpleNamespace(rescaled=lambda scale: SimpleNamespace(p_value=lambda free, rng: directed))
    climb.scale, climb.rng, climb.tolerance_m = 1.0, None, None
    climb.search = SimpleNamespace(
        left=lambda c, scale: None if held_out is None else SimpleNamespace(p=held_out),
        screen=lambda c: about, subject=SimpleNamespace(library=SimpleNamespace(candidates=())),
    )  # fmt: skip
    assert climb._hinted(cause("viscous_friction:j1", fraction=fraction), SimpleNamespace(p=p)) == hinted


@pytest.mark.parametrize(
    ("names", "gain", "found"),
    [
        (("length_error:rod", "frame_rate_error:camera"), 0.5 * ROWS, ("clearance:j2", "camera_scale:camera")),
        (("length_error:rod", "frame_rate_error:camera"), 2.0 * ROWS, None),
        (("length_error:rod", "mass_error:crank"), 0.5 * ROWS, None),
        (("length_error:rod",), 0.5 * beyond_smooth.FAINT, ("clearance:j2",)),
        (("length_error:rod",), 2.0 * beyond_smooth.FAINT, None),
    ],
    ids=["a pair", "far beyond the noise", "not in the picture", "one", "one that is not faint"],
)
def test_play_is_asked_where_what_is_enough_may_imitate_it(monkeypatch, names, gain, found):
    climb: Any = object.__new__(Climb)
    alone = cause(names[0], chi2=ROWS + (gain if len(names) > 1 else 0.0))
    best, play = cause(*names), cause("clearance:j2", chi2=1.3 * ROWS if len(names) > 1 else 0.9 * ROWS)
    pair = cause("clearance:j2", "camera_scale:camera", chi2=0.9 * ROWS)
    climb.scale, climb.without, climb.searches = 1.0, frozenset(), {}
    climb.baseline = cause(chi2=ROWS + gain)
    subject = SimpleNamespace()
    for c in (alone, best, play, pair):
        c.fitted.subject = subject
    climb.search = SimpleNamespace(followed=1.0, tried={alone.names: alone}, cancelled=lambda: False, subject=subject)
    other = cause("clearance:j1", chi2=0.95 * play.fitted.chi2)  # alone it leaves less than the right pin does
    beside: dict[str, list[Any]] = {"clearance:j2": [pair], "clearance:j1": []}
    climb._search_of = lambda family: SimpleNamespace(
        subject=subject, level=lambda parents, refits: beside[parents[0].names[0]],
        promised=lambda c: 0.9 if c is play else 1.2,
    )  # fmt: skip
    climb._by_fit = climb._weight = lambda c: -c.fitted.chi2
    climb._judged = lambda c, search=None: (c, "judged")
    monkeypatch.setattr(beyond_smooth, "switching", lambda *args, **kwargs: [other, play] if len(names) > 1 else [play])
    assert climb._or_play(best, "as it was") == (
        (best, "as it was") if found is None else (climb.search.tried[found], "judged")
    )


@pytest.mark.parametrize(
    ("names", "gain", "asked"),
    [
        (("viscous_friction:j1",), 0.5 * ROWS, True),
        (("viscous_friction:j1",), 2.0 * ROWS, False),
        (("coulomb_friction:j1",), 2.0 * ROWS, True),
        (("frame_rate_error:camera",), 0.5 * ROWS, False),
        (("viscous_friction:j1", "mass_error:rod"), 0.5 * ROWS, False),
    ],
    ids=["less than noise", "more than noise", "dry friction", "in the picture", "a pair"],
)
def test_friction_that_grows_with_load_is_asked_where_another_law_may_look_like_it(monkeypatch, names, gain, asked):
    climb: Any = object.__new__(Climb)
    best, grown = cause(*names), cause("pin_friction:j1", chi2=0.9 * ROWS)
    for c in best.candidates:
        c.kind = c.name.partition(":")[0]
    climb.scale, climb.without, climb.searches, climb.baseline = 1.0, frozenset(), {}, cause(chi2=ROWS + gain)
    climb.search = SimpleNamespace(tried={}, cancelled=lambda: False)
    climb._best_alone = lambda: None
    climb._search_of = lambda family: SimpleNamespace(subject=None)
    climb._by_fit = climb._weight = lambda c: -c.fitted.chi2
    climb._judged = lambda c, search=None: (c, "judged")
    monkeypatch.setattr(beyond_smooth, "switching", lambda *args: [grown])
    assert climb._or_load(best, "as it was") == ((grown, "judged") if asked else (best, "as it was"))


@pytest.mark.parametrize(
    ("names", "left", "nothing"),
    [
        (("effort_offset:a", "torsion_spring:b"), 0.5 * beyond_smooth.CLOSELY**2, True),
        (("effort_offset:a", "torsion_spring:b"), 2.0 * beyond_smooth.CLOSELY**2, False),
        (("effort_offset:a",), 0.5 * beyond_smooth.CLOSELY**2, False),
    ],
)
def test_what_switches_on_is_not_asked_beside_a_pair_that_leaves_next_to_nothing(names, left, nothing):
    climb: Any = object.__new__(Climb)
    climb.scale, climb.baseline = 1.0, cause(chi2=9.0 * ROWS)
    climb._best_alone = lambda: cause(names[0], chi2=2.0 * ROWS)
    assert climb._nothing_of(cause(*names), SimpleNamespace(power=left)) == nothing


@pytest.mark.parametrize(
    ("beside", "left", "joined"),
    [
        ("marker_offset:rod_m1", 0.8, True),
        ("length_error:rod", 0.8, False),
        ("length_error:rod", 0.4, True),
    ],
    ids=["of a marker", "what a blow may do", "most of it"],
)
def test_what_the_law_of_a_blow_excuses_hides_no_marker(beside, left, joined):
    climb: Any = object.__new__(Climb)
    stop, pair = cause("joint_stop:j1"), cause("joint_stop:j1", beside)
    for c in (*stop.candidates, *pair.candidates):
        kind, _, at = c.name.partition(":")
        c.places = (f"{'marker' if kind == 'marker_offset' else 'body'}:{at}",)
        c.overlaps = lambda other, own=c: own.name == other.name
    climb.search = SimpleNamespace(cancelled=lambda: False, tried={})
    climb._settled, climb.enough = lambda cause, judged: True, lambda judged: False
    climb._judged = lambda c, search=None: (c, SimpleNamespace(power=left))
    climb._better = lambda *asked: True
    search: Any = SimpleNamespace(level=lambda parents, refits: [pair], tried={})
    assert (climb._joined(stop, SimpleNamespace(power=1.0), search)[0] is pair) == joined


def test_a_form_that_contains_a_member_is_asked_where_the_pair_ended(monkeypatch):
    dry, falling, shake = (SimpleNamespace(name=n) for n in ("coulomb_friction:j1", "stribeck_friction:j1", "base"))
    search: Any = object.__new__(Search)
    search.tried = {("base",): "the base alone", ("coulomb_friction:j1",): "friction alone"}
    search.subject = SimpleNamespace(
        library=SimpleNamespace(candidates=(dry, falling, shake)), choose=lambda *members: [m.name for m in members]
    )
    search.screen = search.keep = search._finished = lambda one: one
    search._join = lambda rest, about, wide, fits, rival, simple: fits.append((rest, wide.name, simple))
    monkeypatch.setattr(which, "is_new", lambda candidate, rest: candidate is not shake)
    monkeypatch.setattr(which, "containing", lambda about, free: {dry.name: [falling]})
    monkeypatch.setattr(which, "begun_from", lambda fitted, choice: "where the pair ended")
    monkeypatch.setattr(which, "fit", lambda subject, choice, start, max_iterations: (choice, start))
    monkeypatch.setattr(which, "in_order", lambda fitted: True)
    pair: Any = SimpleNamespace(candidates=(dry, shake), fitted=None)
    begun = (["base", "coulomb_friction:j1"], "where the pair ended")
    assert search.wider(pair) == [("the base alone", "stribeck_friction:j1", begun)]
