"""What a verdict's sentence says: which member of a set does most alone, what the next ones add, what is faint."""

from types import SimpleNamespace
from typing import Any

import pytest

from backend.diagnose import verdict as module


def cause(*on: str, rms: float, fraction: float = 1.0) -> Any:
    members = tuple(SimpleNamespace(name=f"air_drag:{place}", kind="air_drag", on=(place,)) for place in on)
    return SimpleNamespace(
        names=tuple(m.name for m in members), candidates=members,
        fitted=SimpleNamespace(chi2=rms**2, fraction=fraction, rms=rms),
    )  # fmt: skip


@pytest.fixture(autouse=True)
def stubs(monkeypatch):
    monkeypatch.setattr(module, "_rms", lambda subject, fitted, scale: (fitted.rms, 1.0))


def said(*tried: Any, best: Any = None) -> str:
    subject: Any = None
    best, baseline = best or cause("Arm", "tip", rms=1.0), cause(rms=10.0)
    return module._ladder(subject, baseline, best, {made.names: made for made in tried}, 1.0)


def test_the_member_that_does_most_of_a_set_is_named_with_its_share_of_the_gap():
    share = 100.0 * (10.0**2 - 2.0**2) / (10.0**2 - 1.0**2)
    words = said(cause("Arm", rms=2.0), cause("tip", rms=9.0))
    assert words == f" Air drag at Arm alone explains {share:.1f}% of the fitted gap."
    assert said(cause("Arm", rms=1.01)) == " Air drag at Arm alone explains more than 99.9% of the fitted gap."


def test_nothing_is_said_where_no_member_does_most_or_follows_whole_records():
    assert said(cause("Arm", rms=8.0), cause("tip", rms=9.0)) == ""
    assert said(cause("Arm", rms=2.0, fraction=0.5)) == ""
    assert said() == ""


def test_what_the_next_member_adds_is_said_as_far_as_sets_were_tried():
    whole = cause("Arm", "base", "tip", rms=1.0)
    first, second = cause("Arm", rms=5.0), cause("Arm", "tip", rms=2.0)
    shares = [100.0 * (10.0**2 - rms**2) / (10.0**2 - 1.0**2) for rms in (5.0, 2.0)]
    alone = f" Air drag at Arm alone explains {shares[0]:.1f}% of the fitted gap"
    assert said(first, second, best=whole) == f"{alone}, with air drag at tip {shares[1]:.1f}%."
    assert said(first, cause("base", "tip", rms=1.5), best=whole) == f"{alone}."


def faint(probability: float) -> Any:
    effect = SimpleNamespace(kind="viscous_friction", on=["j4"])
    return SimpleNamespace(effects=[effect], probability=probability)


def test_a_faint_cause_is_mentioned_where_nothing_amiss_is_likelier():
    words = module._sentence("none", False, [faint(0.2)], [], None, 0, 0.7, 0.1)
    assert words.endswith("these data show no gap. If anything is amiss it may be viscous friction at j4 (20%).")
    for causes in ([], [faint(0.04)]):
        assert module._sentence("none", False, causes, [], None, 0, 0.9, 0.0).endswith("these data show no gap.")


def test_how_likely_noise_alone_is_stands_beside_a_faint_cause():
    words = module._sentence("ambiguous", True, [faint(0.4), faint(0.3)], [], None, 2, 0.2, 0.1)
    assert words.endswith("these data cannot tell which. That nothing is amiss and noise looks so: 20%.")
    assert "nothing is amiss" not in module._sentence("identified", True, [faint(0.9)], [], None, 1, 0.04, 0.06)


def test_what_would_fit_stands_beside_something_unknown_that_is_likelier():
    words = module._sentence("unknown", True, [faint(0.27)], [], None, 1, 0.0, 0.73)
    assert "outside the library (73%) than viscous friction at j4, which would fit too (27%)" in words
    assert module._sentence("unknown", False, [faint(0.1)], [], None, 1, 0.0, 0.9).endswith("explains it.")
    assert module._sentence("unknown", True, [], [], None, 0, 0.0, 1.0).endswith("explains it.")
