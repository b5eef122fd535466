"""Fits of a pendulum whose reality is SciPy's integrator, not ours."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study, Tolerance

LENGTH, MASS, GRAVITY = 0.2, 0.5, 9.81
INERTIA = 2e-3  # about the centre of mass, which is the bob
DAMPING, TURN, SIGMA = 0.012, 0.02, 2e-4  # viscous [N m s/rad], camera [rad], marker noise [m]
FREE = ["viscous_friction:j1", "camera_rotation"]
HINGE = {"position_m": [0, 0, 0], "quaternion_wxyz": [0.7071067811865476, 0.7071067811865476, 0, 0]}


@pytest.fixture(scope="module")
def drawing():
    """A pendulum hanging along -z, turning about -y: positive q takes the bob towards +x."""
    pose = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
    inertia = {"xx": INERTIA, "yy": INERTIA, "zz": INERTIA, "xy": 0, "xz": 0, "yz": 0}
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "pendulum", "gravity_m_per_s2": [0, 0, -GRAVITY],
            "provenance": {"tool": "t", "tool_version": "1", "exporter": "e", "exporter_version": "1",
                           "created": "2026-01-01T00:00:00Z", "warnings": []},
            "bodies": [
                {"id": "ground", "fixed": True, "pose": pose},
                {"id": "bar", "pose": pose,
                 "inertial": {"mass_kg": MASS, "center_of_mass_m": [0, 0, -LENGTH], "inertia_kg_m2": inertia}},
            ],
            "joints": [{"id": "j1", "type": "revolute", "body_a": "ground", "body_b": "bar",
                        "frame_a": HINGE, "frame_b": HINGE}],
            "effects": [],
            "markers": [{"id": "bob", "body": "bar", "position_m": [0, 0, -LENGTH]},
                        {"id": "mid", "body": "bar", "position_m": [0.03, 0, -0.1]}],
        }
    )  # fmt: skip


def swing(time, angle, rate=0.0, damping=DAMPING, gravity=GRAVITY):
    """Angle over time by an integrator and in a coordinate of its own."""
    around = MASS * LENGTH**2 + INERTIA

    def slope(_, y):
        return [y[1], (-MASS * gravity * LENGTH * np.sin(y[0]) - damping * y[1]) / around]

    return solve_ivp(slope, (0, time[-1] + 1e-9), [angle, rate], t_eval=time, rtol=1e-10, atol=1e-12).y[0]


def filmed(drawing, time, q, rng, turn=TURN):
    """Both markers as a camera turned by `turn` reports them; y is not measured, every tenth bob is missing."""
    rows = []
    for marker in drawing.markers:
        x0, _, z0 = marker.position_m
        x, z = np.cos(q) * x0 - np.sin(q) * z0, np.sin(q) * x0 + np.cos(q) * z0
        # Right-handed about -y, the axis of the joint: as for q itself.
        x, z = np.cos(turn) * x - np.sin(turn) * z, np.sin(turn) * x + np.cos(turn) * z
        noise = SIGMA * rng.standard_normal((2, time.size))
        table = pd.DataFrame({"time_s": time, "marker": marker.id, "x_m": x + noise[0], "y_m": np.nan,
                              "z_m": z + noise[1], "sigma_m": np.nan})  # fmt: skip
        rows.append(table.drop(table.index[5::10]) if marker.id == "bob" else table)
    return pd.concat(rows, ignore_index=True)


@pytest.fixture(scope="module")
def study(drawing):
    """A release from rest, a start in motion, and a held-out run: uneven frames, noise not stated."""
    rng = np.random.default_rng(7)
    experiments = []
    for id, use, angle, rate, still in (
        ("rest", "fit", 0.9, 0.0, 0.1), ("moving", "fit", -0.4, 5.0, 0.0), ("unseen", "held_out", -1.2, 0.0, 0.1)
    ):  # fmt: skip
        time = np.cumsum(rng.uniform(0.006, 0.010, 190))
        q = np.where(time < still, angle, 0.0)
        q[time >= still] = swing(time[time >= still] - still, angle, rate)
        release = Release(time_s=still, at_rest=still > 0)
        experiments.append(Experiment(id, use, release, tracks=filmed(drawing, time, q, rng)))  # type: ignore[arg-type]
    loose = Tolerance(kind="mass_error", on=("bar",), sd=0.01)
    return Study(drawing, tuple(experiments), (loose,))


@pytest.fixture(scope="module")
def fitted(study):
    from backend.fit.fit_study import fit_study

    told = []
    result = fit_study(
        study, ["viscous_friction:j1", "camera_rotation"], progress=lambda fraction, words: told.append(fraction)
    )
    return result, told


def test_the_friction_and_the_camera_turn_that_made_the_film_are_found(fitted):
    result, _ = fitted
    for p, truth in zip(result.report.parameters, (DAMPING, TURN), strict=False):
        assert abs(p.value - truth) < 3.5 * p.sd  # one seed, two parameters: 0.1% to fail by chance
        assert p.sd < 0.02 * truth
        assert p.ci95[0] < p.value < p.ci95[1]
    assert result.report.converged


def test_the_profile_holds_the_value_and_is_as_wide_as_the_interval(fitted):
    for p, i in zip(fitted[0].report.parameters, fitted[0].report.identifiability, strict=True):
        assert i.profile[0] < p.value < i.profile[1]
        assert i.profile[1] - i.profile[0] == pytest.approx(p.ci95[1] - p.ci95[0], rel=0.1)


def test_profiles_drawn_at_once_are_those_drawn_one_by_one(fitted):
    from backend.fit.identifiability import profile_interval

    result, _ = fitted
    problem, u = result.residuals.problem(), result.uncertainty
    for j, i in enumerate(result.report.identifiability):
        alone = profile_interval(problem, result.solution, j, u.covariance, float(u.noise_sd[j]), max_points=3)
        assert i.profile == (alone.lower, alone.upper)


def test_the_fit_ends_at_the_noise_and_so_does_the_prediction_of_an_unseen_run(fitted):
    report = fitted[0].report
    assert {r.at for r in report.residuals} == {"marker:bob", "marker:mid"}
    for r in report.residuals:
        assert r.noise == pytest.approx(SIGMA * np.sqrt(2), rel=0.3)  # estimated from 170 third differences
        assert r.rms == pytest.approx(r.noise, rel=0.3)
        assert r.before > 5 * r.rms
    # The unseen run starts from a pose of a dozen static frames: it adds little to the noise.
    assert all(r.rms < 2 * r.noise and r.use == "held_out" for r in report.held_out)


def test_overlays_hold_measured_and_simulated_side_by_side(fitted, study):
    overlay = next(o for o in fitted[0].overlays if (o.experiment, o.at) == ("unseen", "marker:mid"))
    assert overlay.coordinates == ("x_m", "z_m")
    assert overlay.measured.shape == overlay.before.shape == overlay.after.shape == (190, 2)
    assert np.all(np.diff(overlay.time_s) > 0)


def test_fitted_runs_and_a_held_out_one_are_played_back(fitted, study):
    from backend.report.fit_summary import overlays

    played = overlays(study, fitted[0])
    assert [(o.experiment, o.held_out) for o in played] == [("rest", False), ("moving", False), ("unseen", True)]
    after, before = (
        -2.0 * np.arctan2(motion.quaternion_wxyz["bar"][:, 2], motion.quaternion_wxyz["bar"][:, 0])
        for motion in (played[-1].after, played[-1].before)
    )
    time = played[-1].after.time_s
    assert (time[0], round(time[-1], 1)) == (pytest.approx(0.1), 1.5)
    truth = swing(time - time[0], -1.2)
    assert np.abs(after - truth).max() < 5e-3 < 0.1 < np.abs(before - truth).max()


def test_the_report_is_written_as_the_contract_says(fitted, tmp_path):
    from backend.mechanism.fit_report import FitReport

    path = fitted[0].write(tmp_path / "out")
    assert FitReport.model_validate(json.loads(path.read_text())) == fitted[0].report
    assert set(fitted[0].report.history[0].parameters) == {p.name for p in fitted[0].report.parameters}


def test_progress_is_told_from_start_to_end(fitted):
    assert fitted[1][0] < 0.1
    assert fitted[1][-1] == 1.0


def test_the_derivative_of_every_residual_agrees_with_finite_differences(fitted):
    residuals, x = fitted[0].residuals, fitted[0].solution.x
    _, J = residuals.evaluate(x)
    h = 1e-6 * residuals.problem().scale
    for k in range(x.size):
        move = np.zeros_like(x)
        move[k] = h[k]
        slope = (residuals.evaluate(x + move)[0] - residuals.evaluate(x - move)[0]) / (2 * h[k])
        # The step's Newton solver stops at 1e-10: divided by 2e-6 that leaves 5e-5 of noise in the difference.
        assert np.abs(slope - J[:, k]).max() < 1e-3 * np.abs(J[:, k]).max()


def test_what_stands_out_in_the_study_is_said_first(study):
    from backend.fit.fit_study import fit_study

    rest, *others = study.experiments
    slip = replace(rest, release=rest.release.model_copy(update={"window_s": 0.6}))
    told = fit_study(replace(study, experiments=(slip, *others)), FREE, profiles=False, max_iterations=2).report
    assert told.warnings[0].startswith("experiment 'rest': release.window_s is 0.6 s beside at_rest true")


@pytest.fixture(scope="module")
def by_gradients(study):
    from backend.fit.fit_study import fit_study

    return fit_study(study, FREE, derivatives="adjoint", profiles=False)


@pytest.mark.nightly
def test_gradients_backwards_in_time_are_those_of_the_slopes(by_gradients):
    residuals, x = by_gradients.residuals, by_gradients.solution.x
    for fraction, memory in ((1.0, {}), (0.4, {(0, 0): 0.6, (1, 3): -0.3})):
        residuals.memory = memory
        r, J = residuals.evaluate(x, fraction)
        np.testing.assert_allclose(residuals.residual(x, fraction), r, rtol=1e-9, atol=1e-9)
        weight = np.random.default_rng(4).standard_normal(r.size)
        traced = residuals.traced_back(x, weight, fraction)
        np.testing.assert_allclose(traced, J.T @ weight, rtol=1e-7, atol=1e-9 * np.abs(J).max())
    residuals.memory = {}


def test_a_fit_by_gradients_ends_where_one_by_slopes_does(by_gradients, fitted):
    other = fitted[0]
    sd = other.uncertainty.sd
    # Both stop where no step gains a millionth of an objective of some 700: within 0.04 sd of the optimum each.
    np.testing.assert_allclose(by_gradients.solution.x / sd, other.solution.x / sd, rtol=0, atol=0.08)
    np.testing.assert_allclose(by_gradients.uncertainty.sd, sd, rtol=1e-3)
    assert "adjoint" in by_gradients.report.message
    assert "adjoint" not in other.report.message
    assert by_gradients.report.converged


def test_a_cancelled_fit_says_so_and_does_not_pretend(study):
    from backend.fit.fit_study import fit_study

    result = fit_study(study, ["viscous_friction:j1", "camera_rotation"], cancelled=lambda: True)
    assert not result.report.converged
    assert "Cancelled" in result.report.message


@pytest.fixture(scope="module")
def counted(study):
    """options -> a fit with them, and how many times it simulated the whole study."""
    from backend.fit.fit_study import fit_study
    from backend.fit.residual import Residuals

    def fit(**options):
        calls, evaluate = [], Residuals.evaluate
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Residuals, "evaluate", lambda *given: calls.append(0) or evaluate(*given))
            return fit_study(study, FREE, profiles=False, **options), len(calls)

    return fit


@pytest.fixture(scope="module")
def left_alone(counted):
    """The same for fits that nobody kills, each done once."""
    return cache(counted)


@pytest.mark.parametrize(
    ("iteration", "options"),
    [(4, {}), (11, {}), (7, {"derivatives": "adjoint"}), (11, {"starts": 1})],
)
def test_a_fit_that_was_killed_goes_on_where_it_was(fitted, counted, left_alone, tmp_path, iteration, options):
    kept, steps = tmp_path / "kept" / "fit.checkpoint.json", []

    def die(fraction, words):
        steps.extend(["iteration"] * ("iteration" in words))
        if len(steps) == iteration:
            raise MemoryError

    with pytest.raises(MemoryError):
        counted(checkpoint=kept, progress=die, **options)
    assert kept.is_file()
    resumed, rest = counted(checkpoint=kept, resume=True, **options)
    whole, all_ = left_alone(**options)
    assert rest < all_
    assert resumed.report.converged
    sd = fitted[0].uncertainty.sd[:3]
    # Both stop where no step gains a millionth of an objective of some 700: within 0.04 sd of the optimum each.
    np.testing.assert_allclose(resumed.solution.x[:3] / sd, whole.solution.x[:3] / sd, rtol=0, atol=0.08)
    assert len(resumed.report.history) >= iteration
    assert not kept.exists()


def test_a_checkpoint_serves_no_other_fit(study, tmp_path):
    from backend.fit.fit_study import fit_study

    kept = tmp_path / "fit.checkpoint.json"
    with pytest.raises(ValueError, match="does not exist, so there is no fit to resume"):
        fit_study(study, FREE, checkpoint=kept, resume=True)
    assert not fit_study(study, FREE, checkpoint=kept, cancelled=lambda: True).report.converged
    moved = study.experiments[0].tracks.assign(x_m=lambda table: table.x_m + 1e-9)
    other = replace(study, experiments=(replace(study.experiments[0], tracks=moved), *study.experiments[1:]))
    for changed, options in ((other, {}), (study, {"loss": "huber"}), (study, {"starts": 1})):
        with pytest.raises(ValueError, match="belongs to another fit"):
            fit_study(changed, FREE, checkpoint=kept, resume=True, **options)


def test_the_best_of_several_starts_is_the_one_that_misses_least(study, fitted):
    from backend.fit.fit_study import fit_study

    result = fit_study(study, FREE, starts=2, profiles=False)
    assert result.values[fitted[0].report.parameters[0].name] == pytest.approx(DAMPING, rel=0.05)
    assert result.spread == pytest.approx(fitted[0].spread, rel=0.01)


def test_a_tolerance_holds_a_mass_that_the_swing_cannot_tell(fitted):
    """Weight and inertia of the bob grow together, and the friction's share with them: the tolerance decides."""
    (mass,) = [p for p in fitted[0].report.parameters if p.kind == "mass_error"]
    assert 0.005 < mass.sd < 0.0101
    assert abs(mass.value) < 0.035  # three and a half sd


def test_an_override_of_what_is_fitted_is_refused(study, drawing):
    from backend.fit.fit_study import fit_study

    known = {"viscous_friction@j1": {"damping_n_m_s_per_rad": 0.1}}
    held = replace(study, experiments=(replace(study.experiments[0], overrides=known),))
    with pytest.raises(ValueError, match="experiment 'rest' overrides viscous_friction@j1"):
        fit_study(held, ["viscous_friction:j1"])


def test_a_fit_of_nothing_is_refused(study):
    from backend.fit.fit_study import fit_study

    with pytest.raises(ValueError, match="Nothing is free to fit"):
        fit_study(replace(study, tolerances=()), [])
