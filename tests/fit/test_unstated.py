"""A pendulum on a loose pin, whose fit is told all, or nothing, of the walls."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from backend.effects.clearance import RIGID, RUBBER
from backend.fit.fit_study import fit_study
from backend.fit.free import free_parameters
from backend.fit.unstated import Unstated, unstated
from backend.mechanism.study import Experiment, Release, Study
from backend.model.build import build
from backend.simulate.run import simulate
from tests.mechanisms import bar_inertia, body, drawing, effect

PLAY_M, SIGMA_M, SOFT = 5e-4, 3e-4, 2e5
STATED = {"stiffness_n_per_m": RIGID, "restitution": 0.0, "friction_coefficient": 0.0}
TIME = np.arange(0.0, 0.4, 0.005)
STILL, STEP_S = 12, 5e-4


def pendulum(**play: float):
    """A level bar of 0.2 m and 0.5 kg, two markers on it, its pin in the middle of the hole."""
    bodies, joints = _parts()
    markers = [("near", "bar", (0.02, 0, 0)), ("tip", "bar", (0.2, 0, 0))]
    return drawing("loose", bodies, joints, [effect("play", "clearance", ["pin"], **play)], markers)


def _parts():
    bar = body("bar", (0.1, 0.0, 0.0), Rotation.identity(), 0.5, bar_inertia(0.5, 0.2))
    return [bar], [("pin", "revolute", "ground", "bar", (0, 0, 0), (0, 0, 1))]


def study(real: dict[str, float], told: dict[str, float]) -> Study:
    """Seen with real walls, fitted with those that are told."""
    motion = simulate(pendulum(radial_m=PLAY_M, **real), float(TIME[-1]) + 0.01, STEP_S)
    rng, seen = np.random.default_rng(0), []
    at = np.round(TIME / STEP_S).astype(int)
    release = STILL * 0.005
    for id, x in (("near", -0.08), ("tip", 0.1)):
        turned = Rotation.from_quat(motion.quaternion_wxyz["bar"][at], scalar_first=True)
        path = motion.position_m["bar"][at] + turned.apply([x, 0.0, 0.0])
        path = np.concatenate([np.repeat(path[:1], STILL, 0), path]) + SIGMA_M * rng.standard_normal(
            (STILL + TIME.size, 3)
        )
        time = np.concatenate([np.arange(STILL) * 0.005, release + TIME])
        columns = {"x_m": path[:, 0], "y_m": path[:, 1], "z_m": np.nan, "sigma_m": SIGMA_M}
        seen.append(pd.DataFrame({"time_s": time, "marker": id, **columns}))
    tracks = pd.concat(seen, ignore_index=True)
    return Study(pendulum(radial_m=0.7 * PLAY_M, **told), (Experiment("fall", "fit", Release(time_s=release), tracks),))


def fitted(real: dict[str, float], told: dict[str, float]):
    return fit_study(study(real, told), ["clearance:play.radial_m"], profiles=False, step_s=STEP_S).report


@pytest.fixture(scope="module")
def soft():
    return fitted({"stiffness_n_per_m": SOFT}, {})


@pytest.mark.nightly
def test_a_soft_wall_that_nobody_stated_misleads_the_noise_but_not_the_interval(soft):
    play = soft.parameters[0]
    assert play.value - PLAY_M > 1.96 * play.sd  # a soft wall passes for a wider hole
    assert play.ci95[0] < PLAY_M < play.ci95[1]
    assert play.ci95[1] - play.value == pytest.approx(1.96 * play.sd, rel=0.05)
    assert play.value - play.ci95[0] < 6.0 * play.sd


@pytest.mark.nightly
def test_a_wall_that_is_freed_and_drawn_as_rigid_is_found_with_its_play():
    free = ["clearance:play.radial_m", "clearance:play.stiffness_n_per_m"]
    play, wall = fit_study(
        study({"stiffness_n_per_m": SOFT}, {}), free, profiles=False, step_s=STEP_S
    ).report.parameters
    assert abs(play.value - PLAY_M) < 1.96 * play.sd < 2e-4
    assert wall.ci95[0] < SOFT < wall.ci95[1] < 10 * SOFT


@pytest.mark.nightly
def test_the_report_says_what_its_intervals_allow_for_and_what_to_do(soft):
    assert {(u.name, u.held, u.up_to) for u in soft.unstated} == {
        ("clearance:play.stiffness_n_per_m", RIGID, RUBBER),
        ("clearance:play.restitution", 0.0, 0.9),
        ("clearance:play.friction_coefficient", 0.0, 0.5),
    }
    assert next(u for u in soft.unstated if u.unit == "N/m").shifts[soft.parameters[0].name] < 0.0
    assert any("clearance:play.stiffness_n_per_m (down to 100000 N/m)" in sentence for sentence in soft.warnings)


@pytest.mark.nightly
def test_walls_that_are_stated_leave_the_interval_to_the_noise():
    report = fitted(STATED, STATED)
    play = report.parameters[0]
    assert report.unstated == ()
    # Beside the noise it allows for what half the step changes, here next to nothing.
    assert (play.ci95[1] - play.ci95[0]) == pytest.approx(2 * 1.959964 * play.sd, rel=0.01)
    assert play.ci95[0] < PLAY_M < play.ci95[1]


def test_what_is_free_is_not_allowed_for_and_neither_is_what_an_experiment_overrides():
    drawn = study({}, {"restitution": 0.1})
    specs = ["clearance:play.radial_m", "clearance:play.stiffness_n_per_m"]
    free = free_parameters(drawn.mechanism, specs)

    def names(of: Study) -> list[str]:
        return [each.name for each in unstated(of, build(of.mechanism), free.parameters, free.added)]

    assert names(drawn) == ["clearance:play.friction_coefficient"]
    slippery = replace(drawn.experiments[0], overrides={"play": {"friction_coefficient": 0.1}})
    assert names(replace(drawn, experiments=(slippery,))) == []


def test_a_fit_that_frees_no_play_takes_its_walls_as_they_are():
    drawn = study({}, {})
    free = free_parameters(drawn.mechanism, ["viscous_friction:pin"])
    assert unstated(drawn, build(drawn.mechanism, free.added), free.parameters, free.added) == []


def test_play_that_the_drawing_lacks_is_named_by_its_joint():
    drawn = drawing("rigid", *_parts())
    free = free_parameters(drawn, ["clearance:pin"])
    found = unstated(Study(drawn, ()), build(drawn, free.added), free.parameters, free.added)
    assert "clearance:pin.restitution" in [each.name for each in found]


def test_pins_of_which_nobody_stated_the_walls_have_walls_alike():
    bodies, joints = _parts()
    arm = body("arm", (0.3, 0.0, 0.0), Rotation.identity(), 0.5, bar_inertia(0.5, 0.2))
    joints = [*joints, ("elbow", "revolute", "bar", "arm", (0.2, 0, 0), (0, 0, 1))]
    effects = [
        effect("here", "clearance", ["pin"], radial_m=PLAY_M),
        effect("there", "clearance", ["elbow"], radial_m=PLAY_M, restitution=0.1),
    ]
    drawn = drawing("two", [*bodies, arm], joints, effects)
    free = free_parameters(drawn, ["clearance:*"])
    found = {each.name: len(each.addresses) for each in unstated(Study(drawn, ()), build(drawn), free.parameters, ())}
    assert found == {
        "clearance:*.stiffness_n_per_m": 2, "clearance:here.restitution": 1, "clearance:*.friction_coefficient": 2
    }  # fmt: skip


def test_half_the_way_to_a_soft_wall_is_half_its_give():
    wall = Unstated("clearance:play", (("play", "stiffness_n_per_m"),), RIGID, RUBBER, "N/m")
    assert (wall.at(0.0), wall.at(1.0)) == pytest.approx((RIGID, RUBBER))
    assert 1.0 / wall.at(0.5) == pytest.approx(0.5 / RIGID + 0.5 / RUBBER)
