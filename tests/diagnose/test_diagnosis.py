"""Diagnoses of a filmed bar whose reality is SciPy's integrator, with causes that the drawing lacks."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from backend.mechanism.read import parse_mechanism
from backend.mechanism.study import Experiment, Release, Study

LENGTH, MASS, GRAVITY, INERTIA, SIGMA = 0.2, 0.5, 9.81, 2e-3, 5e-4
RATE, STILL = 60.0, 20
HINGE = {"position_m": [0, 0, 0], "quaternion_wxyz": [0.7071067811865476, 0.7071067811865476, 0, 0]}
FEW = frozenset({"clearance", "joint_stop", "link_flexibility", "pin_friction"})  # one program each to compile
RUB = 0.02  # N m, 2% of m g L
GIVES = 4e-3  # rad
COARSE_S = 1.0 / 180.0  # of a step: half the steps that a diagnosis would choose

pytestmark = pytest.mark.timeout(
    900
)  # each compiles several programs: two minutes of two free cores, five of shared ones


@pytest.fixture(scope="module")
def run_often() -> bool:
    """A diagnosis runs one program hundreds of times, and all of these run the same."""
    return True


@pytest.fixture(scope="module")
def drawing():
    """A bar that hangs along -z and turns about -y."""
    pose = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
    inertia = {"xx": INERTIA, "yy": INERTIA, "zz": INERTIA, "xy": 0, "xz": 0, "yz": 0}
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "bar", "gravity_m_per_s2": [0, 0, -GRAVITY],
            "provenance": {"tool": "t", "tool_version": "1", "exporter": "e", "exporter_version": "1",
                           "created": "2026-01-01T00:00:00Z", "warnings": []},
            "bodies": [
                {"id": "ground", "fixed": True, "pose": pose},
                {"id": "bar", "pose": pose,
                 "inertial": {"mass_kg": MASS, "center_of_mass_m": [0, 0, -LENGTH], "inertia_kg_m2": inertia}},
            ],
            "joints": [{"id": "j1", "type": "revolute", "body_a": "ground", "body_b": "bar",
                        "frame_a": HINGE, "frame_b": HINGE}],
            "effects": [],
            "markers": [{"id": "tip", "body": "bar", "position_m": [0, 0, -0.3]},
                        {"id": "mid", "body": "bar", "position_m": [0.03, 0, -0.1]}],
        }
    )  # fmt: skip


def study(
    drawing, seed, torque=None, places=lambda p: p, angles=(0.9, -0.5, 1.4), rub=0.0, kick=0.0, frames=60, memory=0.0
):
    """One release of every three is held out, the rest are fitted.

    torque(t, q, rate): what the drawing lacks. places: what the camera does. rub: dry friction [N m] of bristles that
    bend by GIVES before they slide. kick: rate at the release [rad/s]. frames: after it; 60 are a swing. memory: share
    of the noise that stays from one frame to the next.
    """
    rng = np.random.default_rng(seed)
    since = (np.arange(STILL + frames) - STILL + 0.5) / RATE
    experiments = []
    for i, angle in enumerate(angles):

        def slope(t, y):
            q, rate, bent = y
            extra = (torque(t, q, rate) if torque else 0.0) - rub * bent
            faster = (-MASS * GRAVITY * LENGTH * np.sin(q) + extra) / (MASS * LENGTH**2 + INERTIA)
            return [rate, faster, (rate - abs(rate) * bent) / GIVES]

        moving = since[since > 0]
        found = solve_ivp(
            slope, (0, moving[-1]), [angle, kick, 0.0], t_eval=moving, rtol=1e-9, atol=1e-11, max_step=2e-3
        )
        q = np.concatenate([np.full(STILL, angle), found.y[0]])
        tables = []
        for m in drawing.markers:
            x0, _, z0 = m.position_m
            p = places(np.stack([np.cos(q) * x0 - np.sin(q) * z0, np.sin(q) * x0 + np.cos(q) * z0], 1))
            p = p + SIGMA * remembering(memory, rng.standard_normal(p.shape))
            tables.append(
                pd.DataFrame({"time_s": since + STILL / RATE, "marker": m.id, "x_m": p[:, 0], "y_m": np.nan,
                              "z_m": p[:, 1], "sigma_m": np.nan})
            )  # fmt: skip
        release = Release(time_s=STILL / RATE)
        use = "fit" if i < len(angles) - len(angles) // 3 else "held_out"
        experiments.append(Experiment(f"e{i}", use, release, tracks=pd.concat(tables, ignore_index=True)))
    return Study(drawing, tuple(experiments))


def remembering(share, fresh):
    """Noise of which a share stays from one sample to the next."""
    if share == 0.0:
        return fresh
    made = fresh.copy()
    for i in range(1, len(made)):
        made[i] = share * made[i - 1] + np.sqrt(1.0 - share**2) * fresh[i]
    return made


def rubbing(t, q, rate):
    """Coulomb friction of another form than ours: it creeps."""
    return -RUB * np.tanh(rate / 0.01)


@pytest.fixture(scope="module")
def kept_at(tmp_path_factory):
    return tmp_path_factory.mktemp("search") / "kept.jsonl"


@pytest.fixture(scope="module")
def rubbed(drawing, kept_at):
    from backend.diagnose.kept import Kept
    from backend.diagnose.run import diagnose_study

    told = study(drawing, 1, rub=RUB)
    return diagnose_study(told, without=FEW, step_s=COARSE_S, kept=Kept.of(kept_at, told, FEW, resume=False)).report


def test_a_search_that_was_cut_off_goes_on_without_searching_again(drawing, kept_at, rubbed, monkeypatch):
    from backend.diagnose import fitted
    from backend.diagnose.kept import Kept
    from backend.diagnose.run import diagnose_study

    lines = kept_at.read_text().splitlines()
    kept_at.write_text("\n".join(lines[:-3]) + "\n" + lines[-3][:20])  # killed three fits before its end
    searched = []

    def counted(problem, *given, solve=fitted.solve, **options):
        searched.append(problem)
        return solve(problem, *given, **options)

    monkeypatch.setattr(fitted, "solve", counted)
    told = study(drawing, 1, rub=RUB)
    again = diagnose_study(told, without=FEW, step_s=COARSE_S, kept=Kept.of(kept_at, told, FEW, resume=True)).report
    assert len({id(problem) for problem in searched}) == 3  # some in two goes
    assert [c.effects for c in again.causes] == [c.effects for c in rubbed.causes]
    assert again.verdict == rubbed.verdict


def test_dry_friction_is_named_at_its_joint_with_its_size(rubbed):
    assert rubbed.verdict in ("identified", "ambiguous")
    (first,) = rubbed.causes[0].effects
    assert first.kind in ("coulomb_friction", "stribeck_friction")
    assert rubbed.where.locations[0].at == "joint:j1"
    found = [e for c in rubbed.causes for e in c.effects if len(c.effects) == 1 and e.kind == "coulomb_friction"]
    amount, gives = (found[0].parameters[k] for k in ("friction_torque_n_m", "presliding_rad"))
    assert abs(amount.value - RUB) < 4 * amount.sd
    assert abs(gives.value - GIVES) < 4 * gives.sd + 0.2 * GIVES
    assert gives.sd < 0.3 * GIVES


def test_probabilities_of_all_explanations_sum_to_one(rubbed):
    total = sum(c.probability for c in rubbed.causes) + rubbed.probability_none + rubbed.probability_unknown
    assert total == pytest.approx(1.0, abs=1e-9)
    assert sum(at.probability for at in rubbed.where.locations) == pytest.approx(1.0, abs=1e-6)


def test_the_gap_shrinks_to_the_noise_where_nothing_was_fitted(rubbed):
    held = rubbed.shrink.held_out
    assert held.explained_fraction > 0.95
    assert held.after_rms_m < 1.3 * held.noise_rms_m


def test_a_late_release_and_a_clock_that_is_behind_are_said_to_be_one_motion(rubbed):
    groups = [{(e.kind, e.on[0]) for e in group} for group in rubbed.inseparable]
    assert any({("late_release", "world"), ("time_offset", "camera")} <= group for group in groups)
    assert not any({("coulomb_friction", "j1"), ("viscous_friction", "j1")} <= group for group in groups)


@pytest.mark.nightly
def test_a_member_that_stood_for_another_is_exchanged_for_it(drawing):
    from backend.diagnose.cause import Cause
    from backend.diagnose.fitted import fit, log_evidence
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    told = study(drawing, 5, lambda t, q, rate: rubbing(t, q, rate) - 4e-3 * rate, frames=84)
    search = Search(
        prepare(told, library(drawing, SMOOTH, told.tolerances, FEW), COARSE_S), lambda w: None, lambda: False
    )
    search.baseline()
    of = {c.name: c for c in search.subject.library.candidates}
    fitted = fit(search.subject, search.subject.choose(of["coulomb_friction:j1"], of["air_drag:bar"]))
    close, far = (fit(search.subject, fitted.choice, ahead=share * fitted.chi2) for share in (1.0, 0.01))
    assert close.chi2 == pytest.approx(fitted.chi2, abs=0.5)
    assert fitted.chi2 < far.chi2 < 1.1 * fitted.chi2  # so far behind another, it ends early
    wrong = Cause(fitted, log_evidence(fitted))
    search.exchange(wrong)
    assert ("coulomb_friction:j1",) in search.tried  # given up for nothing
    right = search.tried[("coulomb_friction:j1", "viscous_friction:j1")]
    assert right.fitted.chi2 < wrong.fitted.chi2 - 9.0
    assert right.values["viscous_friction:j1.damping_n_m_s_per_rad"] == pytest.approx(4e-3, rel=0.1)


def test_a_pair_finds_one_that_does_the_same_with_no_member_of_its_own(drawing):
    from backend.diagnose.cause import Cause
    from backend.diagnose.fitted import fit, log_evidence
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.same_motion import complete
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import APART, Search

    told = study(drawing, 5, lambda t, q, rate: -4e-3 * rate - 0.05 * np.sin(q))
    search = Search(
        prepare(told, library(drawing, SMOOTH, told.tolerances, FEW), COARSE_S), lambda w: None, lambda: False
    )
    search.baseline()
    of = {c.name: c for c in search.subject.library.candidates}
    fitted = fit(search.subject, search.subject.choose(of["linear_drag:bar"], of["inertia_error:bar"]))
    known = Cause(fitted, log_evidence(fitted))
    assert list(search.tried) == [()]  # no level led to either of the two
    found = {c.names: c for c in complete(search, known, 1.0)}
    same = found[("frame_rate_error:camera", "viscous_friction:j1")]
    assert abs(same.fitted.chi2 - fitted.chi2) < APART
    assert same.values["viscous_friction:j1.damping_n_m_s_per_rad"] == pytest.approx(4e-3, rel=0.05)
    assert all(c.fitted.chi2 < fitted.chi2 + 2.0 * APART for c in found.values())  # what cannot do it is not fitted


def test_a_set_that_does_the_same_begins_where_it_does(drawing):
    """A turned camera for a base that leans: the bar starts that much higher."""
    from backend.diagnose.cause import begun_from
    from backend.diagnose.fitted import fit
    from backend.diagnose.heard import heard
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.same_motion import begun_alike
    from backend.diagnose.screen import beyond, library_slopes
    from backend.diagnose.seer import Seer
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    turned = study(drawing, 5, places=lambda p: p @ np.array([[c := np.cos(0.05), s := np.sin(0.05)], [-s, c]]))
    search = Search(
        prepare(turned, library(drawing, SMOOTH, turned.tolerances, FEW), COARSE_S), lambda w: None, lambda: False
    )
    subject, drawn = search.subject, search.baseline()
    subject.library = heard(subject.library, np.linalg.norm(library_slopes(drawn.fitted), axis=0))
    of = {c.name: c for c in subject.library.candidates}
    lean, turn = of["gravity_tilt:world"], of["camera_rotation:camera"]
    fitted = fit(subject, subject.choose(lean))
    about, choice = beyond(fitted, (lean,)), subject.choose(turn)
    values = next(values for members, _, values in about.sets([turn], 1) if members == (turn,))

    def left(x):
        probes = [p.choose(choice.ties, subject.neutral) for p in subject.fit]
        r, _ = Seer(subject, probes, 1.0)(x)
        return float(r @ r)

    assert abs(next(iter(values.values()))) == pytest.approx(0.05, rel=0.05)
    moved = left(begun_alike(fitted, choice, about, (lean,), (turn,), values))
    assert moved < 1.1 * fitted.chi2
    assert left(begun_from(fitted, choice, values)) > 5.0 * moved


def test_a_drawing_that_is_right_has_no_gap(drawing):
    from backend.diagnose.run import diagnose_study

    found = diagnose_study(study(drawing, 2)).report
    assert found.verdict == "none"
    assert found.probability_none > 0.5
    smallest = {d.kind: d.minimum for d in found.detectable if d.kind == "coulomb_friction"}
    assert smallest["coulomb_friction"] < RUB  # it would have been seen


def test_what_is_too_faint_for_any_test_is_listed_beside_none_for_what_it_is_worth(drawing):
    from backend.diagnose.run import diagnose_study

    found = diagnose_study(study(drawing, 1, places=lambda p: 1.0004 * p)).report
    assert found.verdict == "none"
    assert found.p_value > 0.05
    assert found.probability_none > 0.5
    (true,) = (c for c in found.causes if c.effects[0].kind == "camera_scale")
    assert true.probability > 0.02
    total = sum(c.probability for c in found.causes) + found.probability_none + found.probability_unknown
    assert total == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(4))
def test_wild_samples_at_the_end_of_one_record_whose_noise_remembers_are_no_gap(drawing, seed):
    from backend.diagnose.adequacy import adequacy
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.diagnose.which import Search

    told = study(drawing, seed, angles=(0.9,), frames=84, memory=0.2)
    tracks, rng = told.experiments[0].tracks, np.random.default_rng(seed)
    times = np.unique(tracks.time_s)
    for frame, throw in ((-7, 9.0), (-3, 7.0), (-2, 12.0), (-1, 9.0)):
        at, turn = (tracks.time_s == times[frame]) & (tracks.marker == "tip"), rng.uniform(0.0, 2.0 * np.pi)
        tracks.loc[at, "x_m"] += throw * SIGMA * np.cos(turn)
        tracks.loc[at, "z_m"] += throw * SIGMA * np.sin(turn)
    subject = prepare(told, library(drawing, SMOOTH, told.tolerances, FEW), COARSE_S)
    search = Search(subject, lambda words: None, lambda: False)
    drawn = search.baseline()
    assert adequacy(drawn.fitted, search.latent, np.random.default_rng(0)).p > 0.01


@pytest.mark.nightly
def test_a_kick_at_the_release_is_unknown_where_the_library_has_none(drawing):
    """A base that shakes from the release on moves the bar as a kick does, and would be named for it."""
    from backend.diagnose.run import diagnose_study

    found = diagnose_study(study(drawing, 6, kick=0.12), without=FEW | {"release_velocity"}, step_s=COARSE_S).report
    assert found.verdict == "unknown"
    assert found.where.locations[0].at == "world"


@pytest.mark.nightly
def test_a_camera_that_enlarges_is_told_from_a_long_bar(drawing):
    from backend.diagnose.run import diagnose_study

    found = diagnose_study(study(drawing, 3, places=lambda p: 1.02 * p)).report
    assert found.where.locations[0].at == "camera"
    assert found.causes[0].effects[0].kind == "camera_scale"
    assert found.causes[0].effects[0].parameters["relative"].value == pytest.approx(0.02, abs=2e-3)


@pytest.mark.nightly
def test_a_wire_that_tightens_is_an_unknown_law_of_where_the_joint_is(drawing):
    from backend.diagnose.run import diagnose_study

    def wire(t, q, rate):
        return -0.15 * max(q - 0.3, 0.0)

    told = study(drawing, 5, wire, angles=(0.9, -0.5, 1.4))
    found = diagnose_study(told, without=FEW | {"torsion_spring"}, step_s=COARSE_S).report
    assert found.verdict == "unknown"
    assert found.where.locations[0].at == "joint:j1"


@pytest.mark.nightly
def test_a_rough_spot_is_friction_of_an_unknown_law(drawing):
    from backend.diagnose.run import diagnose_study

    def rough(t, q, rate):
        return -0.03 * np.exp(-0.5 * ((q - 0.3) / 0.1) ** 2) * np.tanh(rate / 0.02)

    found = diagnose_study(study(drawing, 7, rough, frames=84), without=FEW, step_s=COARSE_S).report
    assert found.verdict == "unknown"
    assert found.where.locations[0].at == "joint:j1"


@pytest.mark.nightly
def test_a_brake_that_acts_in_a_part_of_the_way_is_an_unknown_law(drawing):
    from backend.diagnose.run import diagnose_study

    def brake(t, q, rate):
        return -0.01 * np.exp(-(((q - 0.3) / 0.25) ** 4)) * rate

    found = diagnose_study(study(drawing, 8, brake, frames=84), without=FEW, step_s=COARSE_S).report
    assert found.verdict == "unknown"
    assert found.where.locations[0].at == "joint:j1"


@pytest.mark.nightly
def test_a_blow_that_no_effect_of_the_library_gives_is_unknown_and_lies_at_the_joint(drawing):
    from backend.diagnose.run import diagnose_study

    def blow(t, q, rate):
        return 0.8 * np.exp(-0.5 * ((q - 0.2) / 0.06) ** 2) * np.sign(q)

    told = study(drawing, 4, blow, angles=(0.9, -0.7, -1.1), frames=84)
    found = diagnose_study(told, without=FEW, step_s=COARSE_S).report
    assert found.verdict == "unknown"
    assert found.probability_unknown >= 0.9
    assert found.where.model_free[0].at == "joint:j1"
