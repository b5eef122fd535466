"""A carriage driven by a known force, its friction fitted in a form that is not quite right: intervals hold the truth.

The truth is viscous and dry friction and a constant pull; beside them acts what the fit does not know: a ripple along
the rail that averages out, or friction that rises towards rest.  Explicit steps of a
millisecond; nothing of the engine is used.
"""

import numpy as np
import pytest

from backend.diagnose.independent import independent
from backend.diagnose.wrong_form import apart

TRUTH = np.array([203.0, 20.4, 3.0])  # N s/m, N, N
MASS_KG, STEP_S, DURATION_S, SAMPLES, SIGMA_M = 95.0, 2e-3, 12.0, 1200, 1e-5
CREEP = 0.004  # m/s, over which dry friction turns over
TIME_S = np.arange(0.0, DURATION_S + 0.5 * STEP_S, STEP_S)
DRIVE_N = 60 * np.sin(2.2 * TIME_S) * (1 + 0.5 * np.sin(0.7 * TIME_S)) + 25 * np.sign(np.sin(5.0 * TIME_S + 0.3))


def paths(values, forces):
    """(T, k) of carriages side by side, each with a force of its own against its motion: f(q, v) or an array."""
    q, v = np.zeros(len(values)), np.zeros(len(values))
    made, values = np.zeros((TIME_S.size, len(values))), np.asarray(values)
    for i in range(TIME_S.size - 1):
        extra = forces(q, v) if callable(forces) else forces[i]
        rub = np.tanh(v / CREEP)
        slope = values[:, 0] + values[:, 1] / CREEP * (1 - rub**2)
        a = (DRIVE_N[i] - values[:, 2] - values[:, 0] * v - values[:, 1] * rub - extra) / MASS_KG
        v = v + STEP_S * a / (1 + STEP_S * slope / MASS_KG)
        q = q + STEP_S * v
        made[i + 1] = q
    return made


def sampled(path):
    time_s = np.linspace(0.0, DURATION_S, SAMPLES)
    return np.stack([np.interp(time_s, TIME_S, p) for p in path.T], 1)


def slopes(x, shapes=None):
    """(path, slopes) in the values, or in forces of given shapes in time."""
    if shapes is None:
        by = np.array([1e-2, 1e-3, 1e-3])
        made = sampled(paths([x, *(x + np.diag(by))], np.zeros((TIME_S.size, 4))))
    else:
        by = 1e-2
        made = sampled(paths([x] * (1 + shapes.shape[1]), np.concatenate([np.zeros((TIME_S.size, 1)), by * shapes], 1)))
    return made[:, 0], (made[:, 1:] - made[:, :1]) / by


def unknown(kind, rng):
    """A force beside the law that is fitted."""
    if kind == "ripple":
        size, per_m, phase = rng.normal(size=4), rng.uniform(10, 50, 4), rng.uniform(0, 6, 4)
        return lambda q, v: np.sum(size * np.sin(per_m * q[:, None] + phase), 1)
    size = rng.uniform(0.5, 1.5) * rng.choice([-1, 1])
    return lambda q, v: size * np.exp(-np.abs(v) / 0.05) * np.tanh(v / CREEP)


def fitted(kind, seed):
    """Values by least squares, what they leave and its slopes [sigmas]."""
    rng = np.random.default_rng(seed)
    seen = sampled(paths([TRUTH], unknown(kind, rng)))[:, 0] + SIGMA_M * rng.standard_normal(SAMPLES)
    x = TRUTH * [1.1, 0.9, 0.7]
    for _ in range(5):
        path, J = slopes(x)
        x = x + np.linalg.lstsq(J, seen - path, rcond=None)[0]
    path, J = slopes(x)
    return x, (seen - path) / SIGMA_M, J / SIGMA_M, path


def responses(x, path):
    """To forces against time, and to laws of a few terms [sigmas], of unit size each."""
    centres, wide = np.linspace(0.0, DURATION_S, 24), 0.7 * DURATION_S / 23
    bumps = np.exp(-0.5 * ((TIME_S[:, None] - centres) / wide) ** 2)
    q = np.interp(TIME_S, np.linspace(0.0, DURATION_S, SAMPLES), path)
    v = np.gradient(q, TIME_S)
    q, v = (q - q.mean()) / np.ptp(q), v / np.abs(v).max()
    laws = np.stack([q**0, q, q**2, q**3, v, v * np.abs(v), np.tanh(v / 0.05), q * v, np.gradient(v)], 1)
    return [L / np.linalg.norm(L, axis=0) for L in (slopes(x, bumps)[1], slopes(x, laws)[1])]


@pytest.mark.parametrize(("kind", "seed"), [("ripple", 2), ("rises towards rest", 1), ("rises towards rest", 2)])
def test_intervals_allow_for_what_a_form_lacks(kind, seed):
    x, r, J, path = fitted(kind, seed)
    none, rows = np.zeros(3), [slice(0, SAMPLES)]
    soft = max(r @ r / independent(r), 1.0)
    by_misfit = np.sqrt(soft * np.diag(np.linalg.inv(J.T @ J)))
    sd = np.max([apart(r, J, L, none, none, rows) for L in responses(x, path)], axis=0)
    assert np.max(np.abs(x - TRUTH) / by_misfit) > 5.0  # what is left does not tell how far off a wrong form is
    assert np.all(np.abs(x - TRUTH) < 2.0 * sd)
    assert np.all(sd < [60.0, 6.0, 10.0])  # and still say something


def test_of_a_right_form_nothing_is_added():
    rng = np.random.default_rng(3)
    path, J = slopes(TRUTH)
    J, L = J / SIGMA_M, responses(TRUTH, path)[0]
    noise = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    r = rng.standard_normal(SAMPLES)
    r -= J @ np.linalg.lstsq(J, r, rcond=None)[0]
    assert np.all(apart(r, J, L, np.zeros(3), np.zeros(3), [slice(0, SAMPLES)]) < 2.0 * noise)


def test_a_number_that_moves_nothing_keeps_what_was_believed_of_it():
    rng = np.random.default_rng(4)
    J, L = rng.standard_normal((200, 3)), rng.standard_normal((200, 5))
    J[:, 1:] = 0.0
    r = rng.standard_normal(200)
    sd = apart(r, J, L, np.array([0.0, 0.25, 0.0]), np.zeros(3), [slice(0, 200)])
    assert sd[0] < 0.2
    assert sd[1] == pytest.approx(2.0, rel=0.1)  # of its prior; the last has none, and the data say nothing
    assert sd[2] > 1e4
