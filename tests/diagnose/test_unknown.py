"""What is unknown is no effect of the library, nor a sum of two."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.unknown import NAMED, _law_evidence, _named
from tests.diagnose.test_evidence import ROWS, SIZE, fitted

TERMS = np.linalg.qr(np.random.default_rng(5).standard_normal((ROWS, 9)))[0]
OFFSET, TURNED, RATE, MASS = 0, 2, 4, 8
FORMS = frozenset(NAMED)


@pytest.mark.parametrize(
    ("true", "told_apart"), [((OFFSET,), True), ((OFFSET, MASS), True), ((RATE, TURNED), False), ((TURNED,), False)]
)
def test_a_law_of_terms_that_effects_are_is_no_unknown_one(true, told_apart):
    bare = fitted(SIZE)
    for term in true:
        bare.r[:] += 12.0 * TERMS[:, term]
    lost = _law_evidence(bare, TERMS, True, frozenset()) - _law_evidence(bare, TERMS, True, FORMS)
    assert (lost > 2.0) is told_apart
    assert lost > -1.0  # what is left has fewer laws to be shared among


@pytest.mark.parametrize(
    ("type", "left_out", "named"),
    [
        ("revolute", (), {0, 4, 8}),
        ("revolute", ("viscous_friction",), {0, 8}),
        ("revolute", ("rotor_inertia",), {0, 4}),
        ("prismatic", ("rotor_inertia",), {0, 4, 8}),
        ("prismatic", ("rotor_inertia", "mass_error"), {0, 4}),
    ],
)
def test_terms_are_named_by_what_the_library_holds_at_the_joint(type, left_out, named):
    on = {"effort_offset": "j1", "viscous_friction": "j1", "rotor_inertia": "j1", "mass_error": "arm"}
    held = [SimpleNamespace(kind=kind, on=(at,)) for kind, at in on.items() if kind not in left_out]
    held.append(SimpleNamespace(kind="coulomb_friction", on=("j2",)))
    topology = SimpleNamespace(joint_ids=["j1", "j2"], joint_types=[type, type])
    subject: Any = SimpleNamespace(model=SimpleNamespace(topology=topology), library=SimpleNamespace(candidates=held))
    assert _named(subject, "joint:j1") == named
    assert not _named(subject, "camera")
