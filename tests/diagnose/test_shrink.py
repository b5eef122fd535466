"""How far a gap shrinks, where experiments measure in several units and motions are lost."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import judgement, shrink, verdict
from backend.diagnose.shrink import gap_power, shrinkage
from backend.fit.measured import Channel, Measured

TIMES = np.arange(120) / 60.0


def seen(miss_m, miss_rad=0.0, sigma=1e-3, lost_after=None) -> shrink.Test:
    """A marker that swings by 0.1 m, and an encoder; both missed by a wave of this size."""
    wave = np.sin(9.0 * TIMES)
    channels = (Channel("marker:m", "x_m", 0, "m", "given"), Channel("joint:j", "q", 1, "rad", "given"))
    value = np.concatenate([0.1 * np.cos(5.0 * TIMES), 0.5 * np.cos(5.0 * TIMES)])
    channel = np.repeat([0, 1], TIMES.size)
    data = Measured(np.tile(TIMES, 2), value, np.full(value.size, sigma), channel, channels, 0.0)
    probe: Any = SimpleNamespace(data=data, since_release_s=np.tile(TIMES, 2))
    miss = np.concatenate([miss_m * wave, miss_rad * wave])
    if lost_after is not None:
        miss[np.tile(TIMES, 2) > lost_after] = np.nan
    allowed = np.full(value.size, sigma**2)
    return shrink.Test(probe, np.arange(value.size), miss, allowed, np.full(value.size, sigma), value - miss)


def test_a_gap_of_markers_and_encoders_is_told_in_metres_alone():
    power = gap_power([seen(0.02, miss_rad=5.0)])
    assert power[:, 2].sum() == TIMES.size
    assert np.sqrt(power[:, 0].sum() / TIMES.size) == pytest.approx(0.02 / np.sqrt(2), rel=0.1)


def test_a_cause_that_loses_the_motion_does_not_pass_for_one_that_explains_it():
    rng = np.random.default_rng(0)
    kept = shrinkage([seen(0.02)], [seen(0.0)], rng)
    lost = shrinkage([seen(0.02)], [seen(0.0, lost_after=0.5)], rng)
    assert kept is not None
    assert kept.explained == pytest.approx(1.0, abs=0.02)
    assert lost is not None
    assert lost.explained is not None
    assert lost.explained < 0.0  # where it was lost the mark has come 0.1 m from its start, and more
    never = shrinkage([seen(0.02, lost_after=-1.0)], [seen(0.0)], rng)
    assert never is not None
    assert np.isfinite([never.before, never.after, never.noise]).all()


def test_what_nobody_could_foretell_does_not_drown_what_is_explained():
    """Late in the motion its start is grown eighty times in variance, and both models miss what that leaves open."""
    late = np.tile(TIMES, 2) > 1.0
    explained = []
    for seed in range(20):
        open_m = np.random.default_rng(seed).standard_normal(late.size) * np.where(late, 0.009, 0.0)
        drawn, made = (grown(seen(miss), open_m, late) for miss in (0.005, 0.0))
        told = shrinkage([drawn], [made], np.random.default_rng(0))
        assert told is not None
        assert told.after > 0.005  # the picture of what is left hides nothing
        explained.append(told.explained)
    assert np.min(explained) > 0.95


def grown(test, open_m, late):
    allowed = test.allowed * np.where(late, 81.0, 1.0)
    return dataclasses.replace(test, miss=test.miss + open_m, allowed=allowed)


def test_a_fitted_gap_is_told_in_its_own_unit_or_not_at_all():
    made = seen(0.02, miss_rad=0.3)
    data = made.probe.data
    angles = np.flatnonzero(data.channel == 1)
    encoder = Measured(data.time_s[angles], data.value[angles], data.sigma[angles], np.zeros(120, int),
                       data.channels[1:], 0.0)  # fmt: skip
    predicted = made.predicted[angles]
    probe: Any = SimpleNamespace(data=encoder, predict=lambda values, own: (predicted, None))
    subject: Any = SimpleNamespace(fit=[probe], noise=SimpleNamespace(keep=[np.ones(120, bool)], sigma=[encoder.sigma]))
    cause: Any = SimpleNamespace(fitted=SimpleNamespace(fraction=1.0, whole=[probe], values=(), own=lambda i: ()))
    assert verdict._fit_remainder(subject, cause, cause, 1.0, "m") is None
    told = verdict._fit_remainder(subject, cause, cause, 1.0, "rad")
    assert told is not None
    assert told.before_rms_m == pytest.approx(0.3 / np.sqrt(2), rel=0.1)


@pytest.mark.parametrize(("held_out", "words"), [([], "No experiment was held out"), ([1], "sample after its release")])
def test_what_is_not_tested_is_said_with_its_reason(held_out, words):
    subject: Any = SimpleNamespace(held_out=held_out, fit=[1, 2])
    (said,) = judgement.inconclusive(subject, "identified", None)
    assert words in said


def test_where_nothing_moves_there_is_nothing_to_explain():
    still = seen(0.0)
    data = Measured(TIMES, np.zeros(120), np.ones(120), np.zeros(120, int), (still.probe.data.channels[0],), 9.0)
    probe: Any = SimpleNamespace(data=data, since_release_s=TIMES - 9.0)
    none = shrink.Test(probe, np.arange(120), np.zeros(120), np.ones(120), np.ones(120), np.zeros(120))
    assert shrinkage([none], [none], np.random.default_rng(0)) is None
