"""What a search for something that switches on begins with: sizes, and walls that rub where those tell the play."""

from typing import Any

import pytest

from backend.diagnose import switch
from backend.diagnose.candidate import Candidate
from backend.diagnose.library import LOAD, library
from tests.mechanisms import effect, fourbar

PLAY, RUBS = "clearance:j1.radial_m", "clearance:j1.friction_coefficient"


def named(name: str, family: str, effects: Any = ()) -> Candidate:
    return next(c for c in library(fourbar(effects), family).candidates if c.name == name)


def test_play_may_begin_with_walls_that_rub_as_hard_as_they_are_drawn():
    play = named("clearance:j1", "clearance")
    rough = switch.rubbing(play)
    assert rough is not None
    assert [p.name for p in rough.parameters] == [PLAY, RUBS]
    assert rough.sizes.tolist() == [True, False]
    assert rough.closer == play.closer


@pytest.mark.parametrize(
    ("name", "family"), [("joint_stop:j1.upper", "joint_stop"), ("pin_friction:j1", LOAD)], ids=["an end", "no wall"]
)
def test_what_has_no_wall_to_rub_on_begins_as_it_is(name, family):
    assert switch.rubbing(named(name, family)) is None


def test_a_friction_that_the_drawing_states_is_kept():
    drawn = effect("loose", "clearance", ["j1"], radial_m=1e-4, friction_coefficient=0.1)
    assert switch.rubbing(named("clearance:j1", "clearance", [drawn])) is None


@pytest.mark.parametrize(("rubbed", "begun"), [(50.0, [PLAY, RUBS]), (95.0, [PLAY])], ids=["tells", "tells little"])
def test_walls_rub_from_the_beginning_where_that_tells_the_play(monkeypatch, rubbed, begun):
    asked: list[dict[str, float]] = []

    def early(subject, candidates, values):
        asked.append(values)
        return rubbed if RUBS in values else 100.0 + abs(values[PLAY] - 3e-4)

    monkeypatch.setattr(switch, "_early", early)
    subject: Any = None
    cost, values, of = switch.promising(subject, named("clearance:j1", "clearance"), {})
    assert len(asked) == len(switch.FACTORS) + 1
    assert [p.name for p in of.parameters] == begun == list(values)
    assert cost == pytest.approx(min(rubbed, 100.0), abs=1.0) if RUBS in values else cost > rubbed
