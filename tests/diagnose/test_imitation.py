"""A pair that fits may be one thing imitated that the library lacks: the likelier so where both act on one part."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.belief import FAR, IMITATED, OUTSIZED, weigh
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import Fitted
from backend.diagnose.standards import BARE, SMALL, TRIFLE
from backend.diagnose.standards import AbstractStandards as Standards

ROWS = 300


def cause(*reach: str, size: float = 0.0) -> Cause:
    """A set of one effect for each place, which fits to the noise; size: of each, in its sds before any data."""
    members = tuple(
        SimpleNamespace(name=f"{i}:{place}", reach=frozenset({place}), parameters=[None], log_odds=0.0)
        for i, place in enumerate(reach)
    )
    choice: Any = SimpleNamespace(
        parameters=[SimpleNamespace(name=m.name, lower=-np.inf, start=0.0) for m in members],
        candidates=members, own=len(members), start=np.zeros(len(members)), prior_sd=np.ones(len(members)),
        sizes=np.ones(len(members), bool),
    )  # fmt: skip
    r, J = (
        np.random.default_rng(5).standard_normal(ROWS),
        np.random.default_rng(6).standard_normal((ROWS, len(members))),
    )
    subject: Any = SimpleNamespace()
    x, rows = np.full(len(members), size), (slice(0, ROWS),)
    made = Fitted(
        subject, choice, (), x, r, J, rows, np.ones(len(members)), np.zeros(len(members), bool), "converged", 1.0, 0.0
    )
    return Cause(made, 0.0)


@pytest.mark.parametrize(
    ("reach", "own"),
    [
        (("joint:a",), 1.0),
        (("joint:a", "camera"), 1.0 - IMITATED[False]),
        (("camera", "camera"), 1.0 - IMITATED[True]),
        (("joint:a", "camera", "joint:a"), (1.0 - IMITATED[False]) * (1.0 - IMITATED[True])),
    ],
)
def test_what_is_not_the_sets_own_is_unknown(reach, own):
    belief = weigh(None, [cause(*reach)], 50, scale=1.0)
    assert belief.probability[0] == pytest.approx(own)
    assert belief.unknown == pytest.approx(1.0 - own)


@pytest.mark.parametrize(
    ("places", "enough", "remainder"),
    [(("joint:a", "camera"), True, False), (("joint:a", "camera"), False, True), (("camera", "camera"), True, True)],
)
def test_what_comes_after_nearly_all_is_a_remainder_unless_both_are_enough_from_different_parts(
    places, enough, remainder
):
    standards: Any = object.__new__(Standards)
    best, fitted = cause(*places), SimpleNamespace(chi2=1e6, fraction=1.0)
    alone = SimpleNamespace(chi2=best.fitted.chi2 + 100.0, fraction=1.0, pressed=[])
    standards.baseline = SimpleNamespace(fitted=fitted)
    standards.search = SimpleNamespace(tried={(best.names[0],): SimpleNamespace(fitted=alone)}, followed=1.0)
    assert standards.names_a_remainder(best, enough) == remainder


@pytest.mark.parametrize(
    ("excess", "gap", "little"),
    [
        (0.9 * BARE / ROWS, 1e3, True),
        (0.9 * BARE / ROWS, 0.5 * BARE / ROWS / SMALL**2, False),
        (1.1 * BARE / ROWS, 1e3, False),
        (10.0, 1.1 * 10.0 / TRIFLE**2, True),
        (10.0, 0.9 * 10.0 / TRIFLE**2, False),
    ],
    ids=["few noise variances", "of a small gap", "many", "of a gap a thousand times as wide", "of one less wide"],
)
def test_too_little_is_left_to_bear_a_second_name(excess, gap, little):
    standards: Any = object.__new__(Standards)
    standards.at_base = SimpleNamespace(power=gap)
    judged: Any = SimpleNamespace(excess=excess, power=excess)
    assert standards._little(cause("joint:a"), judged, 1) == little


@pytest.mark.parametrize("odds", [30.0, 35.0, 40.0])
def test_probabilities_stay_probabilities_where_something_unknown_is_all_but_certain(odds):
    sets = [cause("joint:a", "camera"), cause("camera", "camera")]
    likeliest = weigh(None, sets, 50, scale=1.0).log_z[0]
    belief = weigh(None, sets, 50, scale=1.0, unknown_log_z=likeliest + odds)
    assert 1.0 - belief.unknown - belief.none >= 0.0
    assert belief.unknown + belief.none + belief.probability.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("size", "own"), [(0.9 * FAR, 1.0), (-1.1 * FAR, 1.0 - OUTSIZED)])
def test_a_size_that_is_hardly_to_be_believed_leaves_half_to_the_unknown(size, own):
    belief = weigh(None, [cause("camera", size=size)], 50, scale=1.0)
    assert belief.probability[0] == pytest.approx(own)
    assert belief.unknown == pytest.approx(1.0 - own)


def test_members_and_an_outsized_one_are_doubted_for_one_reason():
    belief = weigh(None, [cause("joint:a", "camera", size=1.1 * FAR)], 50, scale=1.0)
    assert belief.probability[0] == pytest.approx(min(1.0 - IMITATED[False], 1.0 - OUTSIZED))
