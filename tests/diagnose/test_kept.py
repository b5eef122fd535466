"""Ends of fits outlive the process that found them."""

import numpy as np
import pytest

from backend.diagnose.kept import Kept, name_of
from backend.mechanism.study import Experiment, Release, Study
from tests.mechanisms import fourbar


@pytest.fixture
def study():
    return Study(fourbar(), (Experiment("e1", "fit", Release(time_s=0.1)),))


def test_a_search_that_was_killed_finds_the_ends_of_its_fits(study, tmp_path):
    path, fit = tmp_path / "kept.jsonl", name_of("smooth|viscous_friction:j1", [1.0, 0.1, 0.2])
    Kept.of(path, study, frozenset(), resume=False).note(fit, np.array([1.0, 2.0]), "converged")
    with path.open("a") as file:
        file.write('{"fit": "cut o')  # by the kill
    again = Kept.of(path, study, frozenset(), resume=True)
    assert len(path.read_text().splitlines()) == 2  # the study's and the fit's: whole before the search goes on
    end, status = again.end_of(fit)
    np.testing.assert_array_equal(end, [1.0, 2.0])
    assert status == "converged"
    assert again.end_of(name_of("smooth|viscous_friction:j1", [0.5, 0.1, 0.2])) is None


def test_a_file_of_another_search_is_refused_with_the_remedy(study, tmp_path):
    path = tmp_path / "kept.jsonl"
    Kept.of(path, study, frozenset(), resume=False)
    with pytest.raises(ValueError, match="without --resume"):
        Kept.of(path, study, frozenset({"clearance"}), resume=True)
    with pytest.raises(ValueError, match="no diagnosis to resume"):
        Kept.of(tmp_path / "nothing.jsonl", study, frozenset(), resume=True)


def test_what_other_code_found_is_not_gone_on_with(study, tmp_path, monkeypatch):
    path = tmp_path / "kept.jsonl"
    monkeypatch.setattr("backend.fit.journal.source_digest", lambda: "as it was last month")
    Kept.of(path, study, frozenset(), resume=False)
    monkeypatch.undo()
    with pytest.raises(ValueError, match="linktwin itself has changed"):
        Kept.of(path, study, frozenset(), resume=True)


def test_a_finished_search_leaves_nothing_to_resume(study, tmp_path):
    kept = Kept.of(tmp_path / "kept.jsonl", study, frozenset(), resume=False)
    kept.remove()
    assert not list(tmp_path.iterdir())


def test_a_fit_asked_again_from_the_same_start_is_another_fit(study, tmp_path):
    fit = name_of("smooth|nothing", [1.0, 0.1])
    ends = {}
    for resume in (False, True):
        kept = Kept.of(tmp_path / "kept.jsonl", study, frozenset(), resume=resume)
        for noise in (1.0, 2.0):  # what is known of it between the two
            key = kept.asked(fit)
            assert (kept.end_of(key) is not None) == resume
            kept.note(key, np.array([noise]), "converged")
            ends.setdefault(resume, []).append(kept.end_of(key)[0][0])
    assert ends[True] == ends[False] == [1.0, 2.0]
