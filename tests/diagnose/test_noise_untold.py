"""Noise that neither tables nor still frames tell, sized by what nothing smooth explains."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.diagnose import noise_untold
from backend.diagnose.noise import Noise
from tests.diagnose.test_noise import record

TOLD, TRUE = 0.13e-3, 0.3e-3  # by third differences, and what it is


def left_by(memory: float, lasting: float, source: str, monkeypatch) -> tuple[bool, Noise, Noise]:
    """What is learnt of noise of which `memory` is left from sample to sample, with a slow misfit as large as
    `lasting` beside it.
    """
    rng = np.random.default_rng(4)
    data = [record(rng, sigma=TRUE, memory=memory, still=0, moving=300) for _ in range(3)]
    data = [replace(d, channels=tuple(replace(c, noise=source) for c in d.channels)) for d in data]
    off = [d.value - 0.1 * np.cos(7.0 * d.time_s + d.channel) + lasting * np.sin(20.0 * d.time_s) for d in data]
    mine, theirs = (
        Noise(tuple(np.full(d.value.size, TOLD) for d in part), {}, tuple(np.ones(d.value.size, bool) for d in part))
        for part in (data[:2], data[2:])
    )
    theirs = replace(theirs, memory=mine.memory)
    probes = [SimpleNamespace(data=d) for d in data]
    subject = SimpleNamespace(noise=mine, held_noise=theirs, fit=probes[:2], held_out=probes[2:])
    white = [SimpleNamespace(keep=np.arange(d.value.size)) for d in data[:2]]
    rows = (slice(0, data[0].value.size), slice(data[0].value.size, 2 * data[0].value.size))
    monkeypatch.setattr(noise_untold, "Seer", lambda *asked: SimpleNamespace(white=white, rows=rows))
    monkeypatch.setattr(noise_untold, "left_over", lambda *asked: np.concatenate(off[:2]) / TOLD)
    fitted: Any = SimpleNamespace(subject=subject, probes=probes[:2], fraction=1.0)
    latent: Any = None
    return noise_untold.size_up(fitted, latent), mine, theirs


def test_an_error_that_fades_from_sample_to_sample_is_noise(monkeypatch):
    learnt, mine, theirs = left_by(0.7, 0.0, "third_difference", monkeypatch)
    assert learnt
    assert mine.memory["marker"].coefficient == pytest.approx(0.7, abs=0.08)
    for noise in (mine, theirs):
        assert np.concatenate(noise.sigma) == pytest.approx(TRUE, rel=0.1)


@pytest.mark.parametrize(
    ("memory", "lasting", "source"),
    [(0.7, 0.0, "given"), (0.0, 2.0 * TRUE, "third_difference"), (0.7, 2.0 * TRUE, "third_difference")],
    ids=["the tables tell it", "a misfit in white noise", "a misfit in noise with a memory"],
)
def test_what_lasts_or_is_told_is_none(monkeypatch, memory, lasting, source):
    learnt, mine, _ = left_by(memory, lasting, source, monkeypatch)
    assert not learnt
    assert not mine.memory
    assert np.concatenate(mine.sigma) == pytest.approx(TOLD)
