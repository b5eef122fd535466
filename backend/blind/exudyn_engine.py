"""Exudyn as an independent peer: generalised-α, implicit, every body a full 3-D pose with Euler parameters.

J. Gerstmayr, "Exudyn", Multibody System Dynamics (2023).  The integrator is Arnold and Brüls (2007).
Rows that repeat others (three for each closed cell of a scissor) are left out beforehand, and the motion
does not notice.  Where what repeats changes on the way (Bennett's loop) every row stays, in a full-pivot solve.
constraint_error_m reports all rows, the ones left out included; joint_force_n is empty where runs are extrapolated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from backend.blind.closure import assemble, independent_rows, row_margin, set_in_motion
from backend.blind.drawing import Drawing
from backend.blind.drawn import BODY_KINDS, JOINT_KINDS, read_drawing
from backend.blind.exudyn_contact import Walls
from backend.blind.exudyn_model import ExudynModel
from backend.blind.exudyn_planar import PlanarModel
from backend.blind.peer import peer
from backend.blind.poses import COORDINATE, PeerMotion, Poses, joint_rates, peer_motion, size_m

KINDS = frozenset((*JOINT_KINDS, *BODY_KINDS))
CREEP = 1e-5  # rad/s or m/s: friction's sign(v) is v / sqrt(v² + CREEP²)
# As stiff as the step allows.  A stronger damper wants a softer wall, which gives way more slowly: ten loose cells that
# rub move within 11 µm rms of those on walls of 1.6e9 N/m, four times critically damped (at 62 ns); on walls of 1e7 N/m
# damped four times critically too they are 136 µm off.
EXPLICIT_WALLS = Walls(rigid_stiffness=1e9, damping_ratio=1.0)
UNMET = 1e-6  # of the mechanism's size; runs that are well end below 1e-10
SAFE = 0.99


def simulate_exudyn(
    mechanism: Any,
    duration_s: float,
    step_s: float = 5e-4,
    *,
    output_step_s: float | None = None,
    initial_joint_velocities: Mapping[str, float] | None = None,
    initial_joint_positions: Mapping[str, float] | None = None,
    inputs: Any = None,
    extrapolated: bool = False,
    redundant_rows: str = "auto",
    spectral_radius: float = 0.9,
    friction_creep: float = CREEP,
    walls: Walls | None = None,
    explicit: bool = False,
) -> PeerMotion:
    """The mechanism's motion for `duration_s` from its drawn pose, at rest unless rates are given.

    mechanism: a Mechanism or its JSON document.  step_s: integrator step [s]; output_step_s: samples [s], a
    multiple of it.  inputs: columns time_s, effect, parameter, value (zero-order hold).
    redundant_rows: "left out", "ignored" (all stay, in a full-pivot solve cubic in the bodies), or "auto": left
    out where closure.row_margin says that this is safe all the way.
    extrapolated: run at step_s and half of it, and cancel the error's h²: for smooth motions only.
    friction_creep: rate at which Coulomb friction is 71% mobilised [rad/s or m/s].
    walls: what stands for rigid and inelastic where things touch; contact wants steps of 0.02 to 0.1 ms, and below
    that Newton may stall where many pins are loose.
    explicit: velocity Verlet without Newton's method, for planar drawings whose every pin is loose (exudyn_planar.py);
    walls want steps of 2 to 5 µs, pads of `surface_friction` a friction_creep above coefficient x g x step.
    Raises ValueError for an effect or joint it cannot imitate, RuntimeError when the integrator gives up.
    """
    exudyn = peer("exudyn")
    drawing = read_drawing(mechanism, inputs, engine="Exudyn", kinds=KINDS)
    start = assemble(drawing, initial_joint_positions)
    set_in_motion(drawing, start, initial_joint_velocities)
    keep = None if explicit else _kept_rows(drawing, start, redundant_rows)
    every = output_step_s or step_s
    rubs = any(joint.friction or joint.rub_radius for joint in drawing.joints)
    touches = bool(drawing.capsules or drawing.pads) or any(joint.play for joint in drawing.joints)
    rates: dict[str, float] = {}
    forces: dict[str, np.ndarray] = {}

    def solved(step: float, until_s: float = duration_s) -> tuple[np.ndarray, Poses]:
        kind, stiff = (PlanarModel, EXPLICIT_WALLS) if explicit else (ExudynModel, Walls())
        build = kind(exudyn.SystemContainer(), drawing, start, friction_creep, step, rates, walls or stiff)
        build.everything(keep)
        settings = _settings(
            until_s, step, min(every, until_s), spectral_radius, keep is None and not explicit, rubs, touches
        )
        solver = exudyn.DynamicSolverType
        try:
            build.mbs.Assemble()
            build.mbs.SolveDynamic(settings, solverType=solver.VelocityVerlet if explicit else solver.GeneralizedAlpha)
        except exudyn.ExudynError as error:
            raise RuntimeError(
                f"Exudyn stopped before {duration_s} s at a step of {step} s; halve the step, "
                "raise friction_creep, or look for a dead centre on the way"
            ) from error
        time_s, poses = build.recorded()
        forces.update(build.recorded_forces(poses))
        return time_s, poses

    if rubs and not explicit:
        # At rest friction's sign is not known, and a wrong first acceleration costs first order all the way.
        rates = _rates_at_end(drawing, *solved(0.05 * step_s, 0.5 * step_s))
    time_s, poses = solved(step_s)
    if extrapolated:
        poses = _extrapolated(poses, solved(0.5 * step_s)[1])
    motion = peer_motion("Exudyn", str(exudyn.__version__), step_s, drawing, time_s, poses)
    motion = motion if extrapolated else replace(motion, joint_force_n=forces)
    if (missed := motion.constraint_error_m.max()) > UNMET * size_m(drawing):
        raise RuntimeError(f'Exudyn left a joint open by {missed:.3g} m; halve the step, or redundant_rows="ignored"')
    return motion


def _kept_rows(drawing: Drawing, start: Poses, redundant_rows: str) -> list[tuple[int, ...]] | None:
    """The rows each joint holds, None for all with a solve that copes."""
    if redundant_rows not in ("auto", "left out", "ignored"):
        raise ValueError(f'redundant_rows is "{redundant_rows}"; write "auto", "left out" or "ignored"')
    if redundant_rows == "ignored":
        return None
    keep = independent_rows(drawing, start)
    if any(joint.rub_radius and not {0, 1} <= set(held) for joint, held in zip(drawing.joints, keep, strict=True)):
        return None  # a pin rubs with its whole radial reaction
    return keep if redundant_rows == "left out" or row_margin(drawing, start, keep) > SAFE else None


def _rates_at_end(drawing: Drawing, time_s: np.ndarray, poses: Poses) -> dict[str, float]:
    moving = (joint for joint in drawing.joints if joint.moves)
    return {joint.id: float(joint_rates(joint, poses)[-1, COORDINATE[joint.type]]) for joint in moving}


def _settings(
    duration_s: float, step_s: float, every_s: float, spectral_radius: float, every_row: bool, rubs: bool, touches: bool
) -> Any:
    exudyn = peer("exudyn")
    settings = exudyn.SimulationSettings()
    integrator = settings.timeIntegration
    integrator.endTime = duration_s
    integrator.numberOfSteps = max(1, round(duration_s / step_s))
    integrator.generalizedAlpha.spectralRadius = spectral_radius
    integrator.newton.useModifiedNewton = False
    # Sticking joints are stiff enough for rounding to hold Newton above the tighter tolerance.
    integrator.newton.relativeTolerance = 1e-8 if rubs or touches else 1e-10
    integrator.newton.absoluteTolerance = 1e-10 if rubs or touches else 1e-12
    if touches:
        # A contact found inside a step is met by iterating; going back to the moment of each of many blows stalls.
        integrator.discontinuous.useRecommendedStepSize = False
        integrator.newton.useModifiedNewton = True
        integrator.newton.maxIterations = 10
    integrator.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = every_s * (1 - 1e-9)
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    if every_row:
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenDense
        settings.linearSolver.ignoreSingularJacobian = True
    return settings


def _extrapolated(coarse: Poses, fine: Poses) -> Poses:
    """(4 fine - coarse) / 3: the error's h² cancels (Richardson 1911); rotations are made orthonormal."""
    p, R, v, w = (
        (4.0 * f - c) / 3.0
        for c, f in (
            (coarse.p_WB, fine.p_WB),
            (coarse.R_WB, fine.R_WB),
            (coarse.v_WB, fine.v_WB),
            (coarse.w_WB_B, fine.w_WB_B),
        )
    )
    U, _, Vt = np.linalg.svd(R)
    return Poses(p, U @ Vt, v, w)
