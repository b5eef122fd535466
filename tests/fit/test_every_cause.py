"""What a diagnosis asks of every cause: nothing while absent, and a true slope there, through the whole measurement."""

import math
import re
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from backend.effects.catalogue import catalogue
from backend.fit.free import free_parameters
from backend.fit.prediction import Setting, addresses_of, linearised, predict
from backend.model.build import build
from backend.model.state import drawn_pose
from backend.model.system import system
from backend.simulate import assemble
from backend.simulate.record import Record
from backend.simulate.run import assembled
from tests.mechanisms import double_pendulum, effect, fourbar

STEP_S, SAMPLE_S = 0.005, 0.01
TIMES = SAMPLE_S * np.arange(-4, 31)
JOINTS, MARKERS = 2, 2
CAUSES = [
    "center_of_mass_error:upper", "center_of_mass_error:lower", "joint_axis_error:elbow",
    "spring_stiffness_error:spring", "spring_preload_error:spring", "base_motion:world",
    "base_motion:world.frequency_hz", "base_motion:world.phase_rad", "late_release", "release_velocity:world",
    "release_velocity:elbow", "camera_tilt", "lens_distortion", "rolling_shutter", "marker_offset:tip",
    "tracker_drift:tip",
]  # fmt: skip


class Rig:
    """A double pendulum with a spring, seen by encoders and a camera before and after its release."""

    def __init__(self):
        spring = effect(
            "spring", "extension_spring", ["lower", "ground"], anchor_a_m=[0.1, 0, 0], anchor_b_m=[0.3, 0.2, 0],
            stiffness_n_per_m=5.0, free_length_m=0.1,
        )  # fmt: skip
        drawn = double_pendulum([spring])
        knee = drawn.markers[0].model_copy(update={"id": "knee", "body": "upper"})
        drawn = drawn.model_copy(update={"markers": (*drawn.markers, knee)})
        freedom = free_parameters(drawn, CAUSES)
        self.bare, self.model = build(drawn), build(drawn, freedom.added)
        self.parameters = freedom.parameters
        self.names = [p.name for p in freedom.parameters]
        self.addresses = addresses_of(freedom.parameters)
        table = self.model.parameters
        self.size = np.array([table[a[0]].expected or table[a[0]].natural for a in self.addresses])
        self.drawn = np.array([p.start for p in freedom.parameters])
        columns = JOINTS + 3 * MARKERS
        plant = eqx.filter_jit(system)(self.bare)
        pose = drawn_pose(self.bare, plant)
        self.setting = Setting(
            self.model, pose, jnp.asarray(assemble.free_motions(plant, pose)), jnp.tile(TIMES, columns),
            jnp.repeat(jnp.arange(columns), TIMES.size), jnp.zeros(columns + JOINTS), None, int(0.4 / STEP_S),
        )  # fmt: skip

    @property
    def drawn_x(self):
        return np.concatenate([self.drawn, np.zeros(4)])

    def ask(self, **values):
        """Samples (columns, times) and their slopes (columns, times, parameters); names as KIND__ON__PARAMETER."""
        x = self.drawn_x
        for name, value in values.items():
            x[self.at(name)] = value
        return self.look(self.setting, self.addresses, x)

    def at(self, name):
        kind, on, parameter = name.split("__")
        return self.names.index(f"{kind}:{on}.{parameter}")

    def look(self, setting, addresses, x):
        seen, slope, lost = linearised(setting, addresses, STEP_S, jnp.asarray(x), jnp.eye(max(x.size - 4, 1), x.size))
        assert not np.any(lost)
        return np.asarray(seen).reshape(-1, TIMES.size), np.asarray(slope).reshape(-1, TIMES.size, slope.shape[1])


@pytest.fixture(scope="module")
def rig():
    return Rig()


@pytest.fixture(scope="module")
def absent(rig):
    return rig.ask()


def test_causes_that_are_absent_change_no_sample(rig, absent):
    plain, _ = jax.jit(lambda setting, x: predict(setting, (), STEP_S, x))(
        replace(rig.setting, model=rig.bare), jnp.zeros(4)
    )
    np.testing.assert_allclose(absent[0].ravel(), plain, atol=1e-14)  # two programs round differently


def test_every_slope_at_zero_agrees_with_differences(rig, absent):
    apart = {}
    for i, name in enumerate(rig.names):
        slope = absent[1][:, :, i]
        assert np.isfinite(slope).all(), name
        if name in ("base_motion:world.frequency_hz", "base_motion:world.phase_rad"):
            assert not slope.any()  # of a base that does not move
            continue
        by = 1e-3 * rig.size[i]
        there = {k: rig.look(rig.setting, rig.addresses, _moved(rig, i, k * by))[0] for k in (-1, 1, 2)}
        difference = (there[1] - there[-1]) / (2 * by)
        if rig.parameters[i].lower == 0.0:  # one-sided, to second order
            difference = (4 * there[1] - 3 * absent[0] - there[2]) / (2 * by)
        assert np.linalg.norm(slope) * rig.size[i] > 1e-3, name  # rad or m, in all samples together
        apart[name] = np.linalg.norm(slope - difference) / np.linalg.norm(difference)
    # A step leaves 1e-10 lengths, which a difference over 3 µm of an offset shows as some 1e-7 of its slope.
    assert max(apart.values()) < 2e-6, apart


def _moved(rig, i, by):
    x = rig.drawn_x
    x[i] += by
    return x


def test_only_what_belongs_to_the_measurement_moves_the_static_frames(rig, absent):
    moved = np.abs(absent[1][:, TIMES < 0]).max((0, 1)) * rig.size
    of = dict(zip(rig.names, moved, strict=True))
    tilting = ("joint_axis_error", "base_motion:world.amplitude", "camera", "lens", "marker", "tracker")
    for name, by in of.items():
        if name.startswith(tilting):
            continue
        assert by < 1e-12, name
    assert of["tracker_drift:tip.x_m_per_s"] > 0
    assert of["base_motion:world.amplitude_m[0]"] > 0


def test_a_late_release_is_the_same_motion_later(rig, absent):
    late, _ = rig.ask(late_release__world__delay_s=3 * SAMPLE_S)
    still = TIMES <= 3.5 * SAMPLE_S
    np.testing.assert_allclose(late[:, still], np.repeat(absent[0][:, :1], still.sum(), 1), atol=1e-15)
    np.testing.assert_allclose(late[:, 7:], absent[0][:, 4:-3], atol=1e-12)


def test_a_base_that_accelerates_evenly_feels_like_other_gravity(rig, absent):
    slow, acceleration = 1e-4, np.array([0.7, -0.3])  # Hz, m/s²
    amplitude = -acceleration / (2 * np.pi * slow) ** 2
    shaken, _ = rig.ask(
        **{f"base_motion__world__amplitude_m[{i}]": amplitude[i] for i in (0, 1)},
        base_motion__world__frequency_hz=slow, base_motion__world__phase_rad=np.pi / 2,
    )  # fmt: skip
    other = eqx.tree_at(lambda m: m.drawing.gravity, rig.model, replace_fn=lambda g: g.at[:2].add(-acceleration))
    heavy, _ = rig.look(replace(rig.setting, model=other), rig.addresses, rig.drawn_x)
    assert np.abs(heavy[:JOINTS] - absent[0][:JOINTS]).max() > 1e-2
    # In 0.3 s the cosine falls by 2e-8 of itself.
    np.testing.assert_allclose(shaken[:JOINTS], heavy[:JOINTS], atol=1e-8)


def test_a_push_gives_the_named_joint_its_speed_and_no_other(rig, absent):
    for named, (moving, resting) in {"world": (0, 1), "elbow": (1, 0)}.items():
        slope = absent[1][:, :, rig.at(f"release_velocity__{named}__rad_per_s")]
        after = TIMES > 0
        speed = slope[:JOINTS, after][:, 0] / SAMPLE_S  # over the first 10 ms
        assert speed[moving] == pytest.approx(1.0, abs=0.02)
        assert abs(speed[resting]) < 0.02


def test_a_record_goes_on_by_the_stated_clock_when_the_release_is_late():
    values = np.array([[0.0], [1.0], [4.0], [9.0], [9.0]])
    later = Record(jnp.asarray(values), (("motor", "force_n"),)).later(jnp.asarray(1.5 * STEP_S), STEP_S)
    np.testing.assert_allclose(later.values[:, 0], [2.5, 6.5, 9.0, 9.0, 9.0])


def test_a_planar_loop_with_a_leaning_axis_shares_the_misfit_and_is_refused_as_a_drawing():
    lean = 0.02
    model = build(fourbar([effect("lean", "joint_axis_error", ["j2"], rad=[lean, 0.0])]))
    with pytest.raises(ValueError, match=r"cannot be closed.* degrees remain") as refusal:
        assembled(model, eqx.filter_jit(system)(model))
    left = math.radians(float(re.search(r"([\d.]+) degrees", str(refusal.value))[1]))
    assert 0.1 * lean < left < lean


def test_every_cause_has_a_number_that_a_fit_frees_without_being_named():
    for kind, effect_type in catalogue().items():
        expected = {name: d for name, d in effect_type.declarations().items() if d.expected is not None}
        assert all(d.expected > 0 for d in expected.values()), kind
        # Where a camera aims, or how fast a base shakes, is nothing by itself: it goes with what does something.
        assert not expected or any(not d.by_name for d in expected.values()), kind
