"""The scores that the documentation shows are those of the sealed answers that the project keeps."""

import re
from pathlib import Path

import pytest

from backend.blind.withheld.score import Scores
from benchmarks.pooled_blind import pooled

HERE = Path(__file__).resolve().parents[2]
ROW = re.compile(r"^\| (?P<name>[^|]+) \| (?P<cases>\d+) \| (?P<value>[\d.]+) \|", re.MULTILINE)


@pytest.fixture(scope="module")
def counted() -> Scores:
    """Of all kept seeds together; labels that were touched since they were sealed are refused."""
    return pooled(sorted((HERE / "benchmarks" / "sealed").iterdir()))


def test_the_table_of_the_kept_seeds_is_what_their_answers_score(counted):
    text = (HERE / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = text[text.index("`python -m benchmarks.pooled_blind benchmarks/sealed/*`") :]
    table = table[table.index("| score |") :].split("\n\n")[0]
    shown = {m["name"]: (int(m["cases"]), float(m["value"])) for m in ROW.finditer(table)}
    found = {n: (s.cases, round(s.value, 3)) for n, s in counted.scores.items() if s.value is not None}
    assert {n: found[n] for n in shown} == shown
    assert {"cause first", "Brier", "false alarms", "pair: both", "no answer"} <= set(shown)


def test_every_kept_seed_is_a_test_seed_with_all_its_answers(counted):
    folders = list((HERE / "benchmarks" / "sealed").iterdir())
    assert counted.cases == sum(len((f / "answers.jsonl").read_text().splitlines()) for f in folders)
    assert all(1_000_000 <= int(f.name) < 2_000_000 for f in folders)
