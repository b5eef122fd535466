"""What `check` says of a study: a line for each experiment, and what stands out."""

import numpy as np
import pandas as pd

from backend.mechanism.graph import describe
from backend.mechanism.study import Experiment, Release, Study
from backend.mechanism.study_report import describe_study, study_json, study_text
from tests.mechanisms import effect, pendulum

TIME = np.arange(200) / 100
SWING = pd.DataFrame({"time_s": TIME, "joint": "pin", "q": 0.5 * np.cos(7 * TIME), "sigma": np.nan})
DRIVE = pd.DataFrame({"time_s": [0.0], "effect": "motor", "parameter": "torque_n_m", "value": [0.1]})
DRAWN = pendulum(effects=[effect("motor", "effort_offset", ["pin"])])


def told(*experiments):
    return describe_study(Study(DRAWN, experiments), describe(DRAWN))


def test_an_experiment_is_told_in_a_line():
    driven = Experiment("e1", "fit", Release(time_s=0.5), joint_positions=SWING, inputs=DRIVE)
    other = SWING.assign(q=-SWING["q"])
    report = told(driven, Experiment("run 2", "held_out", Release(time_s=0.0, at_rest=False), joint_positions=other))
    lines = study_text(report).splitlines()
    assert "study     2 experiments: 1 to fit, 1 held out; 0 tolerances" in lines
    assert (
        "  e1     fit       1.49 s, let go at 0.5 s, 200 samples (50 before), 1 encoder, driven by motor.torque_n_m"
        in lines
    )
    assert report.ok
    assert study_json(report)["experiments"][0]["driven"] == ["motor.torque_n_m"]


def test_a_study_that_holds_everything_out_is_no_study_to_fit():
    kept = [Experiment(id, "held_out", Release(time_s=0.5), joint_positions=SWING) for id in ("e1", "e2")]
    report = told(*kept)
    assert not report.ok
    assert report.errors[0].startswith("No experiment may be fitted: all 2 experiments are held_out. Give at least")


def test_what_the_drawing_is_warned_of_is_told_once():
    heavy = DRAWN.model_copy(update={"gravity_m_per_s2": (0.0, -9806.65, 0.0)})
    study = Study(heavy, (Experiment("e1", "fit", Release(time_s=0.5), joint_positions=SWING),))
    text = study_text(describe_study(study, describe(heavy)))
    assert text.count("gravity_m_per_s2 is 9807") == 1
    assert "1000 times the earth's" in text
