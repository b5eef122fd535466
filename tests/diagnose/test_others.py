"""Studies that others made with simulators of theirs, and whose truth they held until the answers were in."""

import json

import pytest

from backend.mechanism.kinds import effect_kinds
from backend.mechanism.read import read_study
from benchmarks.judged import FOLDER, truth

NAMES = sorted(folder.name for folder in FOLDER.iterdir())


@pytest.mark.parametrize("name", NAMES)
def test_a_study_is_whole_and_its_truth_stands_beside_it(name):
    study = read_study(FOLDER / name / "study.json")
    assert study.fit
    assert study.held_out or len(study.fit) == 1
    told, drawn = json.loads((FOLDER / name / "truth.json").read_text(encoding="utf-8")), study.mechanism
    parts = {p.id for p in (*drawn.joints, *drawn.bodies, *drawn.markers, *drawn.effects)} | {"camera", "world"}
    for effect in told["effects"] or []:
        assert effect["kind"] in effect_kinds()
        assert effect["on"] in parts
        assert effect["size"] in truth(FOLDER / name)


@pytest.mark.nightly
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", ["u01", "u02", "u03", "u04", "u05", "v03", "v04", "w04", "w05", "w06"])
def test_what_was_amiss_is_named_first_where_it_is(name):
    from backend.diagnose.run import diagnose_study

    told = json.loads((FOLDER / name / "truth.json").read_text(encoding="utf-8"))["effects"]
    report = diagnose_study(read_study(FOLDER / name / "study.json")).report
    named = report.causes[0].effects if report.causes else ()
    assert {(e.kind, tuple(e.on)) for e in named} == {(e["kind"], (e["on"],)) for e in told}
