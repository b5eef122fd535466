"""Where experiments begin: found from their first samples, also where one of those is wild."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from backend.fit import pose
from backend.fit.fit_study import _misses
from backend.fit.measured import measured
from backend.fit.pose import LONGEST, WELL, Miss, find_start
from backend.fit.prediction import look
from backend.mechanism.study import Experiment, Release
from backend.model.build import build
from backend.model.state import Pose
from tests.mechanisms import body, drawing

TIME = 0.0033 + np.arange(60) / 150
POINTS = {"out": (0.0, 0.095, 0.0), "in": (0.075, 0.0, 0.01), "spot": (0.05, 0.012, 0.0)}
RATES = (3.0, 0.5, 20.0)  # of yaw, roll and spin [rad/s]


@pytest.fixture(scope="module")
def gyroscope():
    """A rotor in two rings, all about one point and drawn with a roll: yaw about z, roll about x, spin about y."""
    stands = dict(zip(("outer", "inner", "rotor"), Rotation.from_euler("X", [[0.0], [0.3], [0.3]]), strict=True))
    parts = [body(id, (0, 0, 0), stands[id], 0.2, np.array([6e-4, 5e-4, 7e-4])) for id in stands]
    joints = [
        ("pillar", "revolute", "ground", "outer", (0, 0, 0), (0, 0, 1)),
        ("trunnion", "revolute", "outer", "inner", (0, 0, 0), (1, 0, 0)),
        ("axle", "revolute", "inner", "rotor", (0, 0, 0), stands["inner"].apply((0, 1, 0))),
    ]
    markers = [(id, part, stands[part].apply(POINTS[id])) for id, part in zip(POINTS, stands, strict=True)]
    return build(drawing("gyroscope", parts, joints, markers=markers))


def filmed(begin):
    """Marker -> its path, from angles that grow evenly, with a tenth of a millimetre of noise."""
    rng = np.random.default_rng(5)
    angles = np.asarray(begin) + np.outer(TIME, RATES)
    turned = {"out": Rotation.from_euler("Z", angles[:, :1]), "in": Rotation.from_euler("ZX", angles[:, :2])}
    turned["spot"] = Rotation.from_euler("ZXY", angles)
    return {id: turned[id].apply(POINTS[id]) + 1e-4 * rng.standard_normal((TIME.size, 3)) for id in POINTS}


def experiment(paths):
    rows = [
        {"time_s": t, "marker": id, "x_m": x, "y_m": y, "z_m": z, "sigma_m": np.nan}
        for id, path in paths.items()
        for t, (x, y, z) in zip(TIME, path, strict=True)
    ]
    return Experiment("e1", "fit", Release(time_s=0.0, at_rest=False), tracks=pd.DataFrame(rows))


def start_of(model, paths):
    shot = experiment(paths)
    return find_start(model, measured(shot, model), shot.release)


def test_one_wild_sample_leaves_the_start_where_it_is(gyroscope):
    paths = filmed((0.4, -0.3, 0.8))
    clean = start_of(gyroscope, paths)
    paths["out"][1] += (0.04, 0.03, -0.015)  # 52 mm, two frames after the release
    struck = start_of(gyroscope, paths)
    np.testing.assert_allclose(struck.reference.position, clean.reference.position, atol=3e-4)
    np.testing.assert_allclose(struck.reference.quaternion, clean.reference.quaternion, atol=3e-3)  # noise in a window
    turns, still = (found.motions[:, 3:] @ found.rates for found in (struck, clean))  # each body's, in rad/s
    np.testing.assert_allclose(turns, still, atol=0.1)
    assert struck.rms < 5e-3


def test_a_search_goes_on_from_elsewhere_where_far_at_once_attitudes_are_lost(gyroscope, monkeypatch):
    closed = pose._closed

    def far_is_lost(made, reference, moved):
        """As happens to bodies about one point, now and then: their places stay finite."""
        there = closed(made, reference, moved)
        lost = jnp.abs(moved).max() > 2 * LONGEST
        return Pose(there.position, jnp.where(lost, jnp.nan, there.quaternion))

    monkeypatch.setattr(pose, "_closed", far_is_lost)
    paths = filmed((0.4, -0.3, 0.8))
    paths["in"] = paths["in"] + (0.0, 0.0, 0.05)  # no pose explains it: other starts are tried
    found = start_of(gyroscope, paths)
    assert WELL < found.rms < 1.0
    assert np.isfinite(found.reference.quaternion).all()


def test_a_start_that_no_pose_explains_names_what_is_farthest_off(gyroscope):
    paths = filmed((0.4, -0.3, 0.8))
    paths["in"] = 1.4 * paths["in"]  # 30 mm farther out than its ring
    found = start_of(gyroscope, paths)
    run = SimpleNamespace(found=found, experiment=SimpleNamespace(id="e1"))
    (said,) = _misses([run])  # type: ignore[list-item]
    assert 'rad or mechanism lengths, marker "in" by 30' in said
    assert str(Miss("joint:pin", 0.5, "rad")) == 'joint "pin" by 0.5 rad'


def test_a_drawing_that_cannot_be_closed_says_so(gyroscope, monkeypatch):
    made, drawn = pose._drawn(gyroscope)
    nowhere = Pose(drawn.position, jnp.full_like(drawn.quaternion, jnp.nan))
    monkeypatch.setattr(pose, "_drawn", lambda model: (made, nowhere))
    with pytest.raises(ValueError, match=r"drawn pose.*cannot be closed: see linktwin check"):
        start_of(gyroscope, filmed((0.4, -0.3, 0.8)))


def test_a_search_that_is_lost_from_everywhere_says_what_was_tried(gyroscope, monkeypatch):
    monkeypatch.setattr(pose, "look", lambda *at: [np.nan * seen for seen in look(*at)])
    with pytest.raises(ValueError, match=r"from the drawn pose and 12 others was lost each time. Draw the mechanism"):
        start_of(gyroscope, filmed((0.4, -0.3, 0.8)))
