"""What of a record is noise, read from records whose noise is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.bumps import bumps_at
from backend.diagnose.latent import Latent, left_over, studentised
from backend.diagnose.noise import estimate, good_samples, strays
from backend.fit.measured import Channel, Measured


def record(rng, sigma=1e-3, memory=0.0, wrong=(), still=40, moving=200, channels=2):
    """A marker that stands still and then swings; AR(1) noise; `wrong` frames are thrown by ten sigmas."""
    times = np.arange(still + moving) / 100.0
    value, of = [], []
    for c in range(channels):
        e = rng.standard_normal(times.size)
        for i in range(1, times.size):
            e[i] = memory * e[i - 1] + np.sqrt(1 - memory**2) * e[i]
        e[list(wrong)] += 10.0
        since = np.maximum(times - still / 100.0, 0.0)
        value.append(0.1 * np.cos(7.0 * since + c) + sigma * e)
        of.append(np.full(times.size, c))
    names = tuple(Channel("marker:m", axis, 3 * c, "m", "static") for c, axis in enumerate(("x_m", "z_m")[:channels]))
    return Measured(
        np.tile(times, channels), np.concatenate(value), np.full(times.size * channels, sigma), np.concatenate(of),
        names, still / 100.0,
    )  # fmt: skip


@pytest.mark.parametrize("memory", [0.0, 0.4])
def test_static_frames_tell_the_size_of_the_noise_and_its_memory(memory):
    rng = np.random.default_rng(1)
    noise = estimate([record(rng, memory=memory) for _ in range(6)])
    # 480 samples: sd to 3% (5% with memory), memory to 0.05; three of each.
    assert noise.sigma[0][0] == pytest.approx(1e-3, rel=0.15)
    assert noise.memory["marker"].coefficient == pytest.approx(memory, abs=0.15)
    assert noise.memory["marker"].share == 1.0


@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_a_mark_that_slips_lends_its_drift_to_no_noise(memory):
    """Still for 0.4 s, it moves by four sigmas meanwhile; another does not."""
    rng = np.random.default_rng(4)
    data = [record(rng, memory=memory) for _ in range(6)]
    for d in data:
        d.value[d.channel == 0] += 1e-2 * d.time_s[d.channel == 0]
    noise = estimate(data)
    assert noise.sigma[0] == pytest.approx(np.full(480, 1e-3), rel=0.15)
    assert noise.memory["marker"].coefficient == pytest.approx(memory, abs=0.15)


def test_whitened_noise_is_independent_and_of_unit_size():
    rng = np.random.default_rng(2)
    data = [record(rng, memory=0.5) for _ in range(6)]
    noise = estimate(data)
    sizes, neighbours = [], []
    for i, d in enumerate(data):
        white = noise.whitening(d, i)
        since = np.maximum(d.time_s - d.release_s, 0.0)
        clean = 0.1 * np.cos(7.0 * since + d.channel)
        e = white(d.value) - white(clean)
        sizes.append(np.std(e))
        neighbours.append(np.mean(e[1:] * e[:-1]))
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.15)  # thirty such estimates scatter by 0.05
    assert abs(np.mean(neighbours)) < 0.2  # and by 0.06


def test_thrown_samples_are_found_and_good_ones_are_kept():
    rng = np.random.default_rng(3)
    thrown = (12, 77, 150, 151, 200)
    data = record(rng, wrong=thrown)
    bad = {round(100 * t) for t in data.time_s[~good_samples(data)]}
    assert set(thrown) - {150, 151} <= bad  # two in a row may hide each other
    assert len(bad - set(thrown)) <= 3


def test_a_motion_without_wrong_samples_loses_none():
    rng = np.random.default_rng(4)
    assert np.mean(~good_samples(record(rng))) < 0.01  # 3e-5 a sample are expected


def test_a_wild_sample_in_the_first_still_frame_neither_counts_nor_widens_the_noise():
    rng = np.random.default_rng(5)
    data = [record(rng, wrong=(0,) if i == 0 else ()) for i in range(3)]
    noise = estimate(data)
    first = data[0].time_s == 0.0
    assert not noise.keep[0][first].any()
    assert np.mean(~noise.keep[1]) < 0.02
    assert noise.sigma[0][0] == pytest.approx(1e-3, rel=0.2)  # ten sigmas in one of 240 would add 18%


@pytest.mark.parametrize("at", [0, 1, -2, -1])
def test_a_wild_sample_at_an_end_of_the_motion_is_found(at):
    rng = np.random.default_rng(6)
    wild = at % 240
    data = record(rng, wrong=(wild,))
    assert wild in {round(100 * t) for t in data.time_s[~good_samples(data)]}


def test_a_shift_that_follows_a_wild_last_sample_does_not_excuse_it():
    rng = np.random.default_rng(7)
    time = np.arange(120.0)
    fitted: Any = SimpleNamespace(r=rng.standard_normal(120), J=np.ones((120, 1)))
    fitted.r[-1] = 10.0
    latent = Latent({"marker:m": bumps_at(time, 119.0, 24)}, {"marker:m": 1.0})
    assert not strays(left_over(fitted, latent))[-1]
    assert np.flatnonzero(strays(studentised(fitted, latent))).tolist() == [119]


@pytest.mark.parametrize(("size", "found"), [(3.0, False), (3.6, True)])
def test_two_coordinates_that_are_both_far_off_are_as_wild_as_one_that_is_farther(size, found):
    left = np.random.default_rng(8).uniform(-1.5, 1.5, 400)
    left[[50, 250]] = size, -size
    together = np.tile(np.arange(200), 2)  # x of every frame, then y of every frame
    assert not strays(left).any()
    assert np.flatnonzero(strays(left, together)).tolist() == ([50, 250] if found else [])


def test_noise_is_as_seldom_taken_for_wild_in_two_coordinates_as_in_one():
    left = np.random.default_rng(9).standard_normal(2_000_000)
    alone, both = strays(left).mean(), strays(left, np.arange(left.size) // 2).mean()
    assert 0.5e-5 < alone < 3e-5  # two sides of 4.3 sd: 1.7e-5
    assert 0.5e-5 < both < 3e-5


def test_still_frames_that_repeat_to_the_last_digit_leave_the_sigma_of_the_record():
    rng = np.random.default_rng(7)
    data = [record(rng, sigma=0.0) for _ in range(3)]
    for d in data:
        d.sigma[:] = 2e-4  # as the motion told
    noise = estimate(data)
    assert all(np.all(sigma == 2e-4) for sigma in noise.sigma)
    assert np.all(np.isfinite(noise.whitening(data[0], 0).gain))


def test_a_load_cell_does_not_take_over_an_encoders_noise():
    rng = np.random.default_rng(8)
    data = []
    for _ in range(4):
        d = record(rng, sigma=1e-3, still=40)
        channels = (Channel("joint:a", "q", 0, "rad", "static"), Channel("joint:a", "effort", 1, "N m", "static"))
        value = np.where(d.channel == 1, 100.0 * d.value, d.value)
        data.append(Measured(d.time_s, value, np.where(d.channel == 1, 0.1, 1e-3), d.channel, channels, d.release_s))
    noise = estimate(data)
    assert noise.sigma[0][data[0].channel == 0][0] == pytest.approx(1e-3, rel=0.2)
    assert noise.sigma[0][data[0].channel == 1][0] == pytest.approx(0.1, rel=0.2)
