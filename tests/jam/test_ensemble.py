"""Tolerances to risk, against a probability and shares known from theory."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.jam.ensemble import ensemble
from backend.jam.kept import FILE
from backend.mechanism.ensemble_report import EnsembleReport
from backend.mechanism.read import write_mechanism
from backend.report.ensemble_summary import ensemble_text
from tests.jam.weak import DRIVE, DRY, RUN, weak_bar

SPECS = [f"{DRIVE}=uniform(0.005,0.015)", f"{DRY}=uniform(0.005,0.015)"]


@pytest.fixture(scope="module")
def found():
    told = []
    result = ensemble(weak_bar(), SPECS, 1100, **RUN, seed=1, progress=lambda done, total: told.append((done, total)))
    assert told == [(min(64 * k, 1100), 1100) for k in range(1, 19)]
    return result


def test_a_drive_and_a_friction_of_one_distribution_jam_every_other_time(found):
    report = found.report
    low, high = report.probability_ci95
    assert low < 0.5 < high
    assert high - low < 0.081  # 588 samples: 2 x 1.96 x sqrt(0.25 / 588)
    assert report.lost == 0
    assert report.samples == 1100
    assert report.independent == 1100 - 2 * 256


def test_each_sample_jams_by_its_own_numbers(found):
    drive, dry = found.design.values.T
    clear = abs(drive - dry) > 0.02 * dry  # nearer, it creeps off too slowly to be told within 50 ms
    assert clear.mean() > 0.95
    assert (found.verdicts.jammed == (drive < dry))[clear].all()


def test_both_tolerances_share_the_blame_alike(found):
    """A third alone and two thirds in all, as in test_distribution."""
    for one in found.report.parameters:
        assert one.first_order.ci95[0] < 1 / 3 < one.first_order.ci95[1]
        assert one.total.ci95[0] < 2 / 3 < one.total.ci95[1]


def test_friction_drawn_everywhere_is_what_varies_at_one_joint():
    drawn = weak_bar(dry_n_m=1.0)
    every = drawn.model_copy(update={"effects": tuple(
        e.model_copy(update={"on": "all"}) if e.id == "dry" else e for e in drawn.effects
    )})  # fmt: skip
    assert ensemble(every, [f"{DRY}=uniform(0.001,0.002)"], 4, **RUN).report.jammed == 0


def test_the_same_seed_draws_the_same_samples(found):
    again = ensemble(weak_bar(), SPECS, 64, **RUN, seed=1).report
    same = ensemble(weak_bar(), SPECS, 64, **RUN, seed=1).report
    other = ensemble(weak_bar(), SPECS, 64, **RUN, seed=2).report
    assert again.shown == same.shown
    assert again.shown != other.shown
    assert again.throughput.samples_per_s is None  # one chunk: nothing is known beside its compile time


def test_an_ensemble_that_was_cut_off_goes_on_and_ends_as_one_left_alone(found, tmp_path):
    class Killed(Exception):
        pass

    def kill(done: int, total: int) -> None:
        if done >= 640:
            raise Killed

    kept = tmp_path / FILE
    with pytest.raises(Killed):
        ensemble(weak_bar(), SPECS, 1100, **RUN, seed=1, checkpoint=kept, progress=kill)
    lines = kept.read_text().splitlines()
    assert len(lines) == 1 + 10
    kept.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:40])  # the last one was cut off as it was written
    for other, words in (
        ({"seed": 2}, "belongs to another ensemble"),
        ({"checkpoint": tmp_path / "none"}, "does not exist"),
    ):
        with pytest.raises(ValueError, match=words):
            ensemble(weak_bar(), SPECS, 1100, **{**RUN, "seed": 1, "checkpoint": kept, "resume": True, **other})
    whole, told = found.report.model_dump(exclude={"throughput"}), []
    for left in (18 - 9, 0):  # none where it was killed once more, between the last chunk and the report
        again = ensemble(
            weak_bar(), SPECS, 1100, **RUN, seed=1, checkpoint=kept, resume=True,
            progress=lambda done, _: told.append(done),
        )  # fmt: skip
        assert told[0] == 10 * 64
        assert again.report.throughput.chunks == left
        assert again.report.model_dump(exclude={"throughput"}) == whole
        for name in ("jammed", "rests", "onset_s", "lost"):
            np.testing.assert_array_equal(getattr(again.verdicts, name), getattr(found.verdicts, name))
    assert "every chunk was done before" in ensemble_text(again.report)


def test_throughput_leaves_the_first_chunk_out(found):
    speed = found.report.throughput
    assert speed.chunks == 18
    assert speed.samples_per_s == pytest.approx((1100 - 64) / (speed.wall_s - speed.first_chunk_s))


@pytest.mark.parametrize(
    ("asked", "words"), [({"samples": 0}, "0 samples were asked for"), ({"duration_s": 0.0}, "duration is 0 s")]
)
def test_what_cannot_run_is_refused(asked, words):
    with pytest.raises(ValueError, match=words):
        ensemble(weak_bar(), SPECS, **{"samples": 10, **RUN, **asked})


def test_the_command_writes_report_table_and_page(found, tmp_path):
    write_mechanism(weak_bar(), tmp_path / "weak.json")
    vary = [word for spec in SPECS for word in ("--vary", spec)]
    arguments = ["jam", tmp_path / "weak.json", "--duration", 0.05, "--samples", 128, *vary, "--out", tmp_path / "out"]
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    report = EnsembleReport.model_validate_json((tmp_path / "out" / "jam_ensemble.json").read_text())
    assert report.sentence in done.stdout
    assert "samples/s" in done.stdout
    page = (tmp_path / "out" / "jam_ensemble.html").read_text()
    for words in (report.sentence, "What decides whether it jams", "Where it jams", "Share that jams along"):
        assert words in page
    rows = (tmp_path / "out" / "jam_ensemble.csv").read_text().splitlines()
    assert rows[0] == f"{DRIVE},{DRY},independent,jammed,lost,onset_s"
    assert len(rows) == 1 + 128
    assert not (tmp_path / "out" / FILE).exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--samples", "10"], "nothing is varied"),
        (["--vary", SPECS[0]], "add --samples"),
        (["--samples", "10", "--vary", f"{DRY}=normal(1)"], "--vary"),
    ],
)
def test_half_a_question_is_refused_with_exit_code_2(options, words, tmp_path):
    write_mechanism(weak_bar(), tmp_path / "weak.json")
    done = CliRunner().invoke(app, ["jam", str(tmp_path / "weak.json"), *options])
    assert done.exit_code == 2
    assert words in done.output
    assert json.loads((tmp_path / "weak.json").read_text())["name"] == "weak bar"


def test_the_middle_of_what_varies_is_taken_out_of_the_ideal_copy():
    """A play that is drawn as 0 is play where it varies."""
    from backend.jam.chunks import _model
    from backend.jam.knobs import plays

    document = json.dumps(weak_bar().model_dump(mode="json", exclude_none=True))
    model, columns, addresses = _model(document, ("clearance:pin.radial_m=uniform(0,2e-4)",))
    assert np.array_equal(columns, [0])
    assert plays(model) == addresses
