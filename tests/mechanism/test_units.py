"""Tables in another unit than metres and seconds are refused or told; what is slow, or cautious, is not."""

import numpy as np
import pandas as pd
import pytest

from backend.mechanism.study import Experiment, Release
from backend.mechanism.units import far_tracks, unit_findings
from tests.mechanism.swings import NOISE_M, POINTS, RELEASE_S, TIME, filmed, pendulum
from tests.mechanisms import effect

LENGTHS = {"mm": 1000.0, "cm": 100.0, "inches": 39.37}
ONE = {"tip": POINTS["tip"]}
MIXED = {"tip": "tail", "tail": "tip"}
FLAT = (0.0, 0.0, -9.8)  # across the plane of motion: a table


def scaled(table, factor):
    return table.assign(**{x: factor * table[x] for x in ("x_m", "y_m", "z_m")})


@pytest.mark.parametrize("unit", LENGTHS)
def test_places_in_another_unit_are_told_by_the_distances_on_one_body(unit):
    (said,) = far_tracks(scaled(filmed(), LENGTHS[unit]), pendulum())
    assert f"{LENGTHS[unit]:.0f} times as far, as are all 3 such pairs; places are in m, these in {unit}" in said
    assert 'markers "tip" and "tail" are seen' in said


def test_one_marker_in_centimetres_is_seen_over_more_than_a_mechanism_on_pins_measures():
    (said,) = far_tracks(scaled(filmed(ONE), 100.0), pendulum(ONE))
    assert "times what all parts measure together, 0.2 m, and pins hold them" in said
    assert list(far_tracks(scaled(filmed(ONE), 100.0), pendulum(ONE, type="cylindrical"))) == []


@pytest.mark.parametrize(
    "table",
    [filmed(), scaled(filmed(), 1.3), filmed().assign(marker=filmed()["marker"].replace(MIXED)),
     filmed().assign(x_m=lambda t: t["x_m"] + 4.0), filmed().assign(x_m=np.nan, y_m=np.nan)],
    ids=["as it is", "a wrong scale", "mixed names", "another origin", "nothing measured"],
)  # fmt: skip
def test_what_no_unit_explains_is_left_to_the_fit(table):
    assert list(far_tracks(table, pendulum())) == []


def findings(table, release=RELEASE_S, mechanism=None, at_rest=True, encoder=None):
    shot = Experiment("e1", "fit", Release(time_s=release, at_rest=at_rest), tracks=table, joint_positions=encoder)
    return list(unit_findings(shot, mechanism or pendulum()))


def in_ms(table):
    return table.assign(time_s=1000.0 * table["time_s"])


@pytest.mark.parametrize("release", [RELEASE_S, 1000.0 * RELEASE_S])
def test_times_in_milliseconds_stand_out(release):
    (said,) = findings(in_ms(filmed()), release)
    assert "is sampled every 8.333 s and moves in the course of" in said
    assert "divide time_s by 1000 where they are ms" in said
    turns = pd.DataFrame({"time_s": TIME, "joint": "pin", "q": 0.5 * np.cos(7 * TIME), "sigma": np.nan})
    assert findings(None, encoder=turns) == []
    (said,) = findings(None, release, encoder=in_ms(turns))
    assert 'joint "pin" is sampled every 8.333 s' in said


def test_on_a_table_a_release_before_the_second_sample_tells_milliseconds():
    (said,) = findings(in_ms(filmed()), RELEASE_S, pendulum(gravity=FLAT))
    assert "release.time_s, 0.25 s, comes before its second sample" in said
    assert findings(in_ms(filmed()), 1000.0 * RELEASE_S, pendulum(gravity=FLAT)) == []


def test_what_is_slow_with_a_reason_is_left_alone():
    minute = filmed().iloc[::3].assign(time_s=lambda table: 60.0 * table["time_s"])
    assert findings(minute, 60.0 * RELEASE_S) == []  # a balance that swings once a minute, sampled every 1.5 s
    led = pendulum(effects=[effect("motor", "prescribed_motion", ["pin"])])
    assert findings(in_ms(filmed()), 1000.0 * RELEASE_S, led) == []
    assert findings(filmed()) == []


def test_noise_in_millimetres_stands_out_and_caution_does_not():
    (said,) = findings(filmed(sigma=0.2))
    assert 'marker "tip" has sigma_m 0.2 m, and its 30 still frames scatter by 0.00019 m' in said
    assert findings(filmed(sigma=10 * NOISE_M)) == []
    assert findings(filmed(sigma=NOISE_M, noise=0.0)) == []
    assert findings(filmed(sigma=0.2), at_rest=False) == []  # nothing stood still


@pytest.mark.parametrize("scale", [0.5, 1.4, 2.0])
def test_places_in_a_wrong_scale_are_told_where_all_distances_agree(scale):
    (said,) = findings(scaled(filmed(), scale))
    assert f"{scale:g} times as far, as are all 3 such pairs; check the length that the tracks were scaled with" in said


def test_a_camera_off_by_a_tenth_and_mixed_names_are_no_wrong_scale():
    assert findings(scaled(filmed(), 1.1)) == []
    mixed = filmed().assign(marker=filmed()["marker"].replace(MIXED))
    assert findings(mixed) == []


@pytest.mark.parametrize(("factor", "told"), [(1.0, 0), (10.0, 0), (1000.0, 1)])
def test_torques_in_newton_millimetres_are_told_by_what_the_masses_could_bear(factor, told):
    driven = pendulum(effects=[effect("motor", "effort_offset", ["pin"])])
    torque = factor * 0.1 * np.sin(9.0 * TIME)  # the bar weighs some tenth of a newton metre
    record = pd.DataFrame({"time_s": TIME, "effect": "motor", "parameter": "torque_n_m", "value": torque})
    shot = Experiment("e1", "fit", Release(time_s=RELEASE_S), tracks=filmed(), inputs=record)
    said = list(unit_findings(shot, driven))
    assert len(said) == told
    assert all(
        "times the weight of all that moves" in sentence and "divide N mm by 1000" in sentence for sentence in said
    )
