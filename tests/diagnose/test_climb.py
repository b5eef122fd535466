"""When a climb that has a smooth explanation goes on to what switches on."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from backend.diagnose import beyond_smooth as module
from backend.diagnose import closer as nearest
from backend.diagnose.climb import Climb
from backend.diagnose.onset import MOVED, Onset
from backend.diagnose.which import Search


class Asked(Exception):
    """Raised with the families that would be tried."""


def climbing(monkeypatch, *, enough: bool, refused: bool) -> Any:
    climb: Any = object.__new__(Climb)
    climb.without, climb.after_blows = frozenset(), np.inf
    monkeypatch.setattr(climb, "enough", lambda judged: enough, raising=False)
    monkeypatch.setattr(climb, "refused", lambda cause: refused, raising=False)
    monkeypatch.setattr(climb, "_little", lambda cause, judged, depth: False)
    monkeypatch.setattr(climb, "_tell", lambda text: None)
    monkeypatch.setattr(climb, "_tuned", lambda best, last: (best, last))
    monkeypatch.setattr(climb, "_or_play", lambda best, last: (best, last))
    monkeypatch.setattr(climb, "confirmed", lambda best, last: (best, last))
    monkeypatch.setattr(module, "families", lambda without: {module.SMOOTH, module.LOAD, "joint_stop", "clearance"})

    def stop(cause, last, refused, lost):
        raise Asked(asked_of(climb, cause, last, refused, lost))

    asked_of = Climb._asked_of
    monkeypatch.setattr(climb, "_asked_of", stop)
    return climb


def smooth_cause(fraction: float) -> Any:
    return SimpleNamespace(
        names=("camera_tilt:camera",),
        candidates=(SimpleNamespace(family=module.SMOOTH, kind="camera_tilt", places=("camera",)),),
        fitted=SimpleNamespace(fraction=fraction, r=SimpleNamespace(size=100)),
    )


@pytest.mark.parametrize(("fraction", "refused"), [(0.25, False), (1.0, True), (0.25, True)])
def test_a_cause_that_follows_part_of_the_records_or_is_refused_leads_on_to_every_family(
    monkeypatch, fraction, refused
):
    climb = climbing(monkeypatch, enough=True, refused=refused)
    with pytest.raises(Asked) as asked:
        climb.switching(smooth_cause(fraction), SimpleNamespace(excess=0.0, power=0.0))
    all_was_well = fraction < 1.0  # as far as it went
    stops_first = ["joint_stop", module.LOAD, "clearance"]
    assert asked.value.args[0] == (stops_first if all_was_well else [module.LOAD, "clearance", "joint_stop"])


@pytest.mark.parametrize("at", ["marker:a", "camera"])
def test_what_is_left_in_the_picture_asks_for_play_and_bending_even_where_held_out_experiments_refuse(monkeypatch, at):
    climb = climbing(monkeypatch, enough=False, refused=True)
    every = {module.SMOOTH, module.LOAD, "joint_stop", "clearance", "link_flexibility"}
    monkeypatch.setattr(module, "families", lambda without: every)
    monkeypatch.setattr(module, "place_evidence", lambda fitted, latent, scale: {at: 0.0, "joint:j1": -60.0})
    climb.search, climb.scale = SimpleNamespace(latent=None), 1.0
    with pytest.raises(Asked) as found:
        climb.switching(smooth_cause(1.0), SimpleNamespace(excess=0.015, power=1.0))
    assert found.value.args[0] == ["clearance", "link_flexibility"]


def test_a_cause_that_explains_whole_records_is_the_answer(monkeypatch):
    climb = climbing(monkeypatch, enough=True, refused=False)
    best, last = smooth_cause(1.0), SimpleNamespace(excess=0.0)
    assert climb.switching(best, last) == (best, last)


@pytest.mark.parametrize("settled", [True, False])
def test_what_does_the_same_as_a_refused_cause_is_asked_before_what_switches_on(monkeypatch, settled):
    climb = climbing(monkeypatch, enough=True, refused=True)
    best, other, last = smooth_cause(1.0), smooth_cause(1.0), SimpleNamespace(excess=0.0, power=0.0)
    monkeypatch.setattr(climb, "confirmed", lambda best, last: (other, last))
    monkeypatch.setattr(climb, "_settled", lambda cause, judged: settled and cause is other)
    if settled:
        assert climb.switching(best, last) == (other, last)
    else:
        with pytest.raises(Asked):
            climb.switching(best, last)


def stop_at(pin: str, log_z: float, kind: str = "joint_stop") -> Any:
    member = SimpleNamespace(kind=kind)
    return SimpleNamespace(
        names=(f"{kind}:{pin}",), candidates=(member,), log_z=log_z, fitted=SimpleNamespace(fraction=1.0)
    )


def test_all_pins_that_came_near_are_fitted_with_blows_as_they_come(monkeypatch):
    """The first pin came out best with dead blows; with blows that give back, another does."""
    climb: Any = object.__new__(Climb)
    drawn = [stop_at("j1", 0.0), stop_at("j2", -3.0), stop_at("j3", -50.0), stop_at("j1", -2.0, "clearance")]
    with_blows = {"joint_stop:j1": 20.0, "joint_stop:j2": 30.0, "joint_stop:j3": 90.0}
    tried = {cause.names: cause for cause in drawn}

    def closer(search, cause):
        found = stop_at(cause.names[0].partition(":")[2], with_blows[cause.names[0]])
        tried[found.names] = found
        return found

    search: Any = object.__new__(Search)
    search.tried = tried
    monkeypatch.setattr(module, "closer", closer)
    monkeypatch.setattr(nearest, "closer", closer)
    climb.search = SimpleNamespace(tried={})
    monkeypatch.setattr(climb, "_weight", lambda cause: cause.log_z)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    monkeypatch.setattr(module, "stopping_alike", lambda search, cause: [])
    monkeypatch.setattr(climb, "enough", lambda judged: True)
    assert climb._closer(drawn[0], "before", search) == (drawn[0], "before")  # dead blows are enough
    monkeypatch.setattr(climb, "enough", lambda judged: False)
    best, judged = climb._closer(drawn[0], "before", search)
    assert (best.names, best.log_z, judged) == (("joint_stop:j2",), 30.0, "judged")
    assert set(climb.search.tried) == {("joint_stop:j1",), ("joint_stop:j2",)}  # the third was too far behind


@pytest.mark.parametrize(("alone", "named"), [(40.0, ("joint_stop:j1",)), (10.0, ("joint_stop:j1", "mass:arm"))])
def test_walls_as_they_come_may_need_nothing_beside_them(monkeypatch, alone, named):
    """Beside walls that keep nothing of a blow a mass was needed, which took the place of what they give back."""
    climb: Any = object.__new__(Climb)

    def pair(log_z: float) -> Any:
        members = (SimpleNamespace(family="joint_stop"), SimpleNamespace(family=module.SMOOTH))
        return SimpleNamespace(names=("joint_stop:j1", "mass:arm"), candidates=members, log_z=log_z)

    hard, soft, given_up = pair(0.0), pair(30.0), []
    search: Any = SimpleNamespace(tried={hard.names: hard})
    search.without = lambda cause, member: given_up.append(member.family) or stop_at("j1", alone)
    climb.search = SimpleNamespace(tried={})
    for name in ("_weight", "_by_fit"):
        monkeypatch.setattr(climb, name, lambda cause: cause.log_z, raising=False)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    monkeypatch.setattr(climb, "enough", lambda judged: False)
    monkeypatch.setattr(module, "closer", lambda search, cause: soft)
    monkeypatch.setattr(module, "coming_up", lambda search, leader, better, others: [])
    monkeypatch.setattr(module, "stopping_alike", lambda search, cause: [])
    best, _ = climb._closer(hard, "before", search)
    assert best.names == named
    assert given_up == [module.SMOOTH]


@pytest.mark.parametrize("passed", [0.9, 1.1])
def test_a_beginning_in_which_little_moved_says_nothing(monkeypatch, passed):
    climb: Any = object.__new__(Climb)
    climb.search, climb.scale, climb.baseline = None, 1.0, SimpleNamespace(fitted=None)
    found = Onset(0.1, cast(Any, None))
    monkeypatch.setattr(module, "onset", lambda search, scale: found)
    monkeypatch.setattr(module, "moved", lambda fitted, share: passed * MOVED)
    assert climb._onset == (found if passed > 1.0 else None)


@pytest.mark.parametrize(
    ("excess", "name", "harm", "power", "sought", "named"),
    [
        (1e3, "b", 9.0, 2.0, True, True),
        (1e3, "b", 9.0, 3.0, True, False),
        (1e3, "b", 2.0, 2.0, False, False),
        (1e3, "a", 1.0, 2.0, True, True),
        (9.0, "b", 9.0, 2.0, True, True),
        (9.0, "a", 9.0, 2.0, False, False),
        (3.0, "b", 9.0, 2.0, False, False),
    ],
    ids=[
        "harms a beginning",
        "is coarse",
        "harms none",
        "is the one",
        "leaves less",
        "leaves no more",
        "leaves little",
    ],
)
def test_an_end_of_travel_is_sought_first_where_something_came_later(
    monkeypatch, excess, name, harm, power, sought, named
):
    climb = climbing(monkeypatch, enough=False, refused=False)
    first, top, struck = (SimpleNamespace(names=(n,), candidates=(1,), fitted=None) for n in ("a", name, "stop"))
    climb._onset, climb.scale, climb.baseline, climb.searches = Onset(0.1, cast(Any, first)), 1.0, top, {}
    climb.search, beside, left = SimpleNamespace(tried={}), [], SimpleNamespace(power=power)
    climb.met, climb.struck, climb.after_blows = {}, set(), np.inf
    climb.at_base = SimpleNamespace(power=1e3)
    monkeypatch.setattr(module, "mean_square", lambda fitted, share: harm)
    monkeypatch.setattr(module, "let_go", lambda fitted: {})
    monkeypatch.setattr(module, "switching", lambda *asked: beside.append(asked[-1]) or [struck])
    monkeypatch.setattr(climb, "_cancelled", lambda: False)
    monkeypatch.setattr(climb, "_search_of", lambda family: SimpleNamespace(subject=None))
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, left))
    monkeypatch.setattr(climb, "_closer", lambda best, last, search: (best, last))
    monkeypatch.setattr(climb, "_settled", lambda best, last: True)
    assert climb._struck(top, SimpleNamespace(excess=excess)) == ((struck, left) if named else None)
    assert set(climb.search.tried) == ({struck.names} if named else set())  # smooth sets cannot go on from another's
    assert beside == ([first] if sought else [])
    assert climb.after_blows == (power if sought else np.inf)


@pytest.mark.parametrize(
    ("left", "asked"),
    [(2.0, [module.LOAD, "clearance", "joint_stop"]), (9.0, ["joint_stop", module.LOAD, "clearance"])],
)
def test_ends_of_travel_that_were_met_and_leave_less_than_smooth_pairs_come_first(monkeypatch, left, asked):
    climb = climbing(monkeypatch, enough=False, refused=False)
    climb.search, climb.scale, climb.after_blows = SimpleNamespace(latent=None), 1.0, 5.0
    monkeypatch.setattr(module, "place_evidence", lambda fitted, latent, scale: {"joint:j1": 0.0})
    last = SimpleNamespace(excess=99.0, power=left)
    assert Climb._asked_of(climb, smooth_cause(1.0), cast(Any, last), False, False) == asked


def test_what_was_sought_before_smooth_pairs_is_not_sought_again(monkeypatch):
    """Of these the likeliest is first, with its walls as they came since; beside another cause it is sought anew."""
    climb: Any = object.__new__(Climb)
    climb.struck, climb.baseline = {("joint_stop", ("length_error:crank",))}, None
    stop = SimpleNamespace(name="joint_stop:j1", family="joint_stop")
    length = SimpleNamespace(name="length_error:crank", family=module.SMOOTH)
    hard, soft, alone = (
        SimpleNamespace(candidates=members, log_z=z)
        for members, z in (((length, stop), 1.0), ((length, stop), 3.0), ((stop,), 9.0))
    )
    search: Any = SimpleNamespace(tried={("a",): hard, ("b",): soft, ("c",): alone})
    monkeypatch.setattr(module, "switching", lambda *asked: [asked[-1]])
    best: Any = None
    beside, other = (cast(Any, SimpleNamespace(names=(f"length_error:{bar}",))) for bar in ("crank", "rod"))
    assert climb._switching(search, "joint_stop", {}, best, beside) == [soft, hard]
    assert climb._switching(search, "joint_stop", {}, best, other) == [other]
    assert climb._switching(search, "joint_stop", {}, best) == [None]


@pytest.mark.parametrize(("gain", "asked"), [(150.0, ["clearance"]), (250.0, []), (0.0, [])])
def test_play_is_asked_of_a_faint_gap_that_something_smooth_explains(monkeypatch, gain, asked):
    climb: Any = object.__new__(Climb)
    climb.without, climb.scale, climb.searches = frozenset(), 1.0, {}
    climb.baseline = SimpleNamespace(fitted=SimpleNamespace(chi2=1000.0))
    found: list[str] = []
    play = SimpleNamespace(names=("clearance:j1",))
    search = climb.search = SimpleNamespace(subject=None, tried={}, followed=1.0)
    monkeypatch.setattr(module, "switching", lambda search, baseline, family, motion, best, taken: [play])
    monkeypatch.setattr(climb, "_cancelled", lambda: False)
    monkeypatch.setattr(climb, "_search_of", lambda family: found.append(family) or search)
    monkeypatch.setattr(climb, "_likelier", lambda cause, best: True)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    monkeypatch.setattr(module, "families", lambda without: {module.SMOOTH, "clearance", "joint_stop"})
    best: Any = SimpleNamespace(candidates=(None,), fitted=SimpleNamespace(chi2=1000.0 - gain))
    assert climb._or_play(best, "enough") == ((play, "judged") if asked else (best, "enough"))
    assert found == asked
    assert list(search.tried) == [play.names] * len(asked)
    search.followed = 0.5  # then sums of squares are of unequal records
    assert climb._or_play(best, "enough") == (best, "enough")


@pytest.mark.parametrize(("other", "beside"), [((), None), (("length_error",), "length_error:arm")])
def test_dry_friction_is_tried_as_one_that_grows_with_load_too(monkeypatch, other, beside):
    """Alone, and beside what stands beside it; what is likelier is the answer."""
    member = lambda kind: SimpleNamespace(kind=kind, name=f"{kind}:arm", family=module.SMOOTH)  # noqa: E731
    made = lambda *kinds: SimpleNamespace(names=kinds, candidates=tuple(map(member, kinds)))  # noqa: E731
    climb: Any = object.__new__(Climb)
    climb.without, climb.searches, climb.search, climb.baseline = frozenset(), {}, SimpleNamespace(tried={}), None
    loaded, poor, tried = made(*other, "pin_friction"), made("poor"), []

    def switching(search, baseline, family, motion, rival, beside):
        tried.append((family, beside and beside.names[0]))
        return [loaded, poor]

    search = SimpleNamespace(subject=object())
    monkeypatch.setattr(module, "switching", switching)
    monkeypatch.setattr(climb, "_search_of", lambda family: search)
    monkeypatch.setattr(climb, "_single", lambda best, member: SimpleNamespace(names=(member.name,)))
    monkeypatch.setattr(climb, "_cancelled", lambda: False, raising=False)
    monkeypatch.setattr(climb, "_likelier", lambda cause, best: cause is loaded)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    monkeypatch.setattr(climb, "_faint", lambda best: ())
    assert climb._or_load(made(*other, "coulomb_friction"), "last") == (loaded, "judged")
    asked = [(module.LOAD, beside), (module.LOAD, None)][: 2 if beside else 1]
    assert tried == asked
    assert set(climb.search.tried) == {loaded.names, poor.names}
    smooth = made("viscous_friction")
    assert climb._or_load(smooth, "last") == (smooth, "last")
    assert tried == asked


def test_friction_that_grows_with_load_is_tried_alone_where_constant_friction_needed_another_beside_it(monkeypatch):
    """What stood beside the wrong kind of friction may have made up for it."""
    climb: Any = object.__new__(Climb)
    dry, other = SimpleNamespace(kind="coulomb_friction"), SimpleNamespace(kind="effort_offset")
    subject = object()
    pair = SimpleNamespace(candidates=(dry, other))
    offset = SimpleNamespace(names=("effort_offset:j1",))
    alone = SimpleNamespace(names=("pin_friction:j1",), worth=9.0)
    both = SimpleNamespace(names=("effort_offset:j1", "pin_friction:j1"), worth=5.0)
    monkeypatch.setattr(module, "rubs_dry", lambda kind: kind == "coulomb_friction")
    monkeypatch.setattr(
        module, "switching",
        lambda search, baseline, family, motion, rival, beside: [alone if beside is None else both],
    )  # fmt: skip
    climb.without, climb.searches, climb.baseline, pair.worth = frozenset(), {}, None, 1.0
    climb.search = SimpleNamespace(tried={}, cancelled=lambda: False)
    monkeypatch.setattr(climb, "_single", lambda best, rest: offset)
    monkeypatch.setattr(climb, "_search_of", lambda family: SimpleNamespace(subject=subject))
    monkeypatch.setattr(climb, "_likelier", lambda cause, best: cause.worth > best.worth)
    monkeypatch.setattr(climb, "_judged", lambda cause, search: (cause, "judged"))
    assert climb._or_load(pair, "before") == (alone, "judged")
    assert set(climb.search.tried) == {alone.names, both.names}


def test_a_stop_is_tried_beside_the_single_causes_that_held_out_experiments_bear_out(monkeypatch):
    climb: Any = object.__new__(Climb)
    leaves = {"clock": 0.02, "shutter": 0.05, "scale": 0.08, "base": 0.6, "late": 0.01, "stop": 0.01}
    tried: dict[tuple[str, ...], Any] = {
        (name,): SimpleNamespace(
            names=(name,),
            candidates=(name,),
            fitted=SimpleNamespace(fraction=0.5 if name == "late" else 1.0, subject=None if name == "stop" else 1),
        )
        for name in sorted(leaves)
    }
    tried[("base", "clock")] = SimpleNamespace(names=("base", "clock"), candidates=(1, 2), fitted=tried["base",].fitted)
    left = lambda cause, scale: SimpleNamespace(excess=leaves[cause.names[0]])  # noqa: E731
    climb.search, climb.scale = SimpleNamespace(tried=tried, left=left, subject=1), 1.0
    monkeypatch.setattr(climb, "refused", lambda cause: leaves[cause.names[0]] > 0.5, raising=False)
    assert [c.names for c in climb._borne_out([])] == [("clock",), ("shutter",)]
    assert [c.names for c in climb._borne_out([tried["clock",]])] == [("shutter",)]


def test_a_single_cause_of_another_model_is_no_partner_of_smooth_ones(monkeypatch):
    climb: Any = object.__new__(Climb)
    spring, stop = (
        SimpleNamespace(candidates=(name,), log_z=log_z, fitted=SimpleNamespace(fraction=1.0, subject=subject))
        for name, log_z, subject in (("spring", -90.0, 1), ("stop", -10.0, 2))
    )
    climb.search = SimpleNamespace(tried={("spring",): spring, ("stop",): stop}, subject=1)
    monkeypatch.setattr(climb, "_by_fit", lambda cause: cause.log_z)
    assert climb._best_alone() is spring
