"""Fits of a four-bar that SciPy moved and a distorted, tilted camera saw: in pixels, and in metres."""

from functools import cache

import numpy as np
import pytest

from backend.mechanism.study import Study

from .filmed import DAMPING, DOT_PX, filmed, places, rig

SEEDS = 6


@pytest.fixture(scope="module")
def truth():
    return places()


@pytest.fixture(scope="module")
def fit(truth, tmp_path_factory):
    """seed, options -> the fit of the crank's friction to one clip; all of them share one compiled program."""
    from backend.fit.fit_study import fit_study

    @cache
    def one(seed, **options):
        experiment = filmed(tmp_path_factory.mktemp("clip"), np.random.default_rng(seed), truth, **options)
        return fit_study(Study(rig(), (experiment,)), ["viscous_friction:j-pivot"], profiles=False)

    return one


@pytest.fixture(scope="module")
def in_pixels(fit):
    return [fit(seed) for seed in range(SEEDS)]


def score(result):
    p = result.report.parameters[0]
    return (p.value - DAMPING) / p.sd


@pytest.mark.nightly
def test_pixels_alone_tell_the_friction_within_its_interval(in_pixels):
    scores = np.array([score(r) for r in in_pixels])
    assert np.abs(scores).max() < 3.5
    # chi-square of six: 0.2% to 99.8%.
    assert 0.3 < np.sum(scores**2) < 21.0
    for result in in_pixels:
        assert result.report.converged
        assert result.report.parameters[0].sd < 0.005 * DAMPING


def test_residuals_are_pixels_at_the_noise_of_the_dots(in_pixels):
    for row in in_pixels[0].report.residuals:
        assert row.unit == "px"
        assert row.rms == pytest.approx(DOT_PX * np.sqrt(2), rel=0.25)  # both axes of 66 frames


def test_the_calibration_gives_way_within_what_it_says_and_is_not_warned_of(in_pixels):
    for result in in_pixels:
        (z,) = result.residuals.camera_numbers(result.solution.x).values()
        assert 0.5 < np.linalg.norm(z) < 7.0  # of 19 numbers, of which the clip tells some
        assert not [w for w in result.report.warnings if "contradict" in w]


def test_the_report_lists_the_camera_as_calibrated_and_as_the_clip_moved_it(in_pixels):
    for result in in_pixels:
        (camera,) = result.report.cameras
        (eye,) = result.residuals.cameras.values()
        (z,) = result.residuals.camera_numbers(result.solution.x).values()
        numbers = {n.name: n for n in camera.numbers}
        assert camera.experiments == ("clip",)
        assert set(numbers) == set(eye.names) - {"k3"}  # which that calibration held
        assert {numbers[n].unit for n in ("fx_px", "turn_x_rad", "z_m")} == {"px", "rad", "m"}
        moved = dict(zip(eye.names, eye.root @ z, strict=True))
        for name, n in numbers.items():
            assert n.value - n.calibrated == pytest.approx(moved[name], rel=1e-6, abs=1e-12)
            assert (
                0 < n.sd < 1.3 * n.calibrated_sd
            )  # data only narrow what is known; the misfit's memory scatters by a tenth
        assert min(n.sd / n.calibrated_sd for n in numbers.values()) < 0.9  # bars and dots tell some of them


def test_places_in_metres_with_the_same_camera_say_the_same(fit, in_pixels):
    metres = fit(0, metres=True).report.parameters[0]
    pixels = in_pixels[0].report.parameters[0]
    assert abs(metres.value - pixels.value) < 0.3 * pixels.sd  # first order against exact, one sigma for both axes
    assert metres.sd == pytest.approx(pixels.sd, rel=0.2)


def test_an_uncertain_calibration_widens_the_interval(fit):
    """With the camera's numbers held, good dots promise more than they can keep."""
    result = fit(0, dot_px=0.05)
    held = np.linalg.inv(result.solution.jacobian.T @ result.solution.jacobian)
    J = result.solution.jacobian[:, : -result.residuals.camera_numbers(result.solution.x).popitem()[1].size]
    without = np.linalg.inv(J.T @ J)
    assert held[0, 0] > 1.05 * without[0, 0]


def test_the_camera_of_another_lens_is_named(fit):
    """Its k1 is half of what the lens has: up to 1 px.  Rough dots let pose and heights hide that."""
    told = " ".join(fit(0, k1_off=0.05, dot_px=0.05).report.warnings)
    assert "contradict camera.json" in told
    assert "Calibrate again at the clip's setting" in told


def test_a_prediction_in_pixels_has_the_derivative_that_it_states(in_pixels):
    run, result = in_pixels[0].residuals.runs[0], in_pixels[0]
    values, own = result.solution.x[:1], result.residuals.own(result.solution.x, 0)
    _, J = run.predict(values, own)
    rng = np.random.default_rng(0)
    way = rng.standard_normal(own.size)
    step = 1e-5
    up, down = (run.predict(values, own + s * step * way)[0] for s in (1, -1))
    numeric = (up - down) / (2 * step)
    np.testing.assert_allclose(J[:, 1:] @ way, numeric, atol=1e-4 * np.abs(numeric).max())


def test_weights_of_samples_come_back_as_those_of_dots_and_camera(in_pixels, fit):
    for result in (in_pixels[0], fit(0, metres=True)):
        run, own = result.residuals.runs[0], result.residuals.own(result.solution.x, 0)
        raw = run._foreseen(run._moved_by(result.solution.x[:1], own))
        slope = np.random.default_rng(1).standard_normal((raw.size, 4))
        _, J = run.reported(raw, slope, own)
        weight = np.random.default_rng(2).standard_normal(len(J))
        back, by_camera = run.handed_back(raw, own, weight)
        np.testing.assert_allclose(slope.T @ back, J[:, :4].T @ weight, rtol=1e-10)
        np.testing.assert_allclose(by_camera, J[:, 4:].T @ weight, rtol=1e-10, atol=1e-12)


def test_a_held_out_clip_of_the_same_camera_is_seen_through_what_the_fit_learnt(in_pixels):
    from backend.fit.filmed_run import seen_by

    run = in_pixels[0].residuals.runs[0]
    numbers = in_pixels[0].residuals.camera_numbers(in_pixels[0].solution.x)
    other = seen_by(run, numbers)
    own = in_pixels[0].residuals.own(in_pixels[0].solution.x, 0)
    values = in_pixels[0].solution.x[:1]
    np.testing.assert_allclose(other.predict(values, own[: run.unknowns])[0], run.predict(values, own)[0], atol=1e-9)


def test_a_camera_without_a_pose_is_refused_with_what_to_name(truth, tmp_path):
    from backend.fit.eye import Eye
    from backend.observe.camera import read_camera, write_camera

    experiment = filmed(tmp_path, np.random.default_rng(0), truth)
    write_camera(read_camera(experiment.camera).model_copy(update={"pose": None}), experiment.camera)
    with pytest.raises(ValueError, match=r"camera\.json holds a lens and no pose.*linktwin track"):
        Eye.of(experiment)
