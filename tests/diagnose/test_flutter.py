"""A sticker that flutters is found at its frequency; noise, slow drifts and a shaking picture are not its flutter."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.flutter import flutters

RATE, SECONDS, BUMPS, RUNS = 60.0, 1.8, 12, 3
MARKERS = ("marker:a", "marker:b", "marker:c")
TIME = np.arange(int(SECONDS * RATE)) / RATE + 0.5 / RATE


def left(rows: dict[tuple[int, str, str], np.ndarray], markers: tuple[str, ...] = MARKERS) -> Any:
    """A fit of `RUNS` experiments that left these rows of unit noise, by run, marker and axis."""
    channels = [SimpleNamespace(at=m, coordinate=a) for m in markers for a in ("x_m", "z_m")]
    size = TIME.size * len(channels)
    white = SimpleNamespace(keep=np.arange(size))
    data = SimpleNamespace(
        channels=channels, channel=np.repeat(np.arange(len(channels)), TIME.size), time_s=np.tile(TIME, len(channels))
    )
    probe = SimpleNamespace(
        data=data, since_release_s=data.time_s, duration_s=SECONDS, bumps=np.zeros((1, BUMPS)), lying=None
    )
    noise = SimpleNamespace(whitening=lambda data, run, fraction: white)
    return SimpleNamespace(
        subject=SimpleNamespace(noise=noise), probes=[probe] * RUNS, fraction=1.0,
        rows=[slice(i * size, (i + 1) * size) for i in range(RUNS)],
        r=np.concatenate([rows[i, c.at, c.coordinate] for i in range(RUNS) for c in channels]),
    )  # fmt: skip


def noise(seed: int, memory: float = 0.0, markers: tuple[str, ...] = MARKERS) -> dict[tuple[int, str, str], np.ndarray]:
    rng, made = np.random.default_rng(seed), {}
    for key in [(i, m, a) for i in range(RUNS) for m in markers for a in ("x_m", "z_m")]:
        e = rng.standard_normal(TIME.size)
        for k in range(1, e.size):
            e[k] = memory * e[k - 1] + np.sqrt(1.0 - memory**2) * e[k]
        made[key] = e
    return made


@pytest.mark.parametrize("markers", [MARKERS, MARKERS[:1]])
def test_a_sticker_that_flutters_is_named_with_its_frequency(markers: tuple[str, ...]):
    rows = noise(1, 0.2, markers)
    for i in range(RUNS):
        rows[i, "marker:a", "x_m"] += 1.3 * np.sin(2.0 * np.pi * 6.1 * TIME + i)
    assert flutters(left(rows, markers), markers) == {"marker:a": pytest.approx(6.1, abs=0.2)}


def test_a_loud_flutter_is_named_with_its_frequency_too():
    rows = noise(5)
    for i in range(RUNS):
        rows[i, "marker:a", "x_m"] += 40.0 * np.sin(2.0 * np.pi * 2.4 * TIME + i)
    assert flutters(left(rows), MARKERS) == {"marker:a": pytest.approx(2.4, abs=0.2)}


def test_a_sticker_that_flutters_as_slowly_as_bumps_follow_is_named_beside_a_swing_that_all_lack():
    rows = noise(4)
    for (_, marker, _), e in rows.items():
        e += {"marker:a": 1.0, "marker:b": 2.0, "marker:c": 1.5}[marker] * np.sin(2.0 * np.pi * 1.3 * TIME)
    for i in range(RUNS):
        rows[i, "marker:a", "x_m"] += 1.3 * np.sin(2.0 * np.pi * 2.4 * TIME + i)
    assert flutters(left(rows), MARKERS) == {"marker:a": pytest.approx(2.4, abs=0.3)}


@pytest.mark.parametrize("memory", [0.0, 0.4])
def test_noise_does_not_flutter(memory: float):
    assert [flutters(left(noise(seed, memory)), MARKERS) for seed in range(60)] == [{}] * 60


def test_what_all_markers_do_and_what_drifts_is_no_flutter():
    shaken, drifting = noise(2), noise(3)
    for (_, marker, _), e in shaken.items():
        e += (1.5 if marker == "marker:a" else 1.0) * np.sin(2.0 * np.pi * 6.1 * TIME)
    for i in range(RUNS):
        drifting[i, "marker:a", "x_m"] += 20.0 * (1.0 - np.exp(-TIME / SECONDS))
    assert flutters(left(shaken), MARKERS) == {}
    assert flutters(left(drifting), MARKERS) == {}
