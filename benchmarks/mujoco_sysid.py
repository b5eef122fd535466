"""MuJoCo's own identification toolbox on the scissor with friction, set up as one who knows it well would.

Bars hang on hinges as a tree; a `connect` closes each cell's loop, and a fixed tendon over the three hinges between
its bars, whose length is the closing pin's angle, carries that pin's friction.  So a step is as cheap as MuJoCo can
make it, and every pin rubs.  The toolbox needs what `mujoco[sysid]` installs.
"""

import contextlib
import io
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from backend.blind.peer import peer
from benchmarks.scissor import INERTIA, LENGTH_M, MASS_KG

SOLIMP = (0.9999, 0.9999, 1e-3, 0.5, 2.0)  # the default lets loops and sticking pins give way
BOUNDS = ((0.0, 0.1), (0.0, 0.1))  # N m s/rad, N m


@dataclass(frozen=True)
class Settings:
    """How MuJoCo simulates and how its toolbox searches.

    corrected: predicted sensors are dated when they were read, at the beginning of the step; as shipped they carry
    the time of its end.
    """

    integrator: str
    step_s: float
    corrected: bool
    optimizer: str = "scipy"

    @property
    def words(self) -> str:
        """For a table."""
        lag = "corrected" if self.corrected else "as shipped"
        return f"{self.optimizer}, {self.integrator} {1e3 * self.step_s:g} ms, {lag}"


@dataclass(frozen=True)
class Found:
    """values: (viscous, Coulomb); half_width: of the toolbox's 95% intervals.  path: (seconds, values) of every model
    it tried, rows of (viscous, Coulomb)."""

    values: np.ndarray
    half_width: np.ndarray
    path: tuple[np.ndarray, np.ndarray]
    wall_s: float


def available() -> bool:
    """Whether the toolbox can be imported, extras and all."""
    try:
        return hasattr(peer("mujoco.sysid"), "optimize")
    except ImportError:
        return False


def scissor_spec(
    cells: int, angle_rad: float, spring_n_per_m: float, integrator: str, step_s: float, seen: tuple[str, ...]
) -> Any:
    """An MjSpec of benchmarks.scissor with friction at every pin and a sensor for the angle of each pin in `seen`."""
    mujoco = peer("mujoco")
    half = 0.5 * LENGTH_M
    c, s = half * math.cos(angle_rad), half * math.sin(angle_rad)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = step_s
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    solref = (2.0 * step_s, 1.0)

    def rubs(item: Any) -> Any:
        item.solref_friction, item.solimp_friction = solref, SOLIMP
        return item

    def bar(parent: Any, name: str, centre: tuple[float, float], turn: float, pin: str, at: float) -> Any:
        body = parent.add_body(name=name, pos=[*centre, 0.0], quat=[math.cos(turn / 2), 0, 0, math.sin(turn / 2)])
        _weigh(body, MASS_KG, [INERTIA["xx"], INERTIA["yy"], INERTIA["zz"]])
        rubs(body.add_joint(name=pin, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], pos=[at, 0, 0]))
        return body

    def close(pin: str, a: str, b: str, along_a: float, between: list[str]) -> None:
        held = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
        held.name1, held.name2, held.solref, held.solimp = a, b, solref, SOLIMP
        held.data = np.concatenate([[along_a], np.zeros(len(held.data) - 1)])
        turned = rubs(spec.add_tendon(name=pin))
        for hinge in between:
            turned.wrap_joint(hinge, 1.0)

    slider = spec.worldbody.add_body(name="slider", pos=[0.0, s, 0.0])
    _weigh(slider, 0.01, [1e-6] * 3)
    slider.add_joint(name="guide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])
    a = bar(spec.worldbody, "a0", (c, 0.0), angle_rad, "start", -half)
    b = bar(a, "b0", (0.0, 0.0), -2 * angle_rad, "mid0", 0.0)
    spring = spec.add_tendon(name="spring", stiffness=[spring_n_per_m, 0, 0], springlength=[1.2 * s, 1.2 * s])
    for body, site in ((a, "low"), (b, "high")):
        body.add_site(name=site, pos=[-half, 0, 0])
        spring.wrap_site(site)
    close("guide_pin", "b0", "slider", -half, ["start", "mid0"])
    # One cell on is 2 c along x; in the frame of the bar before it, which leans by -angle.
    on = (2 * c * math.cos(angle_rad), 2 * c * math.sin(angle_rad))
    for i in range(1, cells):
        a = bar(b, f"a{i}", on, 2 * angle_rad, f"low{i - 1}", -half)
        b = bar(a, f"b{i}", (0.0, 0.0), -2 * angle_rad, f"mid{i}", 0.0)
        close(f"top{i - 1}", f"a{i - 1}", f"b{i}", half, [f"mid{i - 1}", f"low{i - 1}", f"mid{i}"])
    for pin in seen:
        spec.add_sensor(name=pin, type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=pin)
    return spec


def _weigh(body: Any, mass: float, inertia: list[float]) -> None:
    body.explicitinertial, body.mass, body.inertia = True, mass, inertia
    body.ipos, body.iquat = [0, 0, 0], [1, 0, 0, 0]  # left alone, they become the body's place in its parent


def _set_viscous(spec: Any, parameter: Any) -> None:
    for item in _pins(spec):
        item.damping = [parameter.value[0], 0, 0]


def _set_coulomb(spec: Any, parameter: Any) -> None:
    for item in _pins(spec):
        item.frictionloss = parameter.value[0]


def _pins(spec: Any) -> list[Any]:
    """What rubs: hinges and the tendons that stand for closing pins."""
    hinges = [joint for joint in spec.joints if joint.name != "guide"]
    return hinges + [tendon for tendon in spec.tendons if tendon.name != "spring"]


def identify(spec: Any, settings: Settings, time_s: np.ndarray, q: np.ndarray, start: np.ndarray) -> Found:
    """The toolbox's fit of (viscous, Coulomb) to samples q (T, sensors) [rad], from rest at the drawn pose.

    Its predictions begin a step after the release and its residual drops samples before that.
    """
    sysid = peer("mujoco.sysid")
    model = spec.compile()
    steps = np.arange(0.0, time_s[-1] + 2 * settings.step_s, settings.step_s)
    sequences = sysid.ModelSequences(
        "scissor", spec, "opening",
        sysid.create_initial_state(model, np.zeros(model.nq)),
        sysid.TimeSeries(steps, np.zeros((steps.size, 0))),
        sysid.TimeSeries.from_names(time_s, q, model),
    )  # fmt: skip
    parameters = sysid.ParameterDict()
    for name, first, (low, high), write in zip(
        ("viscous", "coulomb"), start, BOUNDS, (_set_viscous, _set_coulomb), strict=True
    ):
        parameters.add(sysid.Parameter(name, first, low, high, modifier=write))
    lag = {"modify_residual": _dated} if settings.corrected else {}
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1, **lag)
    tried: list[tuple[float, np.ndarray]] = []
    began = time.perf_counter()

    def watched(x: np.ndarray, given: Any, **rest: Any) -> Any:
        made = residual(x, given, **rest)
        tried.append((time.perf_counter() - began, x.reshape(2, -1)[:, 0].copy()))
        return made

    with contextlib.redirect_stdout(io.StringIO()):  # its optimisers print every iteration
        found, result = sysid.optimize(parameters, watched, optimizer=settings.optimizer, verbose=False)
    wall_s = time.perf_counter() - began
    values = found.as_vector()
    remains, _, _ = residual(values, found)
    _, half_width = sysid.calculate_intervals([r.ravel() for r in remains], np.asarray(result.jac))
    path = np.array([t for t, _ in tried]), np.array([x for _, x in tried])
    return Found(values, np.asarray(half_width), path, wall_s)


def _dated(params: Any, predicted: Any, measured: Any, model: Any, return_all: bool, **_: Any) -> tuple[Any, Any, Any]:
    """The toolbox's own residual, with every prediction dated a step earlier."""
    sysid = peer("mujoco.sysid")
    shifted = sysid.TimeSeries(predicted.times - model.opt.timestep, predicted.data, predicted.signal_mapping)
    measured = sysid.signal_modifier.apply_delayed_ts_window(measured, shifted, 0.0, 0.0)
    shifted = shifted.resample(measured.times)
    difference = sysid.weighted_diff(shifted.data, measured.data, model=model)
    return sysid.normalize_residual(difference, measured.data), shifted, measured
