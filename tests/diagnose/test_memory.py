"""Noise of which a part fades over several frames and the rest is new in each."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import noise_learnt
from backend.diagnose.memory import Memory, remembered
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
