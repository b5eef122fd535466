"""What switches on, looked for about a motion that a cause follows to within the noise."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import joining as module
from backend.diagnose.joining import follows, joining

ROWS = 400
RNG = np.random.default_rng(3)
FRICTION, PLAY, OTHER = np.linalg.qr(RNG.standard_normal((ROWS, 3)))[0].T  # what each does to the rows, by its size


def play(name: str, family: str = "clearance") -> Any:
    return SimpleNamespace(name=name, family=family)


@pytest.fixture
def world(monkeypatch):
    """Rows that a play of 30 at j1 makes, which a friction of the wrong size has made up for in part."""
    missed = 30.0 * PLAY + 40.0 * FRICTION
    does = {"clearance:j1": PLAY + 2.0 * FRICTION, "clearance:j2": OTHER}
    parent: Any = SimpleNamespace(
        names=("viscous_friction:j1",),
        fitted=SimpleNamespace(
            r=missed - FRICTION * (FRICTION @ missed),
            free=FRICTION[:, None],
            precision=np.array([1e-6]),
            fraction=1.0,
            chi2=900.0,
        ),
    )
    library = SimpleNamespace(candidates=[play("clearance:j2"), play("clearance:j1"), play("joint_stop:j1", "stop")])
    subject = SimpleNamespace(
        library=library, fit=[], choose=lambda *members: SimpleNamespace(candidates=members), chosen=lambda p, c: p
    )

    def seer(subject, probes):
        return SimpleNamespace(left=lambda start: parent.fitted.r - start)

    def begun_from(fitted, choice, values):
        return values["size"] * does[choice.candidates[-1].name]

    def fit(subject, choice, start):
        return SimpleNamespace(choice=choice, x=start, chi2=1.0, r=np.zeros(ROWS), fraction=1.0)

    for name, fake in (("Seer", seer), ("begun_from", begun_from), ("fit", fit)):
        monkeypatch.setattr(module, name, fake)
    monkeypatch.setattr(module, "openings", lambda subject, candidate, motion, shares: [{"size": 10.0}, {"size": 20.0}])
    monkeypatch.setattr(module, "roughened", lambda candidate, values: None)
    return SimpleNamespace(subject=subject, cancelled=lambda: False, tell=lambda words: None), parent


def test_it_begins_at_the_opening_that_takes_most_off_once_the_cause_has_given_way(world):
    """At the cause's own values that play would miss by more than it takes off."""
    search, parent = world
    begun = 20.0 * (PLAY + 2.0 * FRICTION)
    assert np.sum((parent.fitted.r - begun) ** 2) > np.sum(parent.fitted.r**2)
    (made,) = joining(search, parent, [play("viscous_friction:j1")], "clearance")
    assert [c.name for c in made.choice.candidates] == [*parent.names, "clearance:j1"]
    assert np.allclose(made.x, begun)


def test_what_takes_nothing_off_at_any_opening_is_not_fitted(world):
    search, parent = world
    parent.fitted.r = np.zeros(ROWS)
    assert joining(search, parent, [play("viscous_friction:j1")], "clearance") == []


@pytest.mark.parametrize(("left", "fraction", "so"), [(1.5, 1.0, True), (2.5, 1.0, False), (1.5, 0.5, False)])
def test_a_cause_follows_the_motion_where_it_leaves_no_more_than_the_noise(left, fraction, so):
    fitted: Any = SimpleNamespace(r=np.zeros(ROWS), chi2=left * ROWS, fraction=fraction)
    assert follows(SimpleNamespace(fitted=fitted)) is so  # type: ignore[arg-type]
