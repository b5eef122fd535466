"""Markers that were taken for something else for a few frames, beside motions that turn sharply."""

import numpy as np
import pytest

from backend.diagnose.bursts import LONGEST, bursts, jumps
from backend.fit.measured import Channel, Measured

RATE_HZ, SIGMA_M, AWAY_M = 150.0, 5e-4, 0.03
TIME_S = np.arange(300) / RATE_HZ


def path(seed: int, turning: bool = False) -> np.ndarray:
    """(frames, 2): swings, or goes to and fro between walls that throw it back at 3 m/s."""
    swing = 0.2 * np.sin(6.0 * TIME_S + seed)
    across = np.abs((3.0 * TIME_S + 0.1 * seed) % 0.8 - 0.4) if turning else 0.1 * np.cos(9.0 * TIME_S)
    return np.stack([swing, across], 1) + SIGMA_M * np.random.default_rng(seed).standard_normal((300, 2))


@pytest.mark.parametrize("size", [2, 3, 7, LONGEST])
def test_a_stretch_that_stands_elsewhere_is_found_and_nothing_else(size):
    place, here = path(1), slice(120, 120 + size)
    place[here] += AWAY_M * np.array([0.6, -0.8])
    assert np.array_equal(np.flatnonzero(jumps(TIME_S, place)), np.arange(here.start, here.stop))


@pytest.mark.parametrize("turning", [False, True], ids=["swinging", "thrown back"])
def test_a_motion_is_no_stretch_however_sharply_it_turns(turning):
    assert not any(jumps(TIME_S, path(seed, turning)).any() for seed in range(20))


def test_frames_missing_within_a_stretch_do_not_hide_it():
    place = path(2)
    place[100:107] += AWAY_M
    seen = np.delete(np.arange(300), [102, 103, 150])
    assert np.array_equal(seen[jumps(TIME_S[seen], place[seen])], [100, 101, 104, 105, 106])


@pytest.mark.parametrize(("moved", "found"), [(("a",), True), (("a", "b", "c", "d"), False)])
def test_what_jumps_with_most_others_is_the_mechanism_or_the_camera(moved, found):
    paths = {id: path(seed) for seed, id in enumerate("abcd")}
    for id in moved:
        paths[id][60:64] += AWAY_M
    data = measured(paths)
    wild = bursts(data, np.ones(data.value.size, bool))
    expected = np.isin(data.channel, [0, 1]) & np.isin(data.time_s, TIME_S[60:64]) if found else np.zeros(wild.size)
    assert np.array_equal(wild, expected)


def measured(paths: dict[str, np.ndarray]) -> Measured:
    named = [(id, axis) for id in paths for axis in "xz"]
    channels = tuple(Channel(f"marker:{id}", f"{a}_m", k, "m", "given") for k, (id, a) in enumerate(named))
    value = np.concatenate([p[:, k] for p in paths.values() for k in range(2)])
    time_s, channel = np.tile(TIME_S, len(named)), np.repeat(np.arange(len(named)), TIME_S.size)
    return Measured(time_s, value, np.full(value.size, SIGMA_M), channel, channels, 0.0)
