"""A bar whose motion is on record, and which does not follow it: a gap at the joint that is told how to move."""

import numpy as np
import pandas as pd
import pytest

from backend.effects.catalogue import catalogue
from backend.mechanism.study import Experiment, Release, Study
from tests.mechanisms import Z, bar, drawing, effect

SLACK = 0.02  # rad by which the bar lags, either way
SIGMA = 2e-4
RATE, STILL = 60.0, 20
ASKED = {"length_error", "camera_scale", "camera_rotation", "time_offset", "marker_offset", "viscous_friction"}

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def run_often() -> bool:
    """A diagnosis runs one program hundreds of times."""
    return True


def told(seed: int, slack: float) -> Study:
    points = {"tip": (0.2, 0.0), "mid": (0.1, 0.03)}
    motor = effect("motor", "prescribed_motion", ["pin"], q=0.0)
    pins, marks = (
        [("pin", "revolute", "ground", "link", (0, 0, 0), Z)],
        [(m, "link", (*p, 0.0)) for m, p in points.items()],
    )
    driven = drawing("driven bar", [bar("link", (0, 0, 0), (0.2, 0, 0), 0.1)], pins, [motor], marks)
    rng = np.random.default_rng(seed)
    time_s = np.arange(STILL + 90) / RATE
    since = np.maximum(time_s - STILL / RATE, 0.0)
    experiments = []
    for i, (size, hertz) in enumerate([(0.8, 1.0), (0.5, 1.6), (-0.6, 1.3)]):
        q = size * (1.0 - np.cos(2.0 * np.pi * hertz * since))
        rate = np.gradient(q, time_s)
        late = q - slack * np.tanh(rate / 0.3)
        tables = []
        for id, (x, y) in points.items():
            seen = np.stack([np.cos(late) * x - np.sin(late) * y, np.sin(late) * x + np.cos(late) * y], 1)
            seen = seen + SIGMA * rng.standard_normal(seen.shape)
            tables.append(
                pd.DataFrame({"time_s": time_s, "marker": id, "x_m": seen[:, 0], "y_m": seen[:, 1], "z_m": np.nan,
                              "sigma_m": SIGMA})
            )  # fmt: skip
        record = pd.DataFrame({"time_s": time_s, "effect": "motor", "parameter": "q", "value": q})
        release, use = Release(time_s=STILL / RATE), "fit" if i < 2 else "held_out"
        experiments.append(Experiment(f"e{i}", use, release, tracks=pd.concat(tables), inputs=record))
    return Study(driven, tuple(experiments))


@pytest.mark.nightly
@pytest.mark.parametrize(("slack", "verdict"), [(0.0, "none"), (SLACK, "unknown")])
def test_a_bar_that_lags_behind_its_motor_is_a_gap_at_the_joint(slack, verdict):
    from backend.diagnose.run import diagnose_study

    found = diagnose_study(told(1, slack), without=frozenset(catalogue()) - ASKED).report
    assert found.verdict == verdict
    if verdict == "unknown":
        assert found.where.locations[0].at == "joint:pin"
        stretches = [p for p in found.where.phases if p.at == "joint:pin"]
        assert stretches
        assert {p.unit for p in stretches} == {"rad"}
        assert max(abs(p.missing) for p in stretches) == pytest.approx(SLACK, rel=0.5)
