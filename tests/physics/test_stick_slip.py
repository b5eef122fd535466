"""Friction that falls with speed: the block of a bowed string, held at rest, let go and caught again."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from backend.model.build import build
from backend.simulate.record import on_steps
from tests.mechanisms import WEIGHTLESS, body, document, drawing, effect, sliding_mass
from tests.motions import follow

MASS, SPRING, PULL = 1.0, 100.0, 0.05  # kg, N/m, m/s
STATIC, SLIDING = 2.0, 1.0  # N
STEP_S = 4e-4
RATE = np.sqrt(SPRING / MASS)
FALL = STATIC - SLIDING


def stribeck(on, static=STATIC, sliding=SLIDING, speed=1e-3):
    return effect(
        "dry",
        "stribeck_friction",
        [on],
        static_force_n=static,
        friction_force_n=sliding,
        stribeck_velocity_m_per_s=speed,
    )


@cache
def pulled_block() -> Mechanism:
    """A block on a rail, pulled through a spring by a sledge ahead of it on a rail of its own."""
    moments = np.array([2e-4, 3e-4, 4e-4])
    block, sledge = (
        body(id, (x, 0, 0), Rotation.identity(), MASS, moments) for id, x in (("block", 0), ("sledge", 0.5))
    )
    spring = effect(
        "spring", "extension_spring", ["block", "sledge"],
        anchor_a_m=[0, 0, 0], anchor_b_m=[0, 0, 0], stiffness_n_per_m=SPRING, free_length_m=0.5,
    )  # fmt: skip
    pull = effect("pull", "prescribed_motion", ["track"])
    rails = [
        (id, "prismatic", "ground", on, (x, 0, 0), (1, 0, 0))
        for id, on, x in (("rail", "block", 0), ("track", "sledge", 0.5))
    ]
    return drawing("pulled block", [block, sledge], rails, [spring, pull, stribeck("rail")], gravity=WEIGHTLESS)


STEPS = 8000


def pulled(speed, step_s):
    """The block over 8000 steps; the sledge leaves at a steady speed."""
    model = build(pulled_block()).with_parameters({("dry", "stribeck_velocity_m_per_s"): speed})
    time = step_s * np.arange(STEPS + 2)
    record = on_steps(model, [(("pull", "q"), time, PULL * time)], step_s, STEPS)
    velocity = np.zeros((model.topology.slots, 6))
    velocity[model.topology.slot("sledge"), 0] = PULL
    motion = follow(model, step_s, STEPS, velocity, record)
    assert not motion.path.lost.any()
    return motion.path


def period(speed):
    """Of stick and slip by an integrator of its own, from F_s: slip until the block rests, wind up again [s]."""

    def slip(t, y):
        force = STATIC + SPRING * (PULL * t - y[0])
        return [y[1], (force - SLIDING - FALL * np.exp(-((y[1] / speed) ** 2))) / MASS]

    def caught(t, y):
        return y[1] if t > 1e-2 else 1.0

    caught.terminal, caught.direction = True, -1
    found = solve_ivp(slip, (0, 2), [0, 0], events=caught, rtol=1e-10, atol=1e-13, max_step=1e-3)
    return found.y[0, -1] / PULL  # the block has come as far as the sledge


def test_a_block_pulled_through_a_spring_sticks_and_slips_at_its_period():
    path = pulled(1e-2, STEP_S)
    stuck = path.rate[:, 0] < 0.2 * PULL
    begins = path.time_s[1:][stuck[:-1] & ~stuck[1:]]
    assert len(begins) == 4
    np.testing.assert_allclose(np.diff(begins), period(1e-2), atol=2 * STEP_S)  # a node either side
    rests = path.q[np.searchsorted(path.time_s, begins - 0.05), 0]
    np.testing.assert_allclose(np.diff(rests), PULL * period(1e-2), rtol=1e-3)


def test_a_sudden_fall_makes_the_period_of_two_levels_of_friction():
    # v_s → 0: it slips where the spring has wound to F_s, and is caught when it has lost 2 (F_s - F_c).
    slip_s = 2 / RATE * (np.pi - np.arctan(FALL * RATE / (SPRING * PULL)))
    two_levels_s = 2 * FALL / (SPRING * PULL) + slip_s
    assert period(1e-5) == pytest.approx(two_levels_s, rel=2e-3)
    path = pulled(2e-4, STEP_S)
    stuck = path.rate[:, 0] < 0.2 * PULL
    begins = path.time_s[1:][stuck[:-1] & ~stuck[1:]]
    # Creep ends the hold √(2 F_s (F_s - F_c)) ε_v / v_s early, which is 0.8% of F_s.
    np.testing.assert_allclose(np.diff(begins), two_levels_s, rtol=1e-2)


@cache
def railed():
    """A block on a rubbing rail, and a push."""
    push = effect("push", "applied_force", ["block"], direction=[1, 0, 0])
    return build(sliding_mass([stribeck("rail"), push], mass=MASS))


def test_a_block_below_its_static_limit_stays_where_it_is():
    for share in (0.5, 0.8):  # 0.8 of the static limit is above the sliding one
        path = follow(railed().with_parameters({("push", "force_n"): share * STATIC}), 1e-3, 1000).path
        assert 0 < path.q[-1, 0] < 1e-6  # m in a second


def test_a_block_sliding_fast_feels_the_sliding_level_alone():
    path = follow(railed(), 1e-3, 1000, np.array([[0.8, 0, 0, 0, 0, 0]])).path
    assert path.q[-1, 0] == pytest.approx(0.8**2 * MASS / (2 * SLIDING), rel=2e-3)  # ½ m v² / F


def test_halving_the_step_quarters_the_error_of_sliding():
    model = railed().with_parameters({("dry", "stribeck_velocity_m_per_s"): 0.5})
    runs = [follow(model, h, 1000, np.array([[0.8, 0, 0, 0, 0, 0]])).path for h in (4e-3, 2e-3, 1e-3)]
    coarse, middle, fine = (path.q[node, 0] for path, node in zip(runs, (100, 200, 400), strict=True))
    assert 3.8 < (coarse - middle) / (middle - fine) < 4.2


def test_a_static_limit_below_the_sliding_one_is_refused():
    drawn = document(sliding_mass())
    drawn["effects"] = [stribeck("rail", static=0.5).model_dump(mode="json")]
    with pytest.raises(DrawingError, match=r'"dry": static_force_n is 0.5 N, below friction_force_n, which is 1; swap'):
        parse_mechanism(drawn)
    with pytest.raises(ValueError, match=r"'dry': static_force_n is 0.5 N, below"):
        build(sliding_mass(), [stribeck("rail", static=0.5)])
