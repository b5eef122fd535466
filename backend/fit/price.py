"""Which way to take derivatives, by what a fit then costs.

Counted in rollouts, with what compiling further programs takes in the rollouts of that time. Figures were measured by
`benchmarks.dynamics` and `benchmarks.many_joints`.
"""

from __future__ import annotations

from typing import Literal

Way = Literal["together", "forward", "adjoint"]

FIRST, SLOPE, GRADIENT = 2.0, 0.8, 3.0  # rollouts: a Jacobian without columns, a column, a gradient backwards in time
STEPS, TRIALS, KEPT = 16.0, 20.0, 0.6  # steps of a usual search; with those refused; share whose slopes may be kept
SECANTS = 6.0  # rollouts for each unknown where parts strike each other, or a search ends on roughness: every other
JACOBIANS, GRADIENTS, VALUES = 9.0, 10.0, 13.0  # of a profile, either way
COMPILE_VALUE_S, COMPILE_GRADIENT_S = 5.0, 14.0
CLEARLY = 1.5  # so many times as much the plain way has to cost before another is taken: all this is a guess


def cheapest(unknowns: int, profiled: int, rollout_s: float, strikes: bool) -> Way:
    """`together`: a simulation always brings its slopes. `forward`: trial steps are simulated alone, and slopes taken
    where one is accepted. `adjoint`: slopes are kept as long as they foretell the motion, with exact gradients
    backwards in time, which there are none of where parts strike each other.

    profiled: parameters whose likelihood interval is wanted. rollout_s: what simulating all experiments once takes.
    """
    jacobian, trials = FIRST + SLOPE * unknowns, TRIALS + SECANTS * unknowns * (1.0 if strikes else 0.5)
    profiles = profiled * JACOBIANS * jacobian
    costs: dict[Way, float] = {
        "together": (trials * jacobian + profiles) / CLEARLY,
        "forward": trials + STEPS * jacobian + profiles + COMPILE_VALUE_S / rollout_s,
    }
    if not strikes:
        search = trials + (1.0 - KEPT) * STEPS * jacobian + KEPT * STEPS * GRADIENT
        compiling = (COMPILE_VALUE_S + COMPILE_GRADIENT_S) / rollout_s
        costs["adjoint"] = search + profiled * (GRADIENTS * GRADIENT + VALUES) + compiling
    return min(costs, key=lambda way: costs[way])


def step_s(bodies: int, strikes: bool) -> float:
    """What a step usually takes with all that is seen of it, three times as long with play."""
    return (1e-5 + 2.4e-6 * bodies) * (3.0 if strikes else 1.0)


def account(way: Way, unknowns: int) -> str:
    """What a reader of the fit should know of it."""
    if way == "adjoint":
        return (
            f" Slopes of {unknowns} unknowns, which cost {FIRST + SLOPE * unknowns:.0f} simulations, were kept over "
            f"several steps, with adjoint gradients, which cost {GRADIENT:.0f}."
        )
    return f" Trial steps were simulated without slopes of {unknowns} unknowns." if way == "forward" else ""
