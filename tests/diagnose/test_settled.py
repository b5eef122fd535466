"""Pins that lay to a side of their holes before the release."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose.noise import estimate
from tests.diagnose.test_diagnosis import COARSE_S, drawing, study
from tests.diagnose.test_noise import record

__all__ = ["drawing"]  # a fixture

SAGGED_M = 2e-3

pytestmark = pytest.mark.timeout(600)


def test_rows_are_white_where_samples_vary_along_given_ways_as_well():
    rng = np.random.default_rng(3)
    data = record(rng, still=10, moving=6)
    white = estimate([data]).whitening(data, 0)
    ways = rng.standard_normal((data.value.size, 2)) * 3e-3
    wide, off = white.beside(ways), rng.standard_normal(data.value.size) * 1e-3
    along = white(ways)
    covariance = np.eye(white.keep.size) + along @ along.T
    assert np.sum(wide(off) ** 2) == pytest.approx(white(off) @ np.linalg.solve(covariance, white(off)), rel=1e-9)
    assert wide.log_width == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1], rel=1e-9)


@pytest.fixture(scope="module")
def sagged(drawing):
    """A bar on a loose pin, which the frames before the release show 2 mm lower than the motion begins."""
    from backend.diagnose.library import library
    from backend.diagnose.subject import prepare
    from backend.effects.catalogue import catalogue

    told = study(drawing, 1, frames=12)
    for e in told.experiments:
        assert e.tracks is not None
        e.tracks.loc[e.tracks.time_s < e.release.time_s, "z_m"] -= SAGGED_M
    other = frozenset(set(catalogue()) - {"clearance", "mass_error"})
    return prepare(told, library(drawing, "clearance", (), other), COARSE_S)


def test_a_loose_pin_lets_a_held_bar_lie_anywhere_in_its_plane(sagged):
    from backend.diagnose.settled import lying

    (probe, *_) = sagged.fit
    ways, still = lying(probe, ("j1",)), probe.data.still
    assert ways.shape == (still.size, 3)
    assert not np.any(ways[~still])
    upright = np.array([c.coordinate == "z_m" for c in probe.data.channels])[probe.data.channel]
    for lower in (upright, ~upright):  # by a millimetre, or aside
        moved = np.where(still & lower, 1e-3, 0.0)
        assert np.abs(moved - ways @ np.linalg.lstsq(ways, moved, rcond=None)[0]).max() < 1e-9
    stretched = np.where(still & (probe.data.channel == 0), 1e-3, 0.0)
    assert np.abs(stretched - ways @ np.linalg.lstsq(ways, stretched, rcond=None)[0]).max() > 1e-4


def test_frames_that_lie_aside_all_alike_are_told_from_noise():
    from backend.diagnose.settled import aside

    rng = np.random.default_rng(0)
    still = [np.tile([True, False], 80)] * 4
    channel = [np.repeat([0, 1], 80)] * 4
    noise = [[rng.standard_normal(160) for _ in still] for _ in range(200)]
    told = np.array([aside(left, still, channel) for left in noise])
    assert np.mean(told < 0.05) == pytest.approx(0.05, abs=0.04)
    # Half a deviation in two experiments of four adds an eighth to the mean square, 1.6 of its own deviations.
    off = [0.5 * h for h in still[:2]] + [np.zeros(160)] * 2
    found = [aside([r + o for r, o in zip(left, off, strict=True)], still, channel) for left in noise]
    assert np.mean(np.array(found) < 1e-3) > 0.9
    assert aside([3.0 * r for r in noise[0]], still, channel) > 1e-3  # all is missed alike
    assert (
        aside(noise[0], [np.ones(160, bool)] * 4, channel) == aside(noise[0], [np.zeros(160, bool)] * 4, channel) == 1.0
    )


@pytest.mark.nightly
def test_frames_before_the_release_may_lie_off_where_a_pin_is_loose(sagged):
    from backend.diagnose.fitted import fit, log_evidence, start_of

    (play,) = (c for c in sagged.library.candidates if c.name == "clearance:j1")
    choice = sagged.choose(play)
    begin = start_of(sagged, choice)
    begin[0] = 1e-5
    fixed = fit(sagged, choice, start=begin, max_iterations=4)
    assert fixed.unsettled
    lain = fit(sagged, sagged.choose(play.settling(SAGGED_M)), start=begin, max_iterations=4)
    assert not lain.unsettled
    assert log_evidence(lain) > log_evidence(fixed) + 30.0
    assert lain.log_width > 0.0


def test_a_play_is_as_open_as_a_softer_wall_leaves_it(monkeypatch):
    from backend.diagnose import verdict

    def fitted(**values):
        numbers = [SimpleNamespace(name=name) for name in values]
        choice = SimpleNamespace(parameters=numbers)
        return SimpleNamespace(
            choice=choice, values=np.array([*values.values()]), subject=SimpleNamespace(mechanism=None)
        )

    monkeypatch.setattr(verdict, "scaled", lambda made, scale: made)
    monkeypatch.setattr(verdict, "deviations_of_noise", lambda made: np.array([3e-5, 400.0]))
    monkeypatch.setattr(verdict, "guesses", lambda mechanism, parameters, values: np.zeros(2))
    soft: Any = SimpleNamespace(fitted=fitted(play=2e-4, stiffness=3000.0), otherwise=fitted(play=6e-4))
    assert verdict._deviations(soft, False, 1.0, 1.0) == pytest.approx([np.hypot(3e-5, 4e-4), 400.0])
    stiff: Any = SimpleNamespace(fitted=soft.fitted, otherwise=None)
    assert verdict._deviations(stiff, False, 1.0, 1.0) == pytest.approx([3e-5, 400.0])
