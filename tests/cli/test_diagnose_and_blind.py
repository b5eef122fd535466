"""`linktwin diagnose` and `linktwin blind`: what they refuse, and how the check is told."""

import json
import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.diagnose.answer import answer
from backend.mechanism.gap_report import GapReport
from backend.mechanism.read import parse
from tests.mechanisms import document, pendulum

STUDY = Path(__file__).resolve().parents[2] / "pyproject.toml"  # any file that is no study


def linktwin(*arguments: str | Path):
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("diagnose", "nowhere.json"), "nowhere.json"),
        (("diagnose", STUDY, "--tolerance", "-1"), "--tolerance"),
        (("diagnose", STUDY, "--without", "coulomb_frction"), "coulomb_frction"),
        (("diagnose", STUDY), "pyproject.toml"),
        (("blind", "--seed", "3"), "--n"),
        (("blind", "--n", "0", "--seed", "3"), "--n"),
        (("blind", "--n", "5", "--seed", "1000000"), "--test"),
        (("blind", "--n", "5", "--seed", "3", "--test"), "1000000"),
        (("blind", "--n", "5", "--seed", "3", "--workers", "0"), "--workers"),
    ],
    ids=["no study", "negative tolerance", "misspelt kind", "not a study", "how many", "none at all",
         "a test seed unasked", "a development seed for a test", "no workers"],
)  # fmt: skip
def test_bad_arguments_end_with_exit_code_2_and_say_which(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = linktwin(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_misspelt_kind_is_answered_with_those_that_exist():
    assert "coulomb_friction" in linktwin("diagnose", STUDY, "--without", "coulomb_frction").stderr


@dataclass
class Told:
    report: GapReport


@pytest.fixture
def drawn_heavy(tmp_path) -> Path:
    """A study whose gravity is a thousand times too large."""
    heavy = document(pendulum()) | {"gravity_m_per_s2": [0.0, -9806.65, 0.0]}
    (tmp_path / "mechanism.json").write_text(json.dumps(heavy))
    (tmp_path / "q.csv").write_text("time_s,joint,q\n" + "".join(f"{t / 100},pin,0.1\n" for t in range(50)))
    shot = {"id": "e1", "joint_positions": "q.csv", "release": {"time_s": 0.2}}
    study = tmp_path / "study.json"
    study.write_text(json.dumps({"schema_version": "1.0", "mechanism": "mechanism.json", "experiments": [shot]}))
    return study


@pytest.fixture
def searching(monkeypatch, drawn_heavy) -> list[Callable[..., None]]:
    """What a diagnosis does before it finds nothing, told its options; no picture is drawn."""
    asked: list[Callable[..., None]] = []

    def diagnosed(study, **options):
        for work in asked:
            work(**options)
        return Told(parse(GapReport, {"schema_version": "1.0", **never(drawn_heavy, frozenset(), 40.0)}, "gap.json"))

    monkeypatch.setattr("backend.diagnose.run.diagnose_study", diagnosed)
    for name in ("gap_summary.gap_evidence", "linked.gap_pictures", "pictures.write_pictures"):
        monkeypatch.setattr(f"backend.report.{name}", lambda *told: None)
    monkeypatch.setattr("backend.report.gap_page.write_gap_page", lambda evidence, path: path)
    return asked


def test_a_diagnosis_says_what_stands_out_in_its_study(tmp_path, drawn_heavy, searching):
    done = linktwin("diagnose", drawn_heavy, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    (said,) = json.loads((tmp_path / "out" / "gap.json").read_text())["warnings"]
    assert "gravity_m_per_s2 is 9807 m/s²" in said


@pytest.mark.parametrize(("minutes", "ends"), [("0.0005", True), ("0", False)])
def test_a_search_whose_time_is_up_is_answered_with_what_it_found_and_can_go_on(
    tmp_path, drawn_heavy, searching, minutes, ends
):
    found = []

    def search(cancelled, progress, kept, **options):
        kept.note("a fit", np.zeros(2), "converged")
        until = time.monotonic() + 0.1
        while time.monotonic() < until and not cancelled():
            progress(0.1, "trying")
        found.append(cancelled())

    searching.append(search)
    done = linktwin("diagnose", drawn_heavy, "--minutes", minutes, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    assert found == [ends]
    said = json.loads((tmp_path / "out" / "gap.json").read_text())["warnings"]
    assert any("ended after 0.0005 minutes" in words and "--resume" in words for words in said) == ends
    assert (tmp_path / "out" / "diagnosis.kept.jsonl").exists() == ends


def test_whoever_diagnoses_many_can_be_sent_to_other_processes():
    sent = pickle.loads(pickle.dumps(partial(answer, minutes=40.0)))
    assert (sent.func, sent.keywords) == (answer, {"minutes": 40.0})


@pytest.mark.parametrize(("minutes", "ends"), [(0.0005, True), (0.0, False)])
def test_one_of_many_diagnoses_ends_as_any_other(drawn_heavy, searching, minutes, ends):
    found = list[bool]()

    def search(cancelled, **options):
        time.sleep(0.05)
        found.append(cancelled())

    searching.append(search)
    assert answer(drawn_heavy, minutes=minutes)["verdict"] == "none"
    assert found == [ends]


def never(study: Path, without: frozenset[str], minutes: float) -> dict:
    """An answer that finds no gap anywhere."""
    assert study.is_file()
    assert minutes == 40.0
    return {
        "verdict": "none", "sentence": "", "where": {}, "causes": [], "probability_none": 1.0,
        "probability_unknown": 0.0, "p_value": 1.0, "shrink": {}, "detectable": [],
    }  # fmt: skip


def test_blind_tells_the_seal_the_scores_and_both_baselines(tmp_path, monkeypatch):
    monkeypatch.setattr("backend.diagnose.answer.answer", never)
    arguments = ("blind", "--n", "1", "--seed", "7", "--out", tmp_path)
    done = linktwin(*arguments)
    assert done.exit_code == 0, done.stderr
    sealed = json.loads((tmp_path / "seal.json").read_text())
    assert sealed["sha256"] in done.stdout
    for column in ("cause first", "most frequent", "derivatives"):
        assert column in done.stdout
    again = linktwin(*arguments, "--json")  # answers that are there already are kept
    assert json.loads(again.stdout) == json.loads((tmp_path / "scores.json").read_text())


def test_a_check_that_was_stopped_says_how_to_go_on(tmp_path, monkeypatch):
    def stopped(*given, **options):
        from backend.blind.withheld.run import Cancelled

        raise Cancelled("stopped with 2 of 5 answers; run again to go on")

    monkeypatch.setattr("backend.blind.withheld.run.run_blind", stopped)
    done = linktwin("blind", "--n", "5", "--seed", "7", "--out", tmp_path)
    assert done.exit_code == 1
    assert "run again to go on" in done.stderr
