"""Whole turns: a drawing at 200 degrees is one at -160, until ends, or a path, say which."""

import math

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from backend.export.gather import gather
from backend.fit.run import Run
from backend.mechanism.graph import describe
from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release
from backend.mechanism.turns import begins_near
from backend.model.build import build
from backend.simulate.run import simulate
from tests.mechanisms import Document, document, effect, pendulum, pose
from tests.motions import follow

DRAWN = math.radians(200.0)
RAD = math.radians


def turned(q: float, effects=(), limits: Document | None = None):
    """The pendulum, its pin's frame on the link drawn so that the joint stands at q."""
    drawn = document(pendulum(effects=effects))
    (joint,) = drawn["joints"]
    frame = joint["frame_b"]
    about = Rotation.from_quat(frame["quaternion_wxyz"], scalar_first=True) * Rotation.from_rotvec([0.0, 0.0, q])
    joint["frame_b"] = pose(frame["position_m"], about)
    if limits is not None:
        joint["limits"] = limits
    return parse_mechanism(drawn)


def stop(lower_deg: float | None = None, upper_deg: float | None = None):
    sides = {"lower": lower_deg, "upper": upper_deg}
    return effect("ends", "joint_stop", ["pin"], **{k: RAD(v) for k, v in sides.items() if v is not None})


@pytest.mark.parametrize(
    ("drawn_deg", "effects", "limits", "begins_deg"),
    [
        (200, (), None, -160),
        (200, (), {"lower": RAD(170), "upper": RAD(230)}, 200),
        (200, (stop(170, 230),), None, 200),
        (-160, (stop(170, 230),), None, 200),
        (200, (stop(lower_deg=100),), None, 200),
        (-200, (stop(upper_deg=-100),), None, -200),
        (170, (stop(-230, -170),), None, -190),
        (20, (stop(lower_deg=30),), None, 20),  # a little beyond its end, not nearly a turn behind it
        (-170, (stop(-720, 720),), None, -170),
        (400, (stop(390, 700),), None, 400),
        (90, (stop(170, 230), stop(-10, 20)), None, 90),  # no travel is left: nothing is said
        (200, (effect("path", "prescribed_motion", ["pin"], q=DRAWN),), None, 200),
        (200, (effect("path", "prescribed_motion", ["pin"]),), None, -160),  # q is 0 where nobody says so
        (0, (), {"lower": -1e308, "upper": -1e308}, None),
        (200, (effect("path", "prescribed_motion", "all", q=DRAWN + 2 * math.pi),), None, 560),
    ],
)
def test_a_joint_begins_in_the_whole_turn_that_its_ends_or_its_path_speak_of(drawn_deg, effects, limits, begins_deg):
    effects = [e.model_copy(update={"id": f"{e.id}{n}"}) for n, e in enumerate(effects)]
    (joint,) = describe(turned(RAD(drawn_deg), effects, limits)).closure
    assert begins_deg is None or math.degrees(joint.q) == pytest.approx(begins_deg, abs=1e-9)


def test_a_pendulum_drawn_between_its_ends_at_200_degrees_swings_between_them():
    drawn = turned(DRAWN, [stop(150, 230)])
    assert not describe(drawn).warnings
    q = follow(build(drawn), 5e-3, 100).path.q[:, 0]
    assert q[0] == pytest.approx(DRAWN, abs=1e-9)
    assert np.min(q) == pytest.approx(RAD(150), abs=1e-3)  # without an end it would swing down to 142.7
    assert np.max(q) == q[0]
    (joint,) = gather(drawn).joints
    assert joint.q == pytest.approx(DRAWN, abs=1e-9)


def test_a_path_on_record_from_200_degrees_is_followed_from_there():
    drawn = turned(DRAWN, [effect("path", "prescribed_motion", ["pin"], q=0.0)])
    times = np.linspace(0.0, 0.3, 31)
    path = DRAWN + 2.0 * times
    run = simulate(drawn, 0.2, 1e-2, inputs=[(("path", "q"), times, path)])
    assert run.done
    assert np.max(np.abs(run.q["pin"] - DRAWN - 2.0 * run.time_s)) < 1e-5


PATH = effect("path", "prescribed_motion", ["pin"], q=0.0)


@pytest.mark.parametrize("known", [stop(170, 230), PATH], ids=["ends", "a path on record"])
def test_an_experiment_begins_where_its_ends_or_its_record_say(known):
    times = np.arange(20) / 100
    encoder = pd.DataFrame({"time_s": times, "joint": "pin", "q": DRAWN, "sigma": 1e-3})
    record = pd.DataFrame({"time_s": times, "effect": "path", "parameter": "q", "value": DRAWN})
    told = Experiment(
        "e1", "fit", Release(time_s=0.1), joint_positions=encoder, inputs=record if known is PATH else None
    )
    own = Run.of(told, build(turned(DRAWN, [known])), (), 5e-3)
    assert not np.any(own.found.turns)
    assert (own.setting.record is None) == (known is not PATH)


def test_a_wound_spring_stays_wound_and_is_told():
    drawn = turned(DRAWN, [effect("spring", "torsion_spring", ["pin"], stiffness_n_m_per_rad=0.1, rest_rad=DRAWN)])
    assert begins_near(drawn) == {"pin": 0.0}
    (told,) = describe(drawn).warnings
    assert "slack at 3.491 rad" in told
    assert "begins at -2.793 rad" in told
    assert "wound by 1 turns" in told


def test_a_turn_is_kept_where_numbers_are_fitted():
    model = build(turned(DRAWN, [stop(170, 230)]))
    moved = model.with_parameters({("ends", "upper"): jnp.asarray(0.0)})
    tried = build(turned(DRAWN, [stop(170, 230)]), [effect("more", "joint_stop", ["pin"], lower=-0.1, upper=0.1)])
    for other in (moved, tried):
        assert float(other.drawing.begins_near[0]) == pytest.approx(DRAWN)
