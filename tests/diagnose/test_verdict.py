"""What a verdict becomes once a law of unknown form is likelier than what is named, and how probable that is told."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import verdict
from backend.diagnose.belief import Belief
from backend.diagnose.judgement import NEARLY_ALL, _weighed


def believed(unknown: float) -> Any:
    return SimpleNamespace(unknown=unknown, none=0.0, probability=np.array([1.0 - unknown]), reported=[0])


@pytest.mark.parametrize(
    ("explained", "unknown", "led", "said"),
    [
        (0.97, 0.99, True, "unknown"),
        (1.0 - 0.1 * (1.0 - NEARLY_ALL), 0.99, True, "approximate"),
        (1.0 - 0.1 * (1.0 - NEARLY_ALL), 0.99, False, "unknown"),
        (1.0 - 0.1 * (1.0 - NEARLY_ALL), 0.80, False, "approximate"),
    ],
)
def test_a_form_that_explains_nearly_all_keeps_its_name_where_one_effect_leads(explained, unknown, led, said):
    shrunk: Any = SimpleNamespace(explained=explained)
    assert _weighed("approximate", False, False, believed(unknown), shrunk, led) == said


@pytest.mark.parametrize(
    ("explained", "led", "said"), [(0.95, True, "approximate"), (0.95, False, "unknown"), (0.995, False, "approximate")]
)
def test_of_several_effects_none_of_which_leads_more_is_asked(explained, led, said):
    shrunk: Any = SimpleNamespace(explained=explained)
    assert _weighed("identified", True, False, believed(0.99), shrunk, led) == said


@pytest.mark.parametrize(
    ("unknown", "explained", "told"),
    [(0.0, 0.95, 0.3), (0.4, 0.95, 0.4), (0.99, 0.95, 0.5), (0.99, 0.9999, 0.3), (0.99, None, 0.5)],
)
def test_something_is_missing_beside_a_form_that_is_nearly_right(unknown, explained, told):
    belief = Belief((), np.zeros(0), np.zeros(0), 0.0, unknown)
    shrunk: Any = SimpleNamespace(explained=explained)
    assert verdict._chances("approximate", False, belief, shrunk)[1] == pytest.approx(told)


@pytest.mark.parametrize("probability", [[0.3, 0.1], [0.0, 0.0]], ids=["as believed", "less than a float holds"])
def test_what_is_left_is_shared_by_the_causes_that_are_listed(probability):
    belief = Belief((), np.array([*probability, 0.0]), np.array([-900.0, -900.0 - np.log(3.0), -2000.0]), 0.0, 0.5)
    assert verdict._shares(belief, 2, 0.5) == pytest.approx([0.375, 0.125])
    assert verdict._shares(Belief((), np.zeros(0), np.zeros(0), 0.0, 1.0), 0, 0.0).size == 0
