"""One bad joint among the pins of a scissor, and none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from backend.fit.alike import Alike
from backend.fit.deviants import Deviants
from backend.fit.sparse import Sparse
from backend.mechanism.study import Experiment, Release, Study
from tests.mechanisms import Z, bar, drawing, effect

CELLS, DAMPING, TIMES, BAD = 5, 1e-3, 5.0, "mid2"  # pins: viscous friction [N m s/rad]
STEP_S, SIGMA_RAD = 2e-3, 1e-5  # encoders of 19 bits
STILL, SAMPLES = 10, 200


def uneven_scissor(damping, cells=CELLS, uneven_m=0.03):
    """Crossed bars hinged to the ground at one corner, pins off their middles: no two pins turn alike.

    In a regular scissor all pins turn by the same angle, and no motion tells whose friction it is that slows it.
    """
    rng = np.random.default_rng(5)
    low, top = np.array([0.0, -0.06, 0.0]), np.array([0.0, 0.06, 0.0])
    bars, pins, bottom, ceiling = [], [], "ground", ""
    for i in range(cells):
        before_a, before_b, after_a, after_b = 0.1 + uneven_m * rng.uniform(-1, 1, 4)
        gap = np.linalg.norm(top - low)
        down = (top - low) / gap
        along = (gap**2 + before_a**2 - before_b**2) / (2 * gap)
        cross = low + along * down + np.sqrt(before_a**2 - along**2) * np.array([down[1], -down[0], 0.0])
        end_a = cross + (cross - low) * after_a / before_a
        end_b = cross + (cross - top) * after_b / before_b
        bars += [bar(f"a{i}", low, end_a, 0.05), bar(f"b{i}", top, end_b, 0.05)]
        pins += [(f"mid{i}", f"a{i}", f"b{i}", cross), (f"low{i}", bottom, f"a{i}", low)]
        pins += [(f"top{i}", ceiling, f"b{i}", top)] if ceiling else []
        low, top, bottom, ceiling = end_b, end_a, f"b{i}", f"a{i}"
    spring = effect(
        "spring", "extension_spring", ["a0", "b0"], anchor_a_m=[0, 0, 0], anchor_b_m=[0, 0, 0],
        stiffness_n_per_m=60.0, free_length_m=0.06,
    )  # fmt: skip
    drag = [effect(f"v_{id}", "viscous_friction", [id], damping_n_m_s_per_rad=damping) for id, *_ in pins]
    joints = [(id, "revolute", a, b, point, Z) for id, a, b, point in pins]
    return drawing("uneven scissor", bars, joints, [spring, *drag])


def seen_by_encoders(drawn, damping, samples=SAMPLES, step_s=STEP_S, sigma_rad=SIGMA_RAD):
    """Studies of encoders at every pin, from damping by pin: our own motion, since names are at stake, not physics."""
    from backend.fit.free import free_parameters
    from backend.fit.prediction import addresses_of
    from backend.fit.run import Run
    from backend.model.build import build

    freedom = free_parameters(drawn, ["viscous_friction:*"])
    time = step_s * np.arange(STILL + samples)
    rows = [pd.DataFrame({"time_s": time, "joint": j.id, "q": 0.0, "sigma": sigma_rad}) for j in drawn.joints]
    blank = Experiment("e", "fit", Release(time_s=step_s * STILL), joint_positions=pd.concat(rows, ignore_index=True))
    run = Run.of(blank, build(drawn, freedom.added), addresses_of(freedom.parameters), step_s)
    order = np.lexsort((run.data.time_s, run.data.channel))
    at = np.array([c.at.removeprefix("joint:") for c in run.data.channels])[run.data.channel]

    def study(seed, **bad):
        truth = np.array([damping * bad.get(f.on[0], 1.0) for f in freedom.parameters])
        clean, _ = run.predict(truth, run.start)
        q = clean + sigma_rad * np.random.default_rng(seed).standard_normal(clean.size)
        table = pd.DataFrame({"time_s": run.data.time_s, "joint": at, "q": q, "sigma": sigma_rad}).iloc[order]
        return Study(drawn, (replace(blank, joint_positions=table.reset_index(drop=True)),))

    return study


@pytest.fixture(scope="module")
def seen():
    return seen_by_encoders(uneven_scissor(2 * DAMPING), DAMPING)


def fitted(study, **options):
    from backend.fit.fit_study import fit_study

    return fit_study(study, ["viscous_friction:*"], sparse=True, profiles=False, **({"step_s": STEP_S} | options))


@pytest.fixture(scope="module")
def with_a_bad_pin(seen):
    return fitted(seen(1, **{BAD: TIMES}))


@pytest.mark.nightly
def test_one_bad_pin_is_named_alone_and_measured(with_a_bad_pin):
    report = with_a_bad_pin.report
    (found,) = report.deviations
    assert found.name == f"viscous_friction:{BAD}.damping_n_m_s_per_rad"
    assert found.others == f"viscous_friction:all-{BAD}.damping_n_m_s_per_rad"
    assert found.could_be == ()
    for p in report.parameters:
        truth = DAMPING * (TIMES if p.name == found.name else 1.0)
        assert abs(p.value - truth) < 3.5 * p.sd  # one seed, two values: 0.1% to fail by chance
        assert p.sd < 0.05 * truth
    assert found.difference == pytest.approx((TIMES - 1) * DAMPING, abs=3.5 * found.sd)
    assert report.converged


def test_a_fit_cut_short_names_only_what_has_a_value_of_its_own(seen):
    report = fitted(seen(1, **{BAD: TIMES}), max_iterations=1).report
    assert not report.converged
    assert report.deviations
    for found in report.deviations:
        assert found.name != found.others
        assert found.name in [p.name for p in report.parameters]


def test_where_all_pins_are_alike_none_is_named(seen):
    report = fitted(seen(2)).report
    assert report.deviations == ()
    (shared,) = report.parameters
    assert shared.on == "all"
    assert abs(shared.value - DAMPING) < 3.5 * shared.sd


def test_what_was_found_is_said_and_can_be_handed_on(with_a_bad_pin):
    from backend.export.fitted import fitted as twin
    from backend.report.fit_summary import fit_text

    assert f"viscous_friction:{BAD}.damping_n_m_s_per_rad: 0.00" in fit_text(with_a_bad_pin.report)
    drawn = twin(uneven_scissor(2 * DAMPING), with_a_bad_pin.report)
    values = {e.on[0]: e.parameters["damping_n_m_s_per_rad"] for e in drawn.effects if e.kind == "viscous_friction"}
    assert values.pop(BAD) == pytest.approx(TIMES * DAMPING, rel=0.1)
    assert set(values.values()) == {with_a_bad_pin.report.parameters[0].value}


def test_a_fit_killed_after_names_were_given_finds_them_again(seen, with_a_bad_pin, tmp_path):
    study, kept = seen(1, **{BAD: TIMES}), tmp_path / "fit.checkpoint.json"

    def die(fraction, words):
        if words.startswith("fitting what deviates, iteration 2"):
            raise MemoryError

    with pytest.raises(MemoryError):
        fitted(study, checkpoint=kept, progress=die)
    resumed = fitted(study, checkpoint=kept, resume=True).report
    assert [d.name for d in resumed.deviations] == [d.name for d in with_a_bad_pin.report.deviations]
    for again, p in zip(resumed.parameters, with_a_bad_pin.report.parameters, strict=True):
        assert again.value == pytest.approx(p.value, abs=0.01 * p.sd)  # a millionth of the objective is left
    assert len(resumed.history) > 10


def test_nothing_to_share_is_refused(seen):
    from backend.fit.fit_study import fit_study

    with pytest.raises(ValueError, match="could be shared: a sparse fit needs values of one kind at three places"):
        fit_study(seen(1), ["viscous_friction:mid0,viscous_friction:mid1"], sparse=True)


def named_elsewhere(truth: int, named: int, alike: float = 0.0):
    """What becomes of a name among four places of which one holds 3 and the others 1; place 2 does as place 1 does,
    but for a share.
    """
    A = np.eye(4)
    A[:, 2] = alike * A[:, 1] + (1.0 - alike) * A[:, 2]
    real, x = np.ones(4), np.ones(4)
    real[truth], x[named] = 3.0, 3.0
    sparse = object.__new__(Sparse)
    sparse.groups = [Alike((0, 1, 2, 3), everywhere=True)]
    sparse.full = SimpleNamespace(residual=lambda x: A @ (x - real))
    sparse.matrix = np.column_stack([np.arange(4) != named, np.arange(4) == named]).astype(float)
    return sparse._tried(SimpleNamespace(heed=lambda: None), x, Deviants((named,), {named: ()}, np.ones(4), x))


def test_a_place_that_explains_the_data_better_takes_the_name():
    found = named_elsewhere(truth=2, named=1)
    assert found.apart == (2,)
    np.testing.assert_array_equal(found.values, [1.0, 1.0, 3.0, 1.0])


def test_a_place_that_does_nearly_the_same_could_be_it():
    assert named_elsewhere(truth=1, named=1).instead == {1: ()}
    assert named_elsewhere(truth=1, named=1, alike=0.9).instead == {1: (2,)}
