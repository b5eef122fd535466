"""The scores that the documentation shows are those of the sealed answers that the project keeps."""

import re
from pathlib import Path

import pytest

from backend.blind.withheld.score import Scores
from benchmarks.pooled_blind import newest, pooled

HERE = Path(__file__).resolve().parents[2]
FOLDERS = sorted((HERE / "benchmarks" / "sealed").iterdir())
ROW = re.compile(r"^\| (?P<name>[^|]+) \| (?P<cases>\d+) \| (?P<value>[\d.]+) \|", re.MULTILINE)


@pytest.fixture(scope="module")
def counted() -> Scores:
    """Of all kept seeds together; labels that were touched since they were sealed are refused."""
    return pooled(FOLDERS)


def test_the_table_of_the_newest_seeds_is_what_their_answers_score():
    text = (HERE / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = text[text.index("`python -m benchmarks.pooled_blind benchmarks/sealed/* --newest 300`") :]
    table = table[table.index("| score |") :].split("\n\n")[0]
    shown = {m["name"]: (int(m["cases"]), float(m["value"])) for m in ROW.finditer(table)}
    last = pooled(newest(FOLDERS, 300))
    found = {n: (s.cases, round(s.value, 3)) for n, s in last.scores.items() if s.value is not None}
    assert {n: found[n] for n in shown} == shown
    assert {"cause first", "Brier", "false alarms", "pair: both", "no answer"} <= set(shown)


def test_every_kept_seed_is_a_test_seed_with_all_its_answers(counted):
    assert counted.cases == sum(len((f / "answers.jsonl").read_text().splitlines()) for f in FOLDERS)
    assert all(1_000_000 <= int(f.name) < 2_000_000 for f in FOLDERS)


def test_the_newest_seeds_are_as_many_of_the_last_as_hold_so_many_studies(tmp_path):
    made = [tmp_path / str(seed) for seed in (1000003, 1000001, 1000002)]
    for folder, cases in zip(made, (10, 20, 30), strict=True):
        folder.mkdir()
        (folder / "seal.json").write_text(f'{{"seed": {folder.name}, "cases": {cases}}}')
    last = lambda studies: [int(f.name) for f in newest(made, studies)]  # noqa: E731
    assert last(10) == [1000003]
    assert last(11) == last(40) == [1000002, 1000003]
    assert last(41) == last(1000) == [1000001, 1000002, 1000003]
