"""The check itself: sealed before it is answered, scored as the answers deserve, resumed where it was left."""

import json

import numpy as np
import pytest

from backend.blind.withheld import case
from backend.blind.withheld.interval import bootstrap, wilson
from backend.blind.withheld.mechanisms import pendulum
from backend.blind.withheld.run import Cancelled, Limits, check_seed, run_blind, scored
from backend.blind.withheld.score import scores
from backend.blind.withheld.seal import commitment
from backend.blind.withheld.verdict import judged, unanswered
from backend.mechanism.read import read_study


def effect(kind, on, place, **parameters):
    return {"kind": kind, "on": [on], "places": [place], "parameters": parameters}


FRICTION = effect("viscous_friction", "j1", "joint:j1", damping_n_m_s_per_rad=0.01)
DRAG = effect("linear_drag", "arm", "body:arm", n_s_per_m=0.2)
MASS = effect("mass_error", "arm", "body:arm", relative=0.1)


def label(stratum, *effects, size=">100", alike=()):
    classes = [] if stratum == "none" else [[e, *alike] for e in effects]
    classes = [list(alike)] if stratum in ("never", "left_out") else classes
    seen = size if effects else "none"
    return {"stratum": stratum, "effects": list(effects), "classes": classes, "bin": seen, "without": []}


LABELS = [
    label("none"),
    label("single", FRICTION, alike=[DRAG]),
    label("single", MASS),
    label("single", MASS, size="9-100"),
    label("pair", FRICTION, MASS),
    label("left_out", MASS),
    label("never", effect("cogging", "j1", "joint:j1")),
]


def gap(verdict, *causes, none=0.0, unknown=0.0, at=None, explained=None):
    """causes: (probability, effect, ...)."""
    found = [
        {"probability": p, "effects": [{"kind": e["kind"], "on": e["on"], "parameters": values(e)} for e in effects]}
        for p, *effects in causes
    ]
    return {
        "verdict": verdict,
        "causes": found,
        "probability_none": none,
        "probability_unknown": unknown,
        "where": {"locations": [{"at": at, "probability": 1.0}] if at else []},
        "shrink": {"held_out": {"explained_fraction": explained}},
    }


def values(effect):
    """Off by one standard deviation: inside a 90% interval."""
    return {name: {"value": value + 0.001, "sd": 0.001} for name, value in effect["parameters"].items()}


def oracle(truth):
    effects, stratum = truth["effects"], truth["stratum"]
    if stratum == "none":
        return gap("none", none=1.0)
    at = effects[0]["places"][0]
    if stratum in ("never", "left_out"):
        return gap("unknown", unknown=1.0, at=at)
    return gap("identified", (1.0, *effects), at=at, explained=1.0)


def score(answers, labels=LABELS):
    return {name: s.value for name, s in scores([judged(*pair) for pair in zip(labels, answers, strict=True)]).items()}


def test_an_oracle_scores_everything():
    found = score([oracle(truth) for truth in LABELS])
    assert found.pop("too small to see: none") is None
    for name in ("false alarms", "outside: sure and wrong", "Brier", "Brier, all true names", "no answer"):
        assert found.pop(name) == 0.0
    assert set(found.values()) == {1.0}


def test_one_who_always_says_none_is_never_alarmed_and_never_right():
    found = score([gap("none", none=1.0) for _ in LABELS])
    assert found["false alarms"] == found["outside: sure and wrong"] == 0.0
    assert found["left out: not sure and wrong"] == 1.0
    names = (
        "cause first",
        "cause among two",
        "place first",
        "outside: unknown",
        "pair: both",
        "pair: one and no wrong",
    )
    for name in names:
        assert found[name] == 0.0
    assert found["Brier"] == pytest.approx(5 / 6)  # sure each time, right once; the faint case does not count
    assert found["90% intervals hold"] is None


def test_a_diagnosis_that_fails_is_wrong_wherever_an_answer_was_asked_for():
    found = score([unanswered("the motion was lost") for _ in LABELS])
    assert found["no answer"] == found["false alarms"] == 1.0
    for name in ("cause first", "cause among two", "place first", "outside: unknown", "pair: both"):
        assert found[name] == 0.0


def test_a_sure_and_wrong_answer_costs_what_it_should():
    found = score([gap("identified", (0.95, DRAG), unknown=0.05, at="body:arm") for _ in LABELS])
    assert found["false alarms"] == found["outside: sure and wrong"] == 1.0
    assert found["left out: not sure and wrong"] == 0.0
    assert found["cause first"] == 0.5  # the data cannot tell drag from the first one's friction
    assert found["place first"] == 1.0  # the second one's cause, though another, lies on the same body
    assert found["Brier"] == pytest.approx((5 * 0.95**2 + 0.05**2) / 6)


def test_belief_shared_among_true_names_counts_whole_where_all_of_them_do():
    shared = score([gap("ambiguous", (0.5, DRAG), (0.5, FRICTION))], labels=LABELS[1:2])
    assert shared["Brier"] == pytest.approx(0.25)
    assert shared["Brier, all true names"] == 0.0


def test_half_of_a_pair_is_no_wrong_but_not_both():
    answer = gap("identified", (0.8, FRICTION), (0.2, FRICTION, MASS))
    facts = judged(LABELS[4], answer)
    assert facts["part"]
    assert not facts["both"]
    assert not facts["top1"]
    assert facts["top2"]
    assert facts["right"] == pytest.approx(0.2)


def test_an_interval_that_misses_counts_as_a_miss():
    answer = gap("identified", (1.0, MASS))
    answer["causes"][0]["effects"][0]["parameters"]["relative"] = {"value": 0.12, "sd": 0.01}
    assert judged(LABELS[2], answer)["covered"] == [False]  # two standard deviations off, 1.64 allowed


def test_the_reported_set_ends_at_a_twentieth_of_the_likeliest():
    near, far = (gap("ambiguous", (0.9, FRICTION), (p, MASS)) for p in (0.05, 0.04))
    assert judged(LABELS[3], near)["reported"]
    assert not judged(LABELS[3], far)["reported"]


def test_wilson_and_the_bootstrap_hold_their_textbook_values():
    assert wilson(9, 10) == pytest.approx((0.5958, 0.9821), abs=1e-4)  # Brown, Cai and DasGupta (2001)
    low, high = bootstrap(np.random.default_rng(1).normal(size=400), np.mean)
    assert high - low == pytest.approx(2 * 1.96 / 20, rel=0.15)


def test_development_and_test_seeds_do_not_meet():
    check_seed(3, test=False)
    check_seed(1_000_003, test=True)
    with pytest.raises(ValueError, match="test seeds need"):
        check_seed(1_000_003, test=False)
    with pytest.raises(ValueError, match="outside 1000000"):
        check_seed(3, test=True)


def test_the_hash_covers_label_salt_and_version():
    changed = [*LABELS[:-1], {**LABELS[-1], "bin": "<9"}]
    sealed = [(LABELS, "salt", "1"), (changed, "salt", "1"), (LABELS, "pepper", "1"), (LABELS, "salt", "2")]
    assert len({commitment(*one) for one in sealed}) == 4


@pytest.fixture
def quick(monkeypatch):
    """Pendulums only, and three experiments each."""
    monkeypatch.setattr(case, "FIT", 2)
    monkeypatch.setattr(case, "HELD_OUT", 1)
    monkeypatch.setattr(case, "DEVELOPED", {"pendulum": pendulum})
    monkeypatch.setattr(case, "SHARE_OF_PEERS", 0.0)


def test_a_check_is_sealed_first_resumed_and_scored(quick, tmp_path):
    asked = []

    def diagnose(study, without):
        assert (tmp_path / "seal.json").exists()
        read = read_study(study)
        assert (len(read.fit), len(read.held_out)) in ((2, 1), (1, 0))
        assert sorted(f.name for f in study.parent.iterdir()) == sorted(
            ["study.json", "mechanism.json", *(f"{e.id}.csv" for e in read.experiments)]
        )
        asked.append((study.parent.name, without))
        return gap("none", none=1.0)

    told = []
    with pytest.raises(Cancelled, match="1 of 4 cases drawn"):
        run_blind(7, 4, tmp_path, diagnose, cancelled=lambda: True)
    first = (tmp_path / "studies" / "0000" / "study.json").stat().st_mtime_ns
    with pytest.raises(Cancelled, match="1 of 4 answers"):
        run_blind(7, 4, tmp_path, diagnose, cancelled=lambda: len(asked) == 1)
    result = run_blind(7, 4, tmp_path, diagnose, progress=lambda share, words: told.append(share))
    assert (tmp_path / "studies" / "0000" / "study.json").stat().st_mtime_ns == first  # nor drawn twice
    assert [name for name, _ in asked] == [f"{i:04d}" for i in range(4)]  # none asked twice
    labels = json.loads((tmp_path / "labels.json").read_text())["labels"]
    assert [without for _, without in asked] == [frozenset(lb["without"]) for lb in labels]
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert result.cases == 4
    assert set(result.baselines) == {"most frequent", "derivatives"}
    assert result.scores["false alarms"].value in (0.0, None)
    assert "most frequent" in result.table()
    assert json.loads((tmp_path / "scores.json").read_text())["sha256"] == result.sha256

    labels[0]["bin"] = "changed"
    kept = json.loads((tmp_path / "labels.json").read_text())
    (tmp_path / "labels.json").write_text(json.dumps({**kept, "labels": labels}))
    with pytest.raises(ValueError, match="changed after sealing"):
        scored(tmp_path)


def test_a_diagnosis_that_fails_does_not_take_the_others_with_it(quick, tmp_path):
    def diagnose(study, without):
        if study.parent.name == "0001":
            raise ValueError("the motion was lost")
        return gap("none", none=1.0)

    result = run_blind(7, 3, tmp_path, diagnose)
    assert result.cases == 3
    assert result.scores["no answer"].value == pytest.approx(1 / 3)
    told = [json.loads(line)["gap"] for line in (tmp_path / "answers.jsonl").read_text().splitlines()]
    assert "the motion was lost" in told[1]["sentence"]


def test_a_folder_of_another_seed_is_refused(quick, tmp_path):
    run_blind(7, 1, tmp_path, lambda study, without: gap("none", none=1.0))
    with pytest.raises(ValueError, match="holds seed 7"):
        run_blind(8, 1, tmp_path, lambda study, without: gap("none", none=1.0))


def test_a_case_is_the_same_every_time_it_is_drawn(quick, monkeypatch):
    monkeypatch.setattr(case, "stratum_of", lambda seed, index: "none")
    one, again, other = (case.draw_case(seed, 3) for seed in (5, 5, 6))
    assert one.label == again.label
    np.testing.assert_array_equal(one.places, again.places)
    assert other.label != one.label


def test_mechanisms_kept_for_tests_are_drawn_only_there(quick, monkeypatch):
    drawn = []

    def kept(rng):
        drawn.append("kept")
        return pendulum(rng)

    monkeypatch.setattr(case, "UNSEEN", {"kept": kept})
    monkeypatch.setattr(case, "stratum_of", lambda seed, index: "none")  # the quickest
    for index in range(4):
        case.draw_case(11, index)
    assert not drawn
    for index in range(8):
        case.draw_case(11, index, unseen=True)
    assert drawn


def test_one_mechanism_alone_is_drawn_where_it_is_asked_for(tmp_path):
    run_blind(7, 4, tmp_path, lambda study, without: gap("none", none=1.0), limits=Limits(("pendulum",)))
    assert {label["family"] for label in json.loads((tmp_path / "labels.json").read_text())["labels"]} == {"pendulum"}
    with pytest.raises(ValueError, match=r"4 cases of pendulum .* not seed 7 with 4 of all mechanisms"):
        run_blind(7, 4, tmp_path, lambda study, without: gap("none", none=1.0))


def test_what_a_check_goes_without_is_neither_drawn_nor_known(quick, tmp_path):
    kept = {"viscous_friction", "camera_scale", "marker_offset", "tracker_drift"}
    less, asked = tuple(name for name in case.KNOWN if name not in kept), []

    def diagnose(study, without):
        asked.append(without)
        return gap("none", none=1.0)

    run_blind(7, 8, tmp_path, diagnose, limits=Limits(("pendulum",), less))
    labels = json.loads((tmp_path / "labels.json").read_text())["labels"]
    drawn = {e["kind"] for label in labels if label["stratum"] != "never" for e in label["effects"]}
    assert drawn
    assert drawn <= kept
    assert all(without.issuperset(less) for without in asked)
    names = {e["kind"] for label in labels for group in label["classes"] for e in group}
    assert not names & set(less)
    with pytest.raises(ValueError, match=r"8 cases of pendulum without air_drag, .* with 8 of pendulum by"):
        run_blind(7, 8, tmp_path, diagnose, limits=Limits(("pendulum",)))


def test_a_mechanism_kept_for_tests_is_not_drawn_in_development(tmp_path):
    with pytest.raises(ValueError, match="no mechanism 'six-bar' to draw; choose among pendulum"):
        run_blind(7, 1, tmp_path, lambda study, without: gap("none", none=1.0), limits=Limits(("six-bar",)))
