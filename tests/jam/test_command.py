"""`linktwin jam`: what it writes, and what it refuses."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.jam.run import jam
from backend.mechanism.jam_report import JamReport
from backend.mechanism.read import write_mechanism
from backend.mechanism.schema import schemas
from tests.jam import cases
from tests.mechanisms import effect, pendulum


def linktwin(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def drawing(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("jam") / "block.json"
    write_mechanism(cases.weak_drive(0.01), path)
    return path


def test_a_report_and_a_page_are_written_and_say_the_same(drawing, tmp_path):
    done = linktwin("jam", drawing, "--duration", "0.3", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    report = JamReport.model_validate_json((tmp_path / "jam.json").read_text())
    assert report.sentence in done.stdout
    page = (tmp_path / "jam.html").read_text()
    assert report.sentence in page
    for title in ("Creep ratio", "Lever of the drive", "Ways to move", "friction cones"):
        assert title in page
    assert 'class="cause"' in page


def test_json_alone_is_the_report(drawing, tmp_path):
    done = linktwin("jam", drawing, "--duration", "0.3", "--out", tmp_path, "--json")
    told = json.loads(done.stdout)
    assert told == json.loads((tmp_path / "jam.json").read_text())
    properties = json.loads(schemas()["jam.schema.json"])["properties"]
    assert set(told) == set(properties)
    assert len(told["creep_ratio"]) == len(told["time_s"]) == len(told["mobility"]) == len(told["singular_values"])


def test_every_experiment_of_a_study_is_asked(drawing, tmp_path):
    tracks = "time_s,marker,x_m,y_m,z_m,sigma_m\n" + "".join(f"{0.01 * k},tip,0,-0.2,0,0.0001\n" for k in range(31))
    (tmp_path / "still.csv").write_text(tracks)
    (tmp_path / "mechanism.json").write_text(drawing.read_text())
    release = {"time_s": 0.0, "at_rest": True}
    experiments = [
        {"id": "weak", "use": "fit", "tracks": "still.csv", "release": release},
        {
            "id": "strong",
            "use": "held_out",
            "tracks": "still.csv",
            "release": release,
            "overrides": {"drive": {"torque_n_m": 0.03}},
        },
    ]
    study = {"schema_version": "1.0", "mechanism": "mechanism.json", "experiments": experiments}
    (tmp_path / "study.json").write_text(json.dumps(study))
    done = linktwin("jam", tmp_path / "study.json", "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)["experiments"]
    assert {name: one["cause"] for name, one in told.items()} == {"weak": "insufficient_drive", "strong": "none"}
    assert (tmp_path / "out" / "weak" / "jam.html").is_file()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"duration_s": 0.0}, "duration is 0 s"),
        ({"step_s": -1e-3}, "step is -0.001 s"),
        ({"duration_s": 1e-4}, "choose them so that"),
        ({"duration_s": 1e5}, "1e+08 steps"),
    ],
)
def test_a_motion_without_steps_is_refused_in_a_sentence(changed, words):
    with pytest.raises(ValueError, match=words.replace("+", r"\+")):
        jam(cases.weak_drive(0.01), **{"duration_s": 1.0, **changed})


def test_a_path_that_begins_elsewhere_than_the_drawing_is_refused():
    led = pendulum(effects=[effect("hand", "prescribed_motion", ["pin"], q=0.5)])
    with pytest.raises(ValueError, match=r"'hand'.*begins at 0\.5 rad"):
        jam(led, 0.1)


def test_a_bad_file_is_refused_with_exit_code_2(tmp_path):
    (tmp_path / "broken.json").write_text("{")
    done = linktwin("jam", tmp_path / "broken.json")
    assert done.exit_code == 2
    assert "Traceback" not in done.output
