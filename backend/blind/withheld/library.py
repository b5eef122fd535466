"""The kinds that a diagnosis may know: frictions, springs, stops, play, drawn values, the surroundings, the camera."""

from __future__ import annotations

import numpy as np

from backend.blind.withheld.causes import STOP_DEPTH_RAD, Rig, kind
from backend.blind.withheld.laws import Change
from backend.blind.withheld.linkage import GRAVITY


def _unit(rig: Rig, i: int, turning: str, sliding: str) -> str:
    return turning if rig.turns(i) else sliding


@kind("viscous_friction", "joint", 0.004, 0.1)
def _viscous(rig, i, size, rng):
    value = size * rig.effort(i) / (rig.rate * rig.stride(i))
    return {_unit(rig, i, "damping_n_m_s_per_rad", "damping_n_s_per_m"): value}, [Change("viscous", i, value)]


@kind("coulomb_friction", "joint", 0.003, 0.06)
def _coulomb(rig, i, size, rng):
    value = size * rig.effort(i)
    return {_unit(rig, i, "friction_torque_n_m", "friction_force_n"): value}, [Change("coulomb", i, value)]


@kind("pin_friction", "hinge", 0.05, 0.6)
def _pin_friction(rig, i, size, rng):
    return {"friction_coefficient": size}, [Change("rub", i, size * rig.linkage.pins[i].radius)]


@kind("stribeck_friction", "hinge", 0.004, 0.04)
def _stribeck(rig, i, size, rng):
    excess, rate = float(rng.uniform(0.6, 2.0)), float(rng.uniform(0.1, 0.3)) * rig.rate
    sliding = size * rig.torque
    changes = [
        Change("coulomb", i, sliding),
        Change("stribeck_excess", i, excess, sized=False),
        Change("stribeck_rate", i, rate, sized=False),
    ]
    return {"friction_torque_n_m": sliding}, changes


@kind("effort_offset", "joint", 0.004, 0.08, signed=True)
def _offset(rig, i, size, rng):
    value = size * rig.effort(i)
    return {_unit(rig, i, "torque_n_m", "force_n"): value}, [Change("offset", i, value)]


@kind("torsion_spring", "hinge", 0.01, 0.3)
def _torsion_spring(rig, i, size, rng):
    value = size * rig.torque
    rest = float(rng.uniform(-0.5, 0.5))
    return {"stiffness_n_m_per_rad": value}, [Change("stiffness", i, value), Change("offset", i, value * rest)]


@kind("rotor_inertia", "hinge", 0.02, 0.5)
def _rotor(rig, i, size, rng):
    value = size * rig.mass * rig.linkage.size**2 / 12
    return {"kg_m2": value}, [Change("rotor", i, value)]


@kind("joint_stop", "hinge", 0.5, 0.95)
def _stop(rig, i, size, rng):
    """At a share of the way that the ideal motion goes beyond every start pose."""
    (low, high), (first, last) = rig.reach[i], rig.starts[i]
    over, under = high - last, first - low
    if max(over, under) < 0.06:
        return None
    stiff = 2.5 * rig.torque / STOP_DEPTH_RAD**2.5
    hard = Change("stop_stiffness", i, stiff, sized=False)
    if over > under:
        upper = float(last + size * over)
        return {"upper": upper}, [Change("upper", i, upper), hard]
    lower = float(first - size * under)
    return {"lower": lower}, [Change("lower", i, lower), hard]


@kind("clearance", "hinge", 4e-4, 4e-3)
def _clearance(rig, i, size, rng):
    value = size * rig.linkage.size
    return {"radial_m": value}, [Change("play", i, value)]


@kind("mass_error", "link", 0.01, 0.25, signed=True)
def _mass(rig, i, size, rng):
    return {"relative": size}, [Change("heavier", i, size)]


@kind("center_of_mass_error", "link", 0.005, 0.1, signed=True)
def _centre(rig, i, size, rng):
    link = rig.linkage.links[i]
    length = link.ends[1] - link.ends[0]
    offset = size * length * np.exp(1j * rng.uniform(-0.5, 0.5))
    return {}, [Change("centre", i, offset)]


@kind("inertia_error", "link", 0.03, 0.4, signed=True)
def _inertia(rig, i, size, rng):
    return {"relative": size}, [Change("inertia", i, size)]


@kind("length_error", "bar", 0.002, 0.03, signed=True)
def _length(rig, i, size, rng):
    return {"relative": size}, [Change("stretch", i, size)]


@kind("linear_drag", "link", 0.005, 0.1)
def _slow(rig, i, size, rng):
    value = size * rig.mass * GRAVITY / (rig.rate * rig.linkage.size)
    return {"n_s_per_m": value}, [Change("slow", i, value)]


@kind("air_drag", "link", 0.01, 0.3)
def _drag(rig, i, size, rng):
    """Spread over the link, so its drag area at the centre of mass is a matter of definition."""
    link = rig.linkage.links[i]
    speed = rig.rate * rig.linkage.size
    return {}, [Change("drag", i, size * rig.mass * GRAVITY / speed**2 / (link.ends[1] - link.ends[0]))]


@kind("spring_stiffness_error", "spring", 0.01, 0.15, signed=True)
def _stiffer(rig, i, size, rng):
    return {"relative": size}, [Change("stiffer", i, size)]


@kind("spring_preload_error", "spring", 0.01, 0.3, signed=True)
def _preload(rig, i, size, rng):
    value = size * rig.mass * GRAVITY
    return {"n": value}, [Change("preload", i, value)]


@kind("extension_spring", "spring", 0.005, 0.1)
def _damped(rig, i, size, rng):
    """What its coils lose, or a damper beside them."""
    value = size * rig.mass * GRAVITY / (rig.rate * rig.linkage.size)
    return {"damping_n_s_per_m": value}, [Change("damping", i, value)]


@kind("gravity_tilt", "world", 0.004, 0.06, signed=True)
def _tilt(rig, i, size, rng):
    return {"pitch_rad": size}, [Change("tilt", None, size)]


@kind("base_motion", "world", 0.002, 0.03)
def _base(rig, i, size, rng):
    amplitude = size * rig.linkage.size * np.exp(1j * rng.uniform(-0.4, 0.4))
    hertz, phase = float(rng.uniform(1.2, 4.0)), float(rng.uniform(0, 2 * np.pi))
    numbers = [
        Change("sway", None, amplitude),
        Change("sway_hz", None, hertz, sized=False),
        Change("sway_phase", None, phase, sized=False),
    ]
    return {"frequency_hz": hertz}, numbers


@kind("late_release", "world", 0.004, 0.06)
def _late(rig, i, size, rng):
    return {"delay_s": size}, [Change("delay", None, size)]


@kind("release_velocity", "world", 0.02, 0.4, signed=True)
def _release(rig, i, size, rng):
    value = size * rig.rate
    return {"rad_per_s": value}, [Change("release_rate", None, value)]


@kind("camera_scale", "camera", 0.002, 0.03, signed=True)
def _scale(rig, i, size, rng):
    return {"relative": size}, [Change("scale", None, size)]


@kind("camera_rotation", "camera", 0.003, 0.05, signed=True)
def _turn(rig, i, size, rng):
    return {"rad": size}, [Change("turn", None, size)]


@kind("camera_tilt", "camera", 0.02, 0.2, signed=True)
def _keystone(rig, i, size, rng):
    way = rng.uniform(0, 2 * np.pi)
    return {}, [Change("pitch", None, size * np.sin(way)), Change("yaw", None, size * np.cos(way))]


@kind("lens_distortion", "camera", 0.003, 0.05, signed=True)
def _lens(rig, i, size, rng):
    return {"k1": size / rig.linkage.size**2}, [Change("k1", None, size / rig.linkage.size**2)]


@kind("frame_rate_error", "camera", 0.002, 0.04, signed=True)
def _rate(rig, i, size, rng):
    return {"relative": size}, [Change("frame_rate", None, size)]


@kind("time_offset", "camera", 0.002, 0.03, signed=True)
def _clock(rig, i, size, rng):
    return {"s": size}, [Change("time_offset", None, size)]


@kind("rolling_shutter", "camera", 0.004, 0.03)
def _rows(rig, i, size, rng):
    return {"readout_s": size}, [Change("readout", None, size)]


@kind("marker_offset", "marker", 0.002, 0.04, signed=True)
def _marker(rig, i, size, rng):
    offset = complex(size * rig.linkage.size * np.exp(1j * rng.uniform(-np.pi, np.pi)))
    return {"dx_m": offset.real, "dy_m": offset.imag}, [Change("shifted", i, offset)]


@kind("tracker_drift", "marker", 0.003, 0.05, signed=True)
def _drift(rig, i, size, rng):
    speed = complex(size * rig.linkage.size * np.exp(1j * rng.uniform(-np.pi, np.pi)))
    return {"x_m_per_s": speed.real, "z_m_per_s": speed.imag}, [Change("drift", i, speed)]


# A cause that another stands for exactly: what is left out with it.  A late release is a clock that runs ahead.
EQUIVALENT: dict[str, tuple[str, ...]] = {
    "late_release": ("time_offset",),
    "time_offset": ("late_release",),
    "coulomb_friction": ("stribeck_friction",),
    "effort_offset": ("torsion_spring",),
    "spring_preload_error": ("spring_stiffness_error",),
}
