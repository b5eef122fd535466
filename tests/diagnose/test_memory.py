"""Noise of which a part fades over several frames and the rest is new in each."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import noise_learnt
from backend.diagnose.memory import Memory, Series, bettered, remembered
from backend.diagnose.noise import Noise
from tests.diagnose.test_noise import record

SLOW = Memory(0.85, 0.3)


def noise(rng, memory: Memory, count: int, samples: int) -> list[np.ndarray]:
    made = []
    for _ in range(count):
        e, slow = rng.standard_normal((2, samples))
        for i in range(1, samples):
            slow[i] = memory.coefficient * slow[i - 1] + np.sqrt(1.0 - memory.coefficient**2) * slow[i]
        made.append(np.sqrt(memory.share) * slow + np.sqrt(1.0 - memory.share) * e)
    return made


def plain(series) -> float:
    """Correlation of neighbours, near enough."""
    return float(sum(s[1:] @ s[:-1] for s in series) / sum(s @ s for s in series))


def test_a_slow_part_beside_a_white_one_is_told_from_still_frames():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(20):
        series = [s - s.mean() for s in noise(rng, SLOW, 40, 40)]
        found.append(remembered(series, [np.arange(40.0)] * 40, plain(series)))
    assert np.mean([m.share < 1.0 for m in found]) > 0.9
    slow = [m for m in found if m.share < 1.0]
    assert np.median([m.coefficient for m in slow]) == pytest.approx(SLOW.coefficient, abs=0.05)
    assert np.median([m.share for m in slow]) == pytest.approx(SLOW.share, abs=0.06)


@pytest.mark.parametrize("coefficient", [0.0, 0.4])
def test_noise_of_one_kind_gets_no_second_part(coefficient):
    rng = np.random.default_rng(2)
    found = []
    for _ in range(20):
        series = [s - s.mean() for s in noise(rng, Memory(coefficient), 40, 40)]
        found.append(remembered(series, [np.arange(40.0)] * 40, coefficient))
    assert np.mean([m.share == 1.0 for m in found]) >= 0.9


def test_still_frames_that_repeat_remember_nothing():
    assert not remembered([np.zeros(40)] * 3, [np.arange(40.0)] * 3, 0.0)


def series(rng, memory: Memory, count: int, samples: int) -> Series:
    return Series.of(noise(rng, memory, count, samples), [np.arange(float(samples))] * count)


def slow_power(memory: Memory) -> float:
    """Of noise of unit sd, far slower than its memory."""
    return 1.0 - memory.share + memory.share * (1.0 + memory.coefficient) / (1.0 - memory.coefficient)


def test_long_records_tell_of_slow_noise_what_a_few_still_frames_leave_open():
    rng, true = np.random.default_rng(4), Memory(0.8, 0.7)
    before, after = [], []
    for _ in range(12):
        short, long = series(rng, true, 60, 20), series(rng, true, 60, 200)
        known = remembered([*short.groups[0][1].T], [np.arange(20.0)] * 60, 0.6)
        before.append(short.sd(known) ** 2 * slow_power(known))
        found = bettered(known, short, long, 3.0)
        after.append(short.sd(found) ** 2 * slow_power(found))
    off = lambda told: float(np.sqrt(np.mean(np.log(np.array(told) / slow_power(true)) ** 2)))  # noqa: E731
    assert off(after) < 0.15
    assert off(after) < 0.5 * off(before)


def test_what_long_records_hold_besides_noise_moves_its_memory_no_farther_than_still_frames_leave_it_open():
    rng, true, missed = np.random.default_rng(5), Memory(0.6, 0.5), Memory(0.97, 0.9)
    short, long = series(rng, true, 60, 20), series(rng, missed, 60, 200)
    found = bettered(true, short, long, 3.0)
    assert found.coefficient > true.coefficient
    assert short.surprise(found) < short.surprise(true) + 3.1
    assert short.surprise(missed) > short.surprise(true) + 30.0


@pytest.mark.parametrize(("left", "betters"), [(1.05, True), (1.5, False)], ids=["noise", "a gap"])
def test_a_memory_beside_a_white_part_is_bettered_where_nearly_all_that_is_left_is_noise(monkeypatch, left, betters):
    rng, true, known = np.random.default_rng(6), Memory(0.8, 0.7), Memory(0.6, 0.6)
    values = noise(rng, true, 40, 200)
    channels = [SimpleNamespace(at=f"marker:m{k}", unit="m", noise="estimated") for k in range(20)]
    channels[3] = SimpleNamespace(at="marker:m3", unit="m", noise="given")
    runs = []
    for one in (values[:20], values[20:]):
        data = SimpleNamespace(
            channels=channels, channel=np.repeat(np.arange(20), 200), time_s=np.tile(np.arange(200) / 100.0, 20),
            value=np.concatenate(one), still=np.tile(np.arange(200) < 30, 20),
        )  # fmt: skip
        runs.append(SimpleNamespace(data=data, predict=lambda values, own: (np.full(4000, 7.0),)))
    sigma, held = ([np.full(4000, 0.8)] * 2, [np.full(4000, 0.8)])
    keep = [np.ones(4000, bool)] * 2
    subject = SimpleNamespace(
        noise=SimpleNamespace(memory={"marker": known}, sigma=[s.copy() for s in sigma], keep=keep),
        held_noise=SimpleNamespace(sigma=[s.copy() for s in held]), fit=runs, held_out=runs[:1],
    )  # fmt: skip
    fitted: Any = SimpleNamespace(
        subject=subject, probes=runs, fraction=1.0, r=np.zeros(8000), chi2=left * 8000, values=None, own=lambda i: None
    )
    monkeypatch.setattr(noise_learnt, "Seer", lambda *asked: SimpleNamespace(white=[], rows=[]))
    monkeypatch.setattr(noise_learnt, "left_over", lambda fitted, latent: np.ones(8000))
    latent: Any = None
    assert noise_learnt.remember(fitted, latent) == betters
    if betters:
        assert subject.noise.memory["marker"].coefficient == pytest.approx(true.coefficient, abs=0.06)
    for one in (*subject.noise.sigma, *subject.held_noise.sigma):
        told = np.repeat(np.arange(20), 200) == 3
        assert np.all(one[told] == 0.8)
        assert np.all(one[~told] == one[0])
        assert (one[0] > 0.8) == betters


def test_whitening_is_that_of_the_whole_covariance_across_gaps():
    rng = np.random.default_rng(3)
    data = record(rng, still=8, moving=12)
    keep = np.ones(data.value.size, bool)
    keep[[5, 6, 27]] = False
    sigma = np.where(data.channel == 0, 1e-3, 2e-3) * (1.0 + 0.1 * np.arange(data.value.size) / data.value.size)
    white = Noise((sigma,), {"marker": SLOW}, (keep,)).whitening(data, 0)
    assert not np.isin([5, 6, 27], white.keep).any()
    time, channel = data.time_s[white.keep], data.channel[white.keep]
    apart = np.abs(time[:, None] - time) * 100.0
    alike = SLOW.share * SLOW.coefficient**apart * (channel[:, None] == channel)
    covariance = (alike + (1.0 - SLOW.share) * np.eye(time.size)) * np.outer(sigma[white.keep], sigma[white.keep])
    rows = white(np.eye(data.value.size))[:, white.keep]
    np.testing.assert_allclose(rows @ covariance @ rows.T, np.eye(time.size), atol=1e-12)
    cube = rng.standard_normal((data.value.size, 2, 3))
    np.testing.assert_allclose(white(cube), np.einsum("ij,jkl->ikl", rows, cube[white.keep]), atol=1e-9)


@pytest.mark.parametrize(
    ("still", "more", "open_"), [(900, 0.23, True), (900, 0.05, False), (20, 0.23, False)],
    ids=["far more than they leave open", "as they leave open", "too few to tell"],
)  # fmt: skip
def test_the_memory_that_still_frames_tell_is_bettered_as_far_as_they_leave_it_open(monkeypatch, still, more, open_):
    """What a drawing misses has a memory of its own."""
    rows = 2000
    data = SimpleNamespace(
        channels=[SimpleNamespace(at="marker:m", unit="m")], channel=np.zeros(rows, int),
        time_s=np.arange(rows) / 100.0, still=np.arange(rows) < still,
    )  # fmt: skip
    noise = SimpleNamespace(memory={"marker": Memory(0.5)})
    fitted: Any = SimpleNamespace(
        subject=SimpleNamespace(noise=noise), probes=(SimpleNamespace(data=data),), fraction=1.0, r=np.zeros(rows)
    )
    seer = SimpleNamespace(white=[SimpleNamespace(keep=np.arange(rows))], rows=(slice(0, rows),))
    monkeypatch.setattr(noise_learnt, "Seer", lambda *asked: seer)
    monkeypatch.setattr(noise_learnt, "left_over", lambda fitted, latent: np.full(rows, 1.1))
    monkeypatch.setattr(noise_learnt, "neighbour_correlation", lambda fitted, latent, follows: more)
    latent: Any = None
    assert noise_learnt.remember(fitted, latent)
    told = noise_learnt.OPEN * np.sqrt(0.75 / still)
    assert noise.memory["marker"].coefficient == pytest.approx(0.5 + (told if open_ else more))
