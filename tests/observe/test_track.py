import numpy as np
import pytest

from backend.observe.detect import Detections
from backend.observe.track import ConstantVelocity, Tracker
from backend.observe.uncertainty import difference_noise, point_covariance

RNG = np.random.default_rng(3)


def found(px):
    n = len(px)
    return Detections(np.asarray(px, float), np.zeros((n, 2, 2)), np.ones(n, bool), np.ones(n))


def follow(path, hidden=(), clutter=0, dt=1 / 240, acceleration=60 / 5e-4):
    """Names that a tracker gives to shuffled detections of a (frame, dot, 2) path; -1 where none."""
    tracker = Tracker(ConstantVelocity(0.0, path[0], acceleration), path.shape[1], 17.0)
    given = [np.arange(path.shape[1])]
    for k in range(1, len(path)):
        seen = np.array([m for m in range(path.shape[1]) if (k, m) not in hidden])
        order = RNG.permutation(len(seen))
        noise = RNG.uniform([0, 0], [1280, 720], (clutter, 2))
        index, _ = tracker.follow(k * dt, found(np.r_[path[k][seen][order], noise]))
        names = np.r_[seen[order], np.full(clutter, -2)]
        given.append(np.where(index >= 0, names[index], -1))
    return np.array(given)


def crossing():
    """Two dots that fly past each other 12 px apart at 2 m/s, and one that stands by."""
    t = np.arange(60)[:, None]
    right = np.concatenate([300 + 16.7 * t, 0 * t + 300], 1)
    left = np.concatenate([1300 - 16.7 * t, 0 * t + 312], 1)
    return np.stack([right, left, np.full_like(left, 500)], 1)


def test_dots_that_fly_past_each_other_keep_their_names():
    assert (follow(crossing()) == [0, 1, 2]).all()


def test_a_dot_hidden_for_twenty_frames_on_a_curve_is_known_again():
    t = np.arange(120)[:, None] / 240
    swing = np.concatenate([600 + 160 * np.sin(9 * t), 300 + 60 * np.cos(9 * t)], 1)
    path = np.stack([swing, swing + np.array([0, 150])], 1)
    given = follow(path, hidden={(k, 0) for k in range(50, 70)})
    assert (given[50:70, 0] == -1).all()
    assert (given[:, 1] == 1).all()
    assert (given[70:, 0] == 0).all()


def test_a_hidden_dots_wide_gate_does_not_rob_its_neighbour():
    path = np.stack([np.full((60, 2), 300.0), np.full((60, 2), 330.0)], 1)
    given = follow(path, hidden={(k, 0) for k in range(5, 55)})
    assert (given[:, 1] == 1).all()
    assert (given[5:55, 0] == -1).all()


def test_divided_differences_measure_noise_on_a_moving_dot_with_uneven_times():
    t = np.cumsum(RNG.uniform(3e-3, 6e-3, 4000))
    motion = np.stack([200 * np.sin(2 * t), 100 * np.cos(3 * t)], 1)
    noise = RNG.multivariate_normal([0, 0], [[2.5e-3, 1e-3], [1e-3, 1.6e-3]], len(t))
    cov = difference_noise(t, motion + noise, 3)
    # 4000 overlapping differences hold some 1300 independent ones: 4% of the variance, thrice allowed.
    np.testing.assert_allclose(cov, [[2.5e-3, 1e-3], [1e-3, 1.6e-3]], rtol=0.12)


def test_an_impact_does_not_pass_for_noise():
    t = np.arange(400) / 240
    bounce = np.stack([300 * np.abs(t - 0.8), 0 * t], 1)
    noise = RNG.normal(0, 0.05, (400, 2))
    assert np.sqrt(difference_noise(t, bounce + noise, 3)[0, 0]) < 0.065


def test_a_track_too_short_to_judge_gets_the_others_noise():
    t = np.arange(200) / 240
    px = RNG.normal(0, 0.05, (200, 2, 2))
    px[12:, 1] = np.nan
    single, whole = np.ones((200, 2, 2, 2)) * 1e-4 * np.eye(2), np.isfinite(px[..., 0])
    cov = point_covariance(t, px, single, whole)
    assert np.allclose(cov[0, 1], cov[0, 0], rtol=1e-12)
    assert 0.04 < np.sqrt(cov[0, 0, 0, 0]) < 0.07


def test_no_point_is_surer_than_the_two_ways_of_placing_it_agree():
    # A bare dot's surroundings mislead centroid and rim by tenths of a pixel for many pictures: no difference shows it.
    t = np.arange(200) / 240
    px = RNG.normal(0, 0.03, (200, 2, 2))
    single = np.full((200, 2, 1, 1), 1e-4) * np.eye(2)
    single[:, 1] = RNG.uniform(0.0, 0.18, (200, 1, 1)) * np.eye(2)  # px^2: 0.3 px rms
    cov = point_covariance(t, px, single, np.isfinite(px[..., 0]))
    assert np.sqrt(cov[:, 1, 0, 0].mean()) == pytest.approx(0.3, rel=0.1)
    assert np.sqrt(cov[:, 0, 0, 0].mean()) == pytest.approx(np.hypot(0.03, 0.02), rel=0.2)  # as before, and the floor


def test_a_short_clip_still_gets_a_covariance():
    px = np.zeros((3, 1, 2))
    cov = point_covariance(np.arange(3) / 30, px, np.full((3, 1, 2, 2), np.eye(2) * 1e-4), np.ones((3, 1), bool))
    assert np.isfinite(cov).all()
    assert np.sqrt(cov[0, 0, 0, 0]) >= 0.1


def test_a_dot_that_comes_back_the_other_way_is_followed_again():
    """A ball that swings out of the picture and returns: how fast it is now, nobody saw."""
    t = np.arange(120)[:, None] / 30
    ball = np.concatenate([900 * np.cos(2.6 * t) - 350, 0 * t + 300], 1)
    path = np.stack([ball, np.full_like(ball, 600)], 1)
    away = ball[:, 0] < 0
    given = follow(path, hidden={(k, 0) for k in np.flatnonzero(away).tolist()}, dt=1 / 30, acceleration=60 / 4e-3)
    assert (given[~away, 0] == 0).all()
    assert (given[:, 1] == 1).all()
