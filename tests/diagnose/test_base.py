"""A rig on a table that gives: what no library says of the base is found in the world around the mechanism."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from backend.effects.catalogue import catalogue
from backend.mechanism.study import Experiment, Release, Study
from tests.mechanisms import Z, bar, drawing

LENGTH, MASS, WEIGHT = 0.3, 0.4, 9.80665
TABLE_KG, RINGS_HZ, LOSES = 3.0, 2.1, 0.03
SIGMA, RATE, STILL = 3e-4, 80.0, 20
POINTS = {"tip": (0.29, 0.0), "mid": (0.1, 0.03), "near": (0.05, -0.03)}
ASKED = {"coulomb_friction", "camera_scale"}

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def run_often() -> bool:
    """A diagnosis runs one program hundreds of times."""
    return True


def swung(angle: float, since: np.ndarray, gives: bool) -> tuple[np.ndarray, np.ndarray]:
    """Angle of the bar from the x axis, and how far the table has gone along x."""
    inertia = MASS * LENGTH**2 / 12.0
    to = LENGTH / 2.0
    stiff = (2.0 * np.pi * RINGS_HZ) ** 2 * (TABLE_KG + MASS)
    loss = 2.0 * LOSES * np.sqrt(stiff * (TABLE_KG + MASS))

    def rate(_: float, state: np.ndarray) -> list[float]:
        u, q, du, dq = state
        mixed = -MASS * to * np.sin(q)
        push = np.array([MASS * to * np.cos(q) * dq**2 - stiff * u - loss * du, -MASS * WEIGHT * to * np.cos(q)])
        M = np.array([[TABLE_KG + MASS, mixed], [mixed, inertia + MASS * to**2]])
        if not gives:
            return [0.0, dq, 0.0, push[1] / M[1, 1]]
        return [du, dq, *np.linalg.solve(M, push)]

    made = solve_ivp(rate, (0.0, since[-1]), [0.0, angle, 0.0, 0.0], t_eval=since, rtol=1e-10, atol=1e-12)
    return made.y[1], made.y[0]


def hung(seed: int, gives: bool) -> tuple[Study, list[np.ndarray]]:
    """A bar that hangs from a table, seen by a camera that stands on the floor; and where the table was."""
    pins = [("pin", "revolute", "ground", "link", (0, 0, 0), Z)]
    marks = [(m, "link", (*p, 0.0)) for m, p in POINTS.items()]
    drawn = drawing(
        "bar on a table", [bar("link", (0, 0, 0), (LENGTH, 0, 0), MASS)], pins, [], marks, gravity=(0.0, -WEIGHT, 0.0)
    )
    rng = np.random.default_rng(seed)
    time_s = np.arange(STILL + 130) / RATE
    since = np.maximum(time_s - STILL / RATE, 0.0)
    experiments, tables = [], []
    for i, angle in enumerate([-0.2, -2.6, -0.7, -2.2]):
        q, u = swung(angle, np.unique(since), gives)
        q, u = (np.interp(since, np.unique(since), one) for one in (q, u))
        rows = []
        for id, (x, y) in POINTS.items():
            seen = np.stack([np.cos(q) * x - np.sin(q) * y + u, np.sin(q) * x + np.cos(q) * y], 1)
            seen = seen + SIGMA * rng.standard_normal(seen.shape)
            rows.append(
                pd.DataFrame({"time_s": time_s, "marker": id, "x_m": seen[:, 0], "y_m": seen[:, 1], "z_m": np.nan,
                              "sigma_m": SIGMA})
            )  # fmt: skip
        use = "fit" if i < 2 else "held_out"
        experiments.append(Experiment(f"e{i}", use, Release(time_s=STILL / RATE), tracks=pd.concat(rows)))
        tables.append(u[STILL:])
    return Study(drawn, tuple(experiments)), tables


@pytest.mark.nightly
def test_a_table_that_gives_is_a_gap_of_the_world_and_its_motion_is_told():
    from backend.diagnose.run import diagnose_study

    study, tables = hung(1, gives=True)
    found = diagnose_study(study, without=frozenset(catalogue()) - ASKED)
    report = found.report
    assert report.verdict == "unknown"
    assert report.where.locations[0].at == "world"
    assert report.where.locations[0].probability > 0.9
    assert {(p.at, p.unit) for p in report.where.phases} == {("world", "m")}
    assert report.next_experiment is not None
    assert "clamp the base" in report.next_experiment.do
    assert found.missing is not None
    assert found.missing.along == "x"
    for i, table in enumerate(tables[:2]):
        time, mean, sd = found.missing.series[f"e{i}"]
        told = np.interp(np.arange(table.size) / RATE, time, mean)
        assert np.sqrt(np.mean((told - table) ** 2)) < 0.1 * np.sqrt(np.mean(table**2))
        assert np.median(sd) < 0.1 * np.max(np.abs(table))


@pytest.fixture(scope="module")
def drawn():
    """The bar on a table that holds still, fitted."""
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    study, _ = hung(2, gives=False)
    known = library(study.mechanism, SMOOTH, without=frozenset(catalogue()) - {"base_motion"})
    return Search(prepare(study, known, 2e-3), lambda words: None, lambda: False).baseline().fitted


def shaken(drawn, i: int, hertz: float, phase: float) -> np.ndarray:
    """What the library's shaking along x does to one experiment, for a metre."""
    subject = drawn.subject
    shaking = {"frequency_hz": hertz, "phase_rad": phase, "begins_at_release": 1.0}
    neutral, direction = subject.neutral.copy(), np.zeros((1, subject.neutral.size))
    for k, parameter in enumerate(subject.library.parameters):
        neutral[k] = shaking.get(parameter.parameter, neutral[k])
        direction[0, k] = parameter.parameter == "amplitude_m[0]"
    probe = subject.fit[i].choose(np.zeros((neutral.size, 0)), neutral)
    white = subject.noise.whitening(probe.data, i, 1.0)
    return white(probe.slopes(np.zeros(0), drawn.own(i), direction))[:, 0]


@pytest.mark.nightly
def test_bumps_of_the_base_do_what_the_library_s_shaking_does(drawn):
    from backend.diagnose.finer import base_response, displacement, knots

    hertz, probe = 2.3, drawn.probes[0]
    middles, time = knots(drawn.subject, probe), np.linspace(0.0, probe.duration_s, 1000)
    sizes, *_ = np.linalg.lstsq(displacement(time, middles), np.sin(2.0 * np.pi * hertz * time), rcond=1e-10)
    found = base_response(drawn.subject, drawn)[drawn.rows[0], : middles.size] @ sizes
    expected = shaken(drawn, 0, hertz, 0.0)
    assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected)


@pytest.mark.nightly
def test_a_shaking_is_tried_in_phases_between_those_that_are_simulated(drawn):
    from dataclasses import replace

    from backend.diagnose.screen import screen, tuned

    (candidate,) = drawn.subject.library.candidates
    assert candidate.turning is not None
    tried = {p.parameter: values for p, values in zip(candidate.parameters, candidate.tries, strict=True)}
    hertz, phase = tried["frequency_hz"][5], tried["phase_rad"][5]
    about = screen(drawn.subject, drawn)
    left = 0.01 * np.concatenate([shaken(drawn, i, hertz, phase) for i in range(len(drawn.probes))])
    J = drawn.J
    H = np.linalg.pinv(J.T @ J + np.diag(drawn.precision), hermitian=True)
    found = tuned(replace(about, r=left - J @ (H @ (J.T @ left))), candidate)
    told = {p.parameter: found[p.name] for p in candidate.parameters}
    assert (told["frequency_hz"], told["phase_rad"]) == (hertz, phase)
    assert told["amplitude_m[0]"] == pytest.approx(0.01, rel=0.02)
