"""What is unknown is no effect of the library, nor a sum of two."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.latent import warp
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
    assert _named(subject, "joint:j1", 9) == named
    assert not _named(subject, "camera", 23)


@pytest.mark.parametrize(
    ("kinds", "named"),
    [(("time_offset", "frame_rate_error"), {20, 21}), (("frame_rate_error",), {21}), (("camera_scale",), set())],
)
def test_a_clock_that_is_late_or_runs_fast_is_nothing_unknown(kinds, named):
    held = [SimpleNamespace(kind=kind, on=("camera",)) for kind in kinds]
    subject: Any = SimpleNamespace(library=SimpleNamespace(candidates=held))
    assert _named(subject, "camera", 23) == named


@pytest.mark.parametrize(
    ("offsets", "axes", "named"),
    [
        (("marker:a", "marker:b"), "xz", {0, 10}),
        (("marker:a",), "x", {0}),
        (("marker:b",), "xz", set()),
        ((), "xz", set()),
    ],
)
def test_a_shift_that_is_the_same_everywhere_is_a_marker_that_sits_aside(offsets, axes, named):
    held = [SimpleNamespace(kind="marker_offset", places=offsets)] if offsets else []
    held.append(SimpleNamespace(kind="tracker_drift", places=("marker:a",)))
    channels = [SimpleNamespace(at="marker:a", coordinate=f"{axis}_m") for axis in axes]
    data = SimpleNamespace(channels=[*channels, SimpleNamespace(at="marker:b", coordinate="y_m")])
    fit = [SimpleNamespace(data=data)] * 2
    subject: Any = SimpleNamespace(fit=fit, library=SimpleNamespace(candidates=held))
    assert _named(subject, "marker:a", 10 * len(axes)) == named


def test_shifts_by_a_markers_place_differ_along_its_own_way():
    time = np.linspace(0.0, 1.0, 200)
    turn = 2.0 * np.pi * time
    far = {"a": (1.0, np.cos(turn)), "b": (-1.0, np.sin(turn))}
    values = [middle + 0.01 * part for middle, part in far.values() for part in (part, np.roll(part, 50))]
    channels = [SimpleNamespace(at=f"marker:{m}", coordinate=axis) for m in far for axis in ("x_m", "z_m")]
    data = SimpleNamespace(channels=channels, channel=np.repeat(np.arange(4), 200), time_s=np.tile(time, 4))
    probe = SimpleNamespace(data=data, predict=lambda values_, own: (np.concatenate(values),))
    fitted: Any = SimpleNamespace(probes=[probe], values=None, own=lambda run: None)
    seer: Any = SimpleNamespace(white=[lambda column: column])
    made = warp(fitted, seer, ("x_m", "z_m"), "marker:a")
    assert not np.any(made[400:])
    unit = made / np.linalg.norm(made, axis=0)
    assert np.abs(unit[:, 0] @ unit[:, 1:]).max() < 0.9  # squares are never negative
    assert np.abs(unit[:, 0] @ unit[:, [1, 4]]).max() < 0.1


def test_a_marker_that_was_measured_along_one_axis_shifts_along_that_alone():
    time = np.linspace(0.0, 1.0, 50)
    channels = [SimpleNamespace(at=at, coordinate=axis) for at, axis in
                (("marker:a", "x_m"), ("marker:b", "x_m"), ("marker:b", "z_m"))]  # fmt: skip
    data = SimpleNamespace(channels=channels, channel=np.repeat(np.arange(3), 50), time_s=np.tile(time, 3))
    probe = SimpleNamespace(data=data, predict=lambda values, own: (np.tile(np.sin(time), 3),))
    fitted: Any = SimpleNamespace(probes=[probe], values=None, own=lambda run: None)
    seer: Any = SimpleNamespace(white=[lambda column: column])
    assert warp(fitted, seer, ("x_m", "z_m"), "marker:a").shape == (150, 4)  # a cubic, and no warning
