"""What a record says of itself where its noise is not written down."""

import numpy as np
import pandas as pd
import pytest

from backend.fit.measured import measured
from backend.mechanism.study import Experiment, Release
from backend.model.build import build
from tests.mechanisms import effect, fourbar, pendulum

SIGMA = 1e-4


def filmed(**given):
    """A swinging tip in a plane; columns may be replaced."""
    rng, time = np.random.default_rng(0), np.arange(120) / 60
    q = 0.4 * np.cos(5.0 * np.maximum(time - 0.5, 0.0))
    noise = SIGMA * rng.standard_normal((2, time.size))
    table = {"time_s": time, "marker": "tip", "x_m": 0.2 * np.sin(q) + noise[0], "y_m": -0.2 * np.cos(q) + noise[1],
             "z_m": 0.0, "sigma_m": np.nan} | given  # fmt: skip
    return pd.DataFrame(table)


def read(tracks, **tables):
    return measured(Experiment("e1", "fit", Release(time_s=0.5), tracks=tracks, **tables), build(pendulum()))


def test_a_coordinate_written_for_a_plane_was_not_measured():
    data = read(filmed())
    assert [c.coordinate for c in data.channels] == ["x_m", "y_m"]
    assert np.median(data.sigma) == pytest.approx(SIGMA, rel=0.4)  # of 30 still frames: 13% each


def test_a_coordinate_that_stands_still_with_a_sigma_of_its_own_counts():
    data = read(filmed(sigma_m=SIGMA))
    assert [c.coordinate for c in data.channels] == ["x_m", "y_m", "z_m"]
    assert np.all(data.sigma == SIGMA)


def test_an_encoder_that_stands_still_is_as_noisy_as_the_noisiest_of_its_unit():
    time = np.arange(50) / 50
    stuck = pd.DataFrame({"time_s": time, "joint": "j1", "q": 0.3, "sigma": np.nan})
    moves = pd.DataFrame(
        {"time_s": time, "joint": "j2", "q": np.sin(time) + 1e-3 * np.random.default_rng(1).standard_normal(50),
         "sigma": np.nan}
    )  # fmt: skip
    two = Experiment("e1", "fit", Release(time_s=0.0), joint_positions=pd.concat([stuck, moves]))
    data = measured(two, build(fourbar()))
    assert [c.noise for c in data.channels] == ["others", "third_difference"]
    assert data.sigma[0] == data.sigma[-1] == pytest.approx(1e-3, rel=0.6)  # a median of 47


def test_where_no_channel_can_tell_its_noise_it_has_to_be_given():
    with pytest.raises(ValueError, match=r"'e1', marker:tip x_m does not vary at all.*Give sigma"):
        read(filmed(x_m=0.1, y_m=-0.1))


def test_an_override_reaches_an_effect_at_every_joint_whose_fits_differ():
    drawn = pendulum(effects=[effect("play", "clearance", "all", radial_m=1e-4)])
    assert build(drawn).overridden({"play": {"restitution": 0.5}}) == {("play", "restitution"): 0.5}
    fits = fourbar().model_copy(update={"effects": (effect("play", "clearance", "all"),)})
    joints = [j.model_copy(update={"fit": j.fit.model_copy(update={"radial_clearance_m": 1e-4})}) for j in fits.joints]
    model = build(fits.model_copy(update={"joints": tuple(joints)}))
    changed = model.with_parameters(model.overridden({"play": {"restitution": 0.5}}))
    assert {row.value for (_, name), row in changed.parameters.items() if name == "restitution"} == {0.5}
