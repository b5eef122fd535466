"""What a value owes to a parameter that nobody gave."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from backend.effects.camera_tilt import GUESS as FAR_OFF
from backend.effects.rolling_shutter import GUESS
from backend.fit.free import free_parameters
from backend.fit.guess import guesses, told
from tests.mechanisms import bar_inertia, body, drawing, effect

ASKED = ("rolling_shutter:camera.readout_s", "viscous_friction:pin")


def pendulum(*effects):
    bar = body("bar", (0.1, 0.0, 0.0), Rotation.identity(), 0.5, bar_inertia(0.5, 0.2))
    joints = [("pin", "revolute", "ground", "bar", (0, 0, 0), (0, 0, 1))]
    return drawing("pendulum", [bar], joints, list(effects), [("tip", "bar", (0.2, 0, 0))])


@pytest.mark.parametrize(
    ("drawn", "share"), [((), GUESS), (({},), GUESS), (({"height_m": 0.5},), 0.0)], ids=["absent", "silent", "told"]
)
def test_a_readout_owes_to_the_height_of_a_picture_that_nobody_gave(drawn, share):
    mechanism = pendulum(*(effect("rows", "rolling_shutter", ["camera"], readout_s=0.0, **more) for more in drawn))
    parameters = free_parameters(mechanism, ASKED).parameters
    owed = guesses(mechanism, parameters, np.array([-0.02, 0.1]))
    assert owed == pytest.approx([0.02 * share, 0.0])
    said = list(told(mechanism, parameters))
    assert len(said) == (1 if share else 0)
    assert all("height_m" in sentence for sentence in said)


@pytest.mark.parametrize(("drawn", "share"), [((), FAR_OFF), (({"distance_m": 0.8},), 0.0)], ids=["absent", "told"])
def test_a_tilt_owes_to_the_distance_of_a_camera_that_nobody_gave(drawn, share):
    mechanism = pendulum(*(effect("lean", "camera_tilt", ["camera"], pitch_rad=0.0, **more) for more in drawn))
    parameters = free_parameters(mechanism, ("camera_tilt:camera.pitch_rad", "camera_tilt:camera.yaw_rad")).parameters
    assert guesses(mechanism, parameters, np.array([-0.02, 0.01])) == pytest.approx([0.02 * share, 0.01 * share])
    assert all("distance_m" in sentence for sentence in told(mechanism, parameters))


def test_a_tilt_owes_nothing_to_a_distance_that_is_free_itself():
    asked = ("camera_tilt:camera.yaw_rad", "camera_tilt:camera.distance_m")
    parameters = free_parameters(pendulum(), asked).parameters
    assert guesses(pendulum(), parameters, np.array([0.02, 0.9])) == pytest.approx([0.0, 0.0])
    assert not list(told(pendulum(), parameters))
