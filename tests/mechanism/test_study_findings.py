"""Studies that can be read, and hold what is likely a slip: said with part, number and remedy."""

import numpy as np
import pandas as pd
import pytest

from backend.mechanism.study import Experiment, Release, Study, Tolerance
from backend.mechanism.study_findings import study_findings
from tests.mechanisms import bead_on_bar, effect, pendulum

TIME = np.arange(200) / 100
MOVING = Release(time_s=0.5, at_rest=False)


def encoder(q=None, joint="pin", release_s=0.5):
    """Held, then a swing of half a radian, unless told otherwise."""
    q = 0.5 * np.cos(7 * np.maximum(TIME - release_s, 0.0)) if q is None else q
    return pd.DataFrame({"time_s": TIME, "joint": joint, "q": q, "sigma": np.nan})


def drive(times, values):
    return pd.DataFrame({"time_s": times, "effect": "motor", "parameter": "torque_n_m", "value": values})


def findings(release=None, tolerances=(), mechanism=None, **tables):
    drawn = mechanism or pendulum(effects=[effect("motor", "effort_offset", ["pin"])])
    tables = tables or {"joint_positions": encoder()}
    shot = Experiment("e1", "fit", release or Release(time_s=0.5), **tables)
    return study_findings(Study(drawn, (shot,), tolerances))


def the_one(sentences, *terms):
    (said,) = sentences
    for term in terms:
        assert term in said


@pytest.mark.parametrize(
    "release",
    [Release(time_s=0.5), Release(time_s=0.0, at_rest=False), Release(time_s=-0.02), Release(time_s=0.5, window_s=0.3)],
)
def test_nothing_stands_out_in_a_sound_study(release):
    shifted = encoder(release_s=max(release.time_s, 0.0)).assign(time_s=TIME - (0.02 if release.time_s < 0 else 0.0))
    narrow = [Tolerance(kind="mass_error", on="all", sd=0.02), Tolerance(kind="camera_scale", on=("camera",), sd=0.01)]
    assert findings(release, narrow, joint_positions=shifted) == []


def test_gravity_in_millimetres_stands_out():
    heavy = pendulum().model_copy(update={"gravity_m_per_s2": (0.0, -9806.65, 0.0)})
    the_one(findings(mechanism=heavy), "gravity_m_per_s2 is 9807", "write it in m/s²")


def test_a_release_long_before_the_first_sample_stands_out():
    the_one(findings(Release(time_s=-1.0)), "'e1': release.time_s is -1 s, 1 s before its first sample at 0 s", "clock")
    late = encoder().assign(time_s=TIME + 0.3)
    the_one(findings(Release(time_s=0.1), joint_positions=late), "0.2 s before its first sample at 0.3 s")


def test_a_window_longer_than_the_record_stands_out():
    the_one(findings(Release(time_s=0.5, at_rest=False, window_s=9.0)), "window_s is 9 s", "1.49 s after", "Shorten")


def test_a_window_beside_rest_stands_out():
    the_one(findings(Release(time_s=0.5, window_s=0.6)), "window_s is 0.6 s beside at_rest true", '"at_rest": false')


def test_a_swing_of_degrees_stands_out_and_a_rotor_does_not():
    degrees = np.degrees(encoder()["q"])
    the_one(findings(joint_positions=encoder(degrees)), 'joint "pin" turns by 57', "turns; q is in rad", "0.0174533")
    assert findings(MOVING, joint_positions=encoder(40.0 * TIME)) == []


def test_one_wild_sample_is_no_swing_and_a_slide_has_no_turns():
    struck = encoder()
    struck.loc[70, "q"] = 500.0
    assert findings(joint_positions=struck) == []
    slid = encoder(50.0 * np.cos(7 * TIME), joint="rail")
    assert findings(MOVING, mechanism=bead_on_bar(), joint_positions=slid) == []


def test_a_drive_that_begins_after_the_release_stands_out():
    record = drive(TIME[80:], np.sin(TIME[80:]))
    said = findings(joint_positions=encoder(), inputs=record)
    the_one(said, 'effect "motor" torque_n_m begins at 0.8 s, 0.3 s after the release', "0.717", "Record it from")
    switched = findings(joint_positions=encoder(), inputs=drive([0.6, 0.9], [1.0, 0.0]))
    the_one(switched, "begins at 0.6 s, 0.1 s after the release")


def test_a_sampled_drive_that_breaks_off_stands_out():
    said = findings(joint_positions=encoder(), inputs=drive(TIME[:100], np.sin(TIME[:100])))
    the_one(
        said, 'effect "motor" torque_n_m ends at 0.99 s, 1 s before the last sample at 1.99 s', "Record it to the end"
    )


def test_a_sampled_drive_that_breaks_off_while_it_pushes_evenly_stands_out():
    pushes = drive(TIME[:100], np.minimum(TIME[:100], 0.7))
    the_one(findings(joint_positions=encoder(), inputs=pushes), "ends at 0.99 s", "its last value, 0.7,")
    led = pushes.assign(effect="led", parameter="q")
    path = pendulum(effects=[effect("led", "prescribed_motion", ["pin"], q=0.0)])
    assert findings(joint_positions=encoder(), inputs=led, mechanism=path) == []


def test_a_marker_without_any_measurement_stands_out():
    rows = pd.DataFrame({"time_s": TIME, "marker": "tip", "x_m": np.nan, "y_m": np.nan, "z_m": np.nan})
    said = findings(joint_positions=encoder(), tracks=rows.assign(sigma_m=np.nan))
    the_one(said, 'marker "tip" stands in 200 rows and was measured in none')


@pytest.mark.parametrize(
    ("times", "values"),
    [([0.0, 0.6, 0.9], [0.0, 1.0, 0.5]), (TIME[:100], np.maximum(0.7 - TIME[:100], 0.0)), (TIME, np.sin(TIME))],
)
def test_a_list_of_switchings_and_a_drive_at_rest_may_end_early(times, values):
    assert findings(joint_positions=encoder(), inputs=drive(times, values)) == []


def test_a_tolerance_of_a_law_stands_out():
    loose = [Tolerance(kind="viscous_friction", on=("pin",), sd=0.01)]
    said = findings(tolerances=loose)
    the_one(said, 'tolerance 1 ("viscous_friction" on pin)', "sd 0.01", "N m s/rad", "--free viscous_friction:pin")


@pytest.mark.parametrize(
    ("kind", "on", "sd", "said"),
    [
        ("mass_error", ("link",), 2.0, "sd is 2, 200% of what is drawn; write a share: 2% is 0.02"),
        ("joint_axis_error", ("pin",), 1.5, "sd is 1.5 rad, 85.9 degrees"),
        ("center_of_mass_error", ("link",), 5.0, "sd is 5 m, and all parts measure 0.2 m together"),
    ],
)
def test_a_tolerance_that_leaves_nothing_of_the_drawing_stands_out(kind, on, sd, said):
    the_one(findings(tolerances=[Tolerance(kind=kind, on=on, sd=sd)]), f'tolerance 1 ("{kind}"): {said}')
    assert findings(tolerances=[Tolerance(kind=kind, on=on, sd=0.02 * sd)]) == []


def test_a_record_that_is_fitted_and_held_out_stands_out():
    drawn, release = pendulum(), Release(time_s=0.5)

    def told(*uses):
        shots = [Experiment(f"e{i}", use, release, joint_positions=encoder()) for i, use in enumerate(uses, start=1)]
        other = Experiment("other", "fit", release, joint_positions=encoder(0.8 * encoder()["q"]))
        return study_findings(Study(drawn, (*shots, other)))

    the_one(told("fit", "held_out"), "'e1' (fit), 'e2' (held_out) have the same joint_positions", "tests nothing")
    the_one(told("fit", "fit"), "they count as often in the fit")
    assert told("fit") == told("held_out", "held_out") == []


def test_a_record_whose_clock_was_set_otherwise_is_the_same_record():
    later = encoder().assign(time_s=TIME + 1.0)
    shots = (
        Experiment("e1", "fit", Release(time_s=0.5), joint_positions=encoder()),
        Experiment("e2", "held_out", Release(time_s=1.5), joint_positions=later),
    )
    the_one(study_findings(Study(pendulum(), shots)), "have the same joint_positions", "tests nothing")


def test_a_drive_on_record_that_is_called_like_its_joint_stands_out():
    named = pendulum(effects=[effect("pin", "effort_offset", ["pin"])])
    recorded = drive([0.0], [0.1]).assign(effect="pin")
    the_one(
        findings(mechanism=named, joint_positions=encoder(), inputs=recorded),
        'effect "pin" is on record and called like its joint',
        "--free effort_offset:pin frees the drive itself",
    )
