import numpy as np

from backend.observe.stretch import stretch_factor

RNG = np.random.default_rng(8)


def bar(noise, frames=400, readout_s=0.0):
    """Two dots 100 mm apart on a bar that swings 1 rad at 2 Hz; each frame reads the second one later."""
    t = np.arange(frames)[:, None] / 240 + readout_s * np.array([0.0, 1.0])
    angle = np.sin(2 * np.pi * 2 * t)
    at = np.array([0.02, 0.12])[None, :, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return at + noise, t


def test_white_noise_of_the_stated_size_needs_no_factor():
    at, t = bar(RNG.normal(0, 2e-5, (400, 2, 2)))
    assert stretch_factor(at, t, np.full((400, 2), 2e-5), ["bar", "bar"]) < 1.2  # 400 distances: 7%


def test_errors_that_last_for_many_pictures_are_counted():
    steps = RNG.normal(0, 6e-5, (40, 2, 2)).repeat(10, axis=0)  # differences along a track would not see these
    at, t = bar(RNG.normal(0, 2e-5, (400, 2, 2)) + steps)
    factor = stretch_factor(at, t, np.full((400, 2), 2e-5), ["bar", "bar"])
    assert 6 < factor < 14  # 10 = 1 + 3², from 40 independent errors a dot


def test_a_rolling_shutter_does_not_stretch_bars():
    at, t = bar(RNG.normal(0, 2e-5, (400, 2, 2)), readout_s=1e-3)  # 1 ms at 1.5 m/s is 1.5 mm
    assert stretch_factor(at, t, np.full((400, 2), 2e-5), ["bar", "bar"]) < 1.4


def test_dots_that_the_drawing_wrongly_puts_on_one_bar_say_nothing():
    at, t = bar(0.0)
    at[:, 1] += 0.02 * np.sin(t[:, :1])
    assert stretch_factor(at, t, np.full((400, 2), 2e-5), ["bar", "bar"]) == 1.0


def test_dots_on_different_bodies_say_nothing():
    at, t = bar(RNG.normal(0, 1e-3, (400, 2, 2)))
    assert stretch_factor(at, t, np.full((400, 2), 2e-5), ["one", "other"]) == 1.0
