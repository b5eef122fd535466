"""What may be amiss: each kind is seen, is nothing at size zero, and is told from its rivals only where that can be."""

import numpy as np
import pytest

from backend.blind.withheld import case, library, outside
from backend.blind.withheld.case import reality
from backend.blind.withheld.causes import KINDS, OF_ONE_MAKE, Rig, cause, cause_everywhere, places
from backend.blind.withheld.detectability import Record, Witness, confusion, distance, rivals_of
from backend.blind.withheld.laws import Change, as_drawn, changed
from backend.blind.withheld.measurement import Noise, noisy, seen
from backend.blind.withheld.mechanisms import double_pendulum, pendulum, scissor
from backend.blind.withheld.motion import move
from backend.blind.withheld.turning import ratios, with_other_hinges

RECORD = Record(np.arange(60) / 60 - 0.2, np.arange(60) / 60)
NOISE = Noise(5e-4, 0.3, 0.0, 0.0, True)
KNOWN = [name for name, k in KINDS.items() if k.build.__module__ == library.__name__]
UNKNOWN = [name for name, k in KINDS.items() if k.build.__module__ == outside.__name__]


def rig_of(linkage, starts):
    motion = move(linkage, as_drawn(linkage, len(starts)), starts, RECORD.duration_s)
    q = motion.state[..., : motion.plant.n] @ motion.plant.tree.turned.T
    return Rig(
        linkage,
        np.stack([q.min((0, 1)), q.max((0, 1))], 1),
        np.stack([q[:, 0].min(0), q[:, 0].max(0)], 1),
    )


@pytest.fixture(scope="module")
def swinging():
    """A pendulum and a start on one side, so that a stop on the other is met."""
    linkage, starts = pendulum(np.random.default_rng(2)), np.array([[0.8]])
    return rig_of(linkage, starts), starts


@pytest.fixture(scope="module")
def double():
    """Two bars, for one alone does not feel its mass."""
    linkage, starts = double_pendulum(np.random.default_rng(2)), np.array([[0.8, 0.6]])
    return rig_of(linkage, starts), starts


@pytest.fixture(scope="module")
def sprung():
    linkage, starts = scissor(np.random.default_rng(5)), np.array([[0.2]])
    return rig_of(linkage, starts), starts


def record_of(rig, starts, made, size=1.0, crisp=True):
    laws = changed(as_drawn(rig.linkage), made.changes if made else (), size)
    path = move(rig.linkage, laws, starts, RECORD.duration_s, crisp=crisp)
    return seen(path, laws, rig.linkage.size, *RECORD.rows(1))


@pytest.mark.parametrize("name", sorted(KINDS))
def test_it_moves_the_record_and_is_nothing_at_size_zero(double, sprung, name):
    rig, starts = sprung if KINDS[name].at == "spring" else double
    made = cause(rig, name, places(rig.linkage, KINDS[name].at)[0], KINDS[name].high, np.random.default_rng(1))
    ideal = record_of(rig, starts, None, crisp=False)
    # A ten-thousandth of the rig: far above rounding, below what a camera of this check can see.
    assert np.abs(record_of(rig, starts, made) - ideal).max() > 1e-4 * rig.linkage.size
    drawn = as_drawn(rig.linkage)
    for number, value in changed(drawn, made.changes, 0.0).numbers.items():
        np.testing.assert_array_equal(value, drawn.numbers[number])


@pytest.mark.parametrize(("name", "shared"), OF_ONE_MAKE.items())
def test_parts_of_one_make_may_all_be_off_alike(double, name, shared):
    rig, starts = double
    rng, size = np.random.default_rng(0), KINDS[name].high
    every, one = cause_everywhere(rig, name, size, rng), cause(rig, name, 1, size / 2 if shared else size, rng)
    assert every is not None
    assert one is not None
    assert len(every.on) == len(set(every.on)) == len(every.places) == 2
    assert every.parameters == one.parameters
    assert [c.index for c in every.changes] == [0, 1]
    both, alone = (record_of(rig, starts, made) for made in (every, one))
    assert np.abs(both - alone).max() > 1e-4 * rig.linkage.size


def test_what_stands_alone_is_not_everywhere(swinging):
    assert cause_everywhere(swinging[0], "viscous_friction", 0.1, np.random.default_rng(0)) is None


def test_at_least_six_kinds_are_in_no_library():
    from backend.mechanism.kinds import effect_kinds

    assert len(UNKNOWN) >= 6
    assert not set(UNKNOWN) & set(effect_kinds())
    assert set(KNOWN) <= set(effect_kinds())


def test_what_is_absent_is_at_no_distance(swinging):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    assert distance(witness, record_of(rig, starts, None), []).d2 < 1e-3  # two tolerances of the same integrator


def test_twice_the_cause_is_four_times_as_far(swinging):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "camera_scale", 0, 0.001, None)
    one, two = (distance(witness, record_of(rig, starts, made, size), []).d2 for size in (1.0, 2.0))
    assert two / one == pytest.approx(4.0, rel=1e-3)  # the starts' slopes are first order


def test_a_turned_camera_is_a_leaning_rig_to_a_pendulum_at_the_origin(swinging):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "gravity_tilt", 0, 0.02, None)
    d2 = distance(witness, record_of(rig, starts, made), []).d2
    assert d2 > 100
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), d2)
    alike = {rival.kind for rival in far.alike}
    assert {"gravity_tilt", "camera_rotation"} <= alike
    assert not alike & {"viscous_friction", "camera_scale", "frame_rate_error"}


def test_drag_on_a_hanging_link_is_friction_at_its_hinge(double):
    rig, starts = double
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "viscous_friction", 0, 0.1, None)
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), 1e5)
    assert {(r.kind, r.on) for r in far.alike} == {("viscous_friction", ("j1",)), ("linear_drag", ("upper",))}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("linkage_seed", "start", "frames", "size", "d2"),
    [(5, 0.2, 0, 0.01, 1e5), (4, -0.3, 150, 0.01, 1e5), (5, 0.2, 0, 0.06, 4e6)],
)
def test_every_hinge_of_a_scissor_that_turns_alike_may_hold_the_friction(linkage_seed, start, frames, size, d2):
    linkage, starts = scissor(np.random.default_rng(linkage_seed)), np.array([[start]])
    rig, time_s = rig_of(linkage, starts), np.arange(frames) / 90
    record = Record(time_s - 0.2, time_s) if frames else RECORD
    witness = Witness(rig.linkage, starts, record, NOISE)
    made = cause(rig, "viscous_friction", 0, size, None)
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), d2)
    hinges = tuple(pin.id for pin in rig.linkage.pins if pin.id != "slot")
    # Feet turn half as fast, which a quarter of the friction makes up for; only the slot slides another way.
    alike = {rival.on for rival in far.alike if rival.kind == "viscous_friction"}
    assert alike == {(hinge,) for hinge in hinges} | {hinges}


def test_a_spring_may_be_at_every_hinge_of_a_scissor_wherever_it_rests(sprung):
    rig, starts = sprung
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "torsion_spring", 0, 0.05, np.random.default_rng(3))
    assert made is not None
    assert abs(made.changes[1].value) > 0.1 * made.changes[0].value  # it rests away from the drawn pose
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), 1e4)
    hinges = {(rig.linkage.pins[i].id,) for i in places(rig.linkage, "hinge")}
    assert hinges <= {rival.on for rival in far.alike if rival.kind == "torsion_spring"}
    assert not any(rival.kind == "effort_offset" for rival in far.alike)


def test_a_slide_along_a_spring_rubs_as_the_spring_is_damped(sprung):
    rig, starts = sprung
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    slot = [pin.id for pin in rig.linkage.pins].index("slot")
    made = cause(rig, "viscous_friction", slot, 0.01, None)
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), 1e4)
    assert ("extension_spring", ("s1",)) in {(rival.kind, rival.on) for rival in far.alike}


def test_friction_that_falls_with_speed_may_be_at_every_hinge_of_a_scissor(sprung):
    rig, starts = sprung
    truth = cause(rig, "stribeck_friction", 8, 0.01, np.random.default_rng(0))
    assert truth is not None
    drawn, witness = as_drawn(rig.linkage), Witness(rig.linkage, starts, RECORD, NOISE)

    def record_of(laws):
        motion = move(rig.linkage, laws.repeated(1), starts, RECORD.duration_s)
        return seen(motion, laws, rig.linkage.size, *RECORD.rows(1))

    clean = record_of(changed(drawn, truth.changes))
    nothing = distance(witness, clean, [])
    found = with_other_hinges(nothing, witness, rig, truth, drawn, clean, record_of)
    hinges = {(rig.linkage.pins[i].id,) for i in places(rig.linkage, "hinge")} - {truth.on}
    assert hinges < {rival.on for rival in found.alike if rival.kind == truth.kind}
    assert found.rivals[-1].places == ()  # all at once names none
    assert found.remainders[-1] < 0.1 * found.d2
    other = next(rival for rival in found.alike if rival.on != truth.on and len(rival.on) == 1)
    turns = ratios(witness, rig, changed(drawn, truth.changes), 8)
    i = next(i for i in turns if rig.linkage.pins[i].id == other.on[0])
    torque, excess, rate = (change.value for change in truth.changes)
    moved = [
        Change("coulomb", i, torque / turns[i]),
        Change("stribeck_excess", i, excess, sized=False),
        Change("stribeck_rate", i, rate * turns[i], sized=False),
    ]
    assert distance(witness, record_of(changed(drawn, moved)), [], (drawn, clean)).d2 < 1e-3 * found.d2


@pytest.mark.parametrize(("noise", "plain"), [(15.0, True), (1.0, False)])
def test_friction_that_hardly_shows_may_be_of_one_size_at_any_speed(double, noise, plain):
    rig, starts = double
    truth = cause(rig, "stribeck_friction", 1, 0.01, np.random.default_rng(0))
    assert truth is not None
    louder = Noise(noise * NOISE.sigma_m, NOISE.rho, 0.0, 0.0, True)
    drawn, witness = as_drawn(rig.linkage), Witness(rig.linkage, starts, RECORD, louder)

    def record_of(laws):
        motion = move(rig.linkage, laws.repeated(len(starts)), starts, RECORD.duration_s, crisp=True)
        return seen(motion, laws.repeated(len(starts)), rig.linkage.size, *RECORD.rows(len(starts)))

    clean = record_of(changed(drawn, truth.changes))
    found = with_other_hinges(distance(witness, clean, []), witness, rig, truth, drawn, clean, record_of)
    assert found.d2 > 9.0  # it is seen
    assert (("coulomb_friction", truth.on) in {(rival.kind, rival.on) for rival in found.alike}) == plain


def test_a_lens_that_is_off_may_be_a_mark_that_is(swinging):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "lens_distortion", 0, 0.005, None)
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), 500.0)
    assert any(rival.kind == "marker_offset" for rival in far.alike)  # on a circle about the picture's middle


def test_friction_that_falls_with_speed_is_its_own_where_hinges_turn_apart(double):
    rig, starts = double
    truth = cause(rig, "stribeck_friction", 1, 0.01, np.random.default_rng(0))
    assert truth is not None
    drawn, witness = as_drawn(rig.linkage), Witness(rig.linkage, starts, RECORD, NOISE)
    assert list(ratios(witness, rig, changed(drawn, truth.changes), 1)) == [1]


def test_a_rotor_in_a_scissor_is_all_of_its_links_heavier_to_turn(sprung):
    rig, starts = sprung
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "rotor_inertia", 0, 0.2, None)
    far = confusion(witness, made, rivals_of(rig, [made]), as_drawn(rig.linkage), 1e5)
    together = next(r for r in far.alike if r.kind == "inertia_error" and len(r.on) > 1)
    assert together.on == tuple(link.id for link in rig.linkage.links)
    assert together.places == ()  # which of them may lie anywhere says nothing of where


def test_a_lighter_bar_beside_a_torque_is_another_bar_heavier_beside_a_larger_one(double):
    rig, starts = double
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    lighter, torque = (
        cause(rig, name, i, size, None) for name, i, size in (("mass_error", 0, -0.2), ("effort_offset", 1, 0.05))
    )
    rest = changed(as_drawn(rig.linkage), torque.changes)

    def alike(others):
        far = confusion(witness, lighter, rivals_of(rig, [lighter]), rest, 1e5, others)
        return {rival.on for rival in far.alike if rival.kind == "mass_error"}

    # Only ratios of masses and torque move it: the torque must be free to follow.
    assert ("lower",) in alike([torque])
    assert ("lower",) not in alike([])


def test_a_loose_pin_is_held_against_the_length_of_its_bar(swinging):
    rig, _ = swinging
    made = cause(rig, "clearance", 0, 0.001, None)
    assert ("length_error", ("arm",)) in {(r.kind, r.on) for r in rivals_of(rig, [made])}


def test_a_rough_spot_is_like_nothing_known(swinging):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    made = cause(rig, "friction_bump", 0, 0.3, np.random.default_rng(1))
    far = distance(witness, record_of(rig, starts, made), rivals_of(rig, [made]))
    assert min(far.remainders) > 100


def test_the_camera_follows_the_file_formats_words(swinging):
    rig, starts = swinging
    ideal = record_of(rig, starts, None)
    scaled, turned = (record_of(rig, starts, cause(rig, k, 0, 0.02, None)) for k in ("camera_scale", "camera_rotation"))
    np.testing.assert_allclose(scaled, 1.02 * ideal, rtol=1e-12)
    np.testing.assert_allclose(turned, ideal * np.exp(0.02j), rtol=1e-12)
    # The clock: true time = stated + offset, so what is reported runs ahead.
    early = record_of(rig, starts, cause(rig, "time_offset", 0, 3 / 60, None))
    np.testing.assert_allclose(early[:, 12:-3], ideal[:, 15:], atol=1e-9)
    # A frame rate 2% higher than stated: the frame of stated second t was taken t / 1.02 after the release.
    laws = as_drawn(rig.linkage)
    path = move(rig.linkage, laws, starts, RECORD.duration_s)
    fast = record_of(rig, starts, cause(rig, "frame_rate_error", 0, 0.02, None))
    np.testing.assert_allclose(fast, path.markers(np.maximum(RECORD.since_release_s / 1.02, 0)[None]), atol=1e-12)


def test_the_noise_is_as_stated():
    clean = np.zeros((4000, 4), complex)
    errors = noisy(clean, Noise(1e-3, 0.4, 0.0, 0.0, True), np.random.default_rng(0))
    good = np.isfinite(errors).all(1)
    x = np.real(errors[good])
    assert x.std() == pytest.approx(1e-3, rel=0.05)  # 16000 samples, correlated
    assert np.mean(x[1:] * x[:-1]) / np.mean(x**2) == pytest.approx(0.4, abs=0.05)
    wild = noisy(clean, Noise(1e-3, 0.0, 0.02, 0.01, True), np.random.default_rng(0))
    assert np.mean(np.abs(wild) > 5.5e-3) == pytest.approx(0.02, abs=0.004)


def test_engines_draw_what_is_amiss_into_their_copy(swinging):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install linktwin[peers]")
    rig, starts = swinging
    made = cause(rig, "viscous_friction", 0, 0.05, None)
    laws = changed(as_drawn(rig.linkage), made.changes)
    ours, theirs = (reality(rig.linkage, [made], laws, starts, RECORD, engine) for engine in ("own", "mujoco"))
    assert np.abs(ours - theirs).max() < 1e-6


@pytest.mark.parametrize(("apart_m", "shown"), [(1e-6, False), (1e-3, True)])
def test_an_engine_whose_own_error_the_data_would_show_moves_no_study(swinging, monkeypatch, apart_m, shown):
    rig, starts = swinging
    witness = Witness(rig.linkage, starts, RECORD, NOISE)
    drifts = record_of(rig, starts, None) + apart_m * np.sin(40.0 * RECORD.elapsed_s)[:, None]
    monkeypatch.setattr(case, "reality", lambda *given: drifts)
    assert case._betrays_itself("mujoco", witness) is shown


def test_strata_come_in_their_shares():
    drawn = [case.stratum_of(4, i) for i in range(200)]
    shares = {name: drawn.count(name) / 200 for name in set(drawn)}
    assert shares == {"none": 0.20, "single": 0.35, "pair": 0.15, "left_out": 0.15, "never": 0.15}
