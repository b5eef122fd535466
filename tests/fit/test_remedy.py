"""What would tell values that data leave open, tried: SciPy makes the record that was asked for."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from backend.fit.fit_study import fit_study
from backend.fit.remedy import left_open, remedies
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study

LENGTH, MASS, INERTIA, GRAVITY = 0.2, 0.5, 2e-3, 9.81
VISCOUS, DRY, PUSH = 0.004, 0.01, 1.0
STILL, SIGMA = 0.1, 2e-4
HINGE = {"position_m": [0, 0, 0], "quaternion_wxyz": [0.7071067811865476, 0.7071067811865476, 0, 0]}
POSE = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}


@pytest.fixture(scope="module")
def drawing() -> Mechanism:
    """A pendulum along -z about -y, pushed along x at its bob."""
    turned = {"xx": INERTIA, "yy": INERTIA, "zz": INERTIA, "xy": 0, "xz": 0, "yz": 0}
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "pendulum", "gravity_m_per_s2": [0, 0, -GRAVITY],
            "provenance": {"tool": "t", "tool_version": "1", "exporter": "e", "exporter_version": "1",
                           "created": "2026-01-01T00:00:00Z", "warnings": []},
            "bodies": [
                {"id": "ground", "fixed": True, "pose": POSE},
                {"id": "bar", "pose": POSE,
                 "inertial": {"mass_kg": MASS, "center_of_mass_m": [0, 0, -LENGTH], "inertia_kg_m2": turned}},
            ],
            "joints": [{"id": "j1", "type": "revolute", "body_a": "ground", "body_b": "bar",
                        "frame_a": HINGE, "frame_b": HINGE}],
            "effects": [{"id": "push", "kind": "applied_force", "on": ["bar", "ground"],
                         "parameters": {"force_n": PUSH, "direction": [1, 0, 0], "point_m": [0, 0, -LENGTH]}}],
            "markers": [],
        }
    )  # fmt: skip


def record(id: str, angle: float, duration: float, push: float = PUSH, seed: int = 0) -> Experiment:
    """An encoder at the hinge."""
    time = np.arange(0.0, STILL + duration, 0.005)

    def slope(_, y):
        torque = -MASS * GRAVITY * LENGTH * np.sin(y[0]) + push * LENGTH * np.cos(y[0])
        return [y[1], (torque - VISCOUS * y[1] - DRY * np.tanh(y[1] / 1e-3)) / (MASS * LENGTH**2 + INERTIA)]

    q = np.full(time.size, angle)
    after = time[time >= STILL] - STILL
    q[time >= STILL] = solve_ivp(slope, (0, duration + 0.01), [angle, 0.0], "Radau", after, rtol=1e-8, atol=1e-10).y[0]
    noisy = q + SIGMA * np.random.default_rng(seed).standard_normal(q.size)
    table = pd.DataFrame({"time_s": time, "joint": "j1", "q": noisy, "sigma": SIGMA})
    overrides = {} if push == PUSH else {"push": {"force_n": push}}
    return Experiment(id, "fit", Release(time_s=STILL), joint_positions=table, overrides=overrides)  # type: ignore[arg-type]


FREE = ["viscous_friction:j1", "coulomb_friction:j1"]


@pytest.fixture(scope="module")
def short(drawing):
    """A tenth of a swing tells a drag from a rub by no means."""
    return fit_study(Study(drawing, (record("short", 0.6, 0.15),)), FREE)


def test_frictions_that_a_short_record_cannot_part_are_left_open_and_named_with_what_would_part_them(short):
    assert left_open(short.uncertainty, short.solution.x, 2)
    for name in ("viscous_friction:j1", "coulomb_friction:j1"):
        said = next(w for w in short.report.warnings if w.startswith(f"What would tell {name}"))
        assert re.search(r"a record of 0\.58 s instead of 0\.145 s \(\+- \d", said)
    assert not any("sought" in w for w in short.report.warnings)


def test_the_records_asked_for_leave_the_deviations_that_were_promised(short, drawing):
    tried = {
        r.words: r.sd for r in remedies(short.residuals, short.solution, short.uncertainty, ["j1"], lambda words: None)
    }
    promised = {
        "long": next(sd for words, sd in tried.items() if words.startswith("a record of 0.58 s")),
        "push": next(sd for words, sd in tried.items() if words.startswith("push.force_n of 2 N")),
        "far": next(sd for words, sd in tried.items() if "j1 at 69 deg" in words),
    }
    made = {
        "long": record("long", 0.6, 0.6, seed=1),
        "push": record("push", 0.6, 0.15, push=2.0, seed=2),
        "far": record("far", 1.2, 0.15, seed=3),
    }
    for name, more in made.items():
        study = Study(drawing, (*(replace(e) for e in [record("short", 0.6, 0.15)]), more))
        sd = fit_study(study, FREE, profiles=False).uncertainty.sd[:2]
        np.testing.assert_allclose(sd, promised[name], rtol=0.3, err_msg=name)


def test_values_that_the_data_tell_ask_for_nothing(drawing):
    found = fit_study(Study(drawing, (record("long", 0.6, 1.5),)), ["viscous_friction:j1"])
    assert left_open(found.uncertainty, found.solution.x, 1) == []
    assert not any("would tell" in w for w in found.report.warnings)
