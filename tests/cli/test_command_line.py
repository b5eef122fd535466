"""The command line as a person meets it: help that is quick, answers that are clean, errors that are sentences."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from backend.cli import app
from backend.commands import terminal
from backend.commands.terminal import folder_for, progress, stoppable
from backend.mechanism import found_contacts
from backend.mechanism.read import read_mechanism

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("jax", "cadquery", "cv2", "av", "pandas", "matplotlib", "fastapi")


def linktwin(*arguments: str | Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-c", "from backend.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)


def imported_by(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(*(m for m in {HEAVY} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


@pytest.fixture
def drawing(tmp_path) -> Path:
    """A bar on a pin, released level."""
    across = [0.7071067811865476, 0.7071067811865476, 0, 0]
    frame = {"position_m": [0, 0, 0], "quaternion_wxyz": across}
    pose = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
    inertia = {"xx": 1e-6, "yy": 1e-4, "zz": 1e-4, "xy": 0, "xz": 0, "yz": 0}
    inertial = {"mass_kg": 0.05, "center_of_mass_m": [0.1, 0, 0], "inertia_kg_m2": inertia}
    pin = {"id": "pin", "type": "revolute", "body_a": "ground", "body_b": "bar", "frame_a": frame, "frame_b": frame}
    bodies = [{"id": "ground", "fixed": True, "pose": pose}, {"id": "bar", "pose": pose, "inertial": inertial}]
    path = tmp_path / "mechanism.json"
    path.write_text(json.dumps({"schema_version": "1.0", "name": "bar", "bodies": bodies, "joints": [pin]}))
    return path


def test_help_is_quick_and_loads_nothing_heavy():
    linktwin("--help")  # the first start of a fresh checkout compiles
    began = time.perf_counter()
    done = linktwin("--help")
    assert time.perf_counter() - began < 1.5  # s; 0.15 on an idle core
    assert done.returncode == 0
    filming = ("kit", "calibrate", "track", "convert")
    for command in ("export", "check", "simulate", *filming, "fit", "diagnose", "twin", "jam", "blind"):
        assert command in done.stdout
    assert (
        imported_by(
            "from typer.testing import CliRunner; from backend.cli import app; CliRunner().invoke(app, ['--help'])"
        )
        == set()
    )


def test_reading_a_drawing_loads_no_solver_no_cad_and_no_vision(drawing):
    code = f"from backend.cli import app\ntry: app(['check', {str(drawing)!r}])\nexcept SystemExit: pass"
    assert imported_by(code) & {"jax", "cadquery", "cv2", "av", "fastapi"} == set()


def test_check_tells_people_and_programs_the_same(drawing):
    said, told = linktwin("check", drawing), linktwin("check", drawing, "--json")
    assert said.returncode == told.returncode == 0
    report = json.loads(told.stdout)
    assert report["ok"] is True
    assert report["mobility"]["by_rank"] == 1
    assert "mobility  1 by rank" in said.stdout


def test_check_keeps_its_report_where_it_is_told(drawing, tmp_path):
    linktwin("check", drawing, "--out", tmp_path / "kept")
    assert json.loads((tmp_path / "kept" / "check.json").read_text())["ok"] is True


def test_a_bad_drawing_is_refused_in_a_sentence_with_exit_code_2(drawing):
    text = drawing.read_text().replace('"mass_kg": 0.05', '"mass_kg": -0.05')
    drawing.write_text(text)
    done = linktwin("check", drawing)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "bar" in done.stderr
    assert "-0.05" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_reader_that_has_read_enough_ends_the_command_without_a_word(drawing):
    command = [sys.executable, "-c", "from backend.cli import main; main()", "check", str(drawing)]
    pipe = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert pipe.stdout is not None
    pipe.stdout.close()  # before anything is said, as `| head -0` does
    _, told = pipe.communicate(timeout=120)
    assert told == ""
    assert pipe.returncode == terminal.UNHEARD


def test_a_name_is_no_path_out_of_the_outputfolder_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("four/bar", "../../up", "/root", "", ".."):
        assert folder_for(None, name).resolve().parent == tmp_path / "out"
    assert folder_for(None, "Scissor 10").name == "Scissor_10"


def test_a_folder_that_cannot_be_written_is_refused_in_a_sentence(drawing):
    done = linktwin("check", drawing, "--out", drawing / "inside a file")
    assert done.returncode == 2
    assert str(drawing) in done.stderr
    assert "--out" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "nowhere.json"),
        ("dance",),
        ("simulate",),
        ("export", "pyproject.toml", "--set", "cells"),
        ("export", "samples/pendulum/design.py", "--propose", "--upload", "http://127.0.0.1:1"),
        ("fit", "pyproject.toml"),
    ],
    ids=[
        "no such file",
        "no such command",
        "no mechanism",
        "a setting without a value",
        "two that exclude each other",
        "nothing to fit",
    ],
)
def test_bad_arguments_end_with_exit_code_2_and_say_which(arguments):
    done = linktwin(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip()
    assert "Traceback" not in done.stderr


def test_a_folder_that_cannot_be_written_is_not_blamed_on_the_script(tmp_path):
    (tmp_path / "taken").write_text("")
    done = linktwin("export", "samples/pendulum/design.py", "--out", tmp_path / "taken" / "inside")
    assert done.returncode == 2
    assert "taken" in done.stderr
    assert "correct the script" not in done.stderr
    assert "Traceback" not in done.stderr


def test_an_exported_script_that_prints_leaves_the_report_clean(tmp_path):
    script = tmp_path / "design.py"
    design = (ROOT / "samples" / "pendulum" / "design.py").read_text(encoding="utf-8")
    script.write_text(design + "\nprint('hello from the script')\n", encoding="utf-8")
    done = linktwin("export", script, "--out", tmp_path / "drawn", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["ok"] is True
    assert Path(report["mechanism"]).is_file()
    assert "hello from the script" in done.stderr


def test_a_drawing_with_errors_is_written_and_ends_with_exit_code_2(tmp_path, monkeypatch):
    monkeypatch.setattr(found_contacts, "MOST_PAIRS", -1)
    script = tmp_path / "design.py"
    design = (ROOT / "samples" / "pendulum" / "design.py").read_text(encoding="utf-8")
    found = design.replace("    return drawing", '    drawing.effect("link_contact", "all")\n    return drawing')
    script.write_text(found, encoding="utf-8")
    done = CliRunner().invoke(app, ["export", str(script), "--out", str(tmp_path / "drawn")])
    assert done.exit_code == 2
    assert "pairs of links may meet" in done.stdout
    assert (tmp_path / "drawn" / "mechanism.json").is_file()


def test_simulate_writes_a_motion_a_page_and_a_report(drawing, tmp_path):
    done = linktwin("simulate", drawing, "--duration", "0.2", "--out", tmp_path / "run", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["result"] == "done"
    assert report["steps"] == 200
    assert abs(report["energy_j"]["end"] - report["energy_j"]["start"]) < 1e-4 * report["energy_j"]["most_kinetic"]
    for path in report["files"].values():
        assert Path(path).is_file()
    bodies = read_mechanism(drawing).bodies
    with h5py.File(report["files"]["motion"]) as file:
        assert set(file["bodies"]) == {body.id for body in bodies}  # what stands still, too
        for body in bodies:
            assert file[f"bodies/{body.id}/quaternion_wxyz"].shape == (201, 4)
            if body.fixed:
                assert np.allclose(file[f"bodies/{body.id}/position_m"], body.pose.position_m, atol=1e-15)
                assert not np.any(file[f"bodies/{body.id}/velocity_m_per_s"])


def test_a_step_of_zero_is_refused(drawing):
    done = linktwin("simulate", drawing, "--step", "0")
    assert done.returncode == 2
    assert "positive" in done.stderr


@pytest.fixture
def python_s_own_ctrl_c():
    """A shell's background jobs begin with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_asks_the_work_to_end_and_the_second_one_ends_it(capsys, python_s_own_ctrl_c):
    with stoppable() as stopped:
        assert not stopped()
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert "ending early" in capsys.readouterr().err
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_whoever_reads_a_log_is_told_how_far_the_work_is_and_quick_work_stays_silent(capsys, monkeypatch):
    with progress("looking") as advance:
        advance(0.1, "a quick thing")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(terminal, "LINE_EVERY_S", 0.0)
    with progress("looking") as advance:
        advance(0.25, "pairs")
        advance(0.5)
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith(" 25%  pairs, 0:00:0")
    assert first.endswith(" left")
    assert second.startswith(" 50%  looking, ")


def test_check_refuses_what_simulate_refuses_with_its_words(drawing):
    parts = json.loads(drawing.read_text())
    parts["effects"] = [{"id": "rub", "kind": "pin_friction", "on": ["pin"], "parameters": {}}]
    drawing.write_text(json.dumps(parts))
    checked, run = linktwin("check", drawing), linktwin("simulate", drawing, "--out", drawing.parent / "out")
    assert checked.returncode == run.returncode == 2
    assert "error: effect 'rub': pin friction at joint 'pin' needs the pin's size" in checked.stdout
    assert run.stderr.strip() in checked.stdout


def test_check_takes_a_study_and_tells_of_each_experiment(drawing):
    rows = "".join(f"{k / 100},pin,{0.2 * np.cos(k / 9):.6f},\n" for k in range(100))
    (drawing.parent / "q.csv").write_text("time_s,joint,q,sigma\n" + rows)
    shot = {"id": "e1", "joint_positions": "q.csv", "release": {"time_s": 0.2}}
    study = drawing.parent / "study.json"
    study.write_text(json.dumps({"schema_version": "1.0", "mechanism": drawing.name, "experiments": [shot]}))
    said, told = linktwin("check", study), linktwin("check", study, "--json")
    assert said.returncode == told.returncode == 0
    assert "e1  fit       0.79 s, let go at 0.2 s, 100 samples (20 before), 1 encoder" in said.stdout
    assert json.loads(told.stdout)["mechanism"]["mobility"]["by_rank"] == 1
    study.write_text(study.read_text().replace("q.csv", "gone.csv"))
    gone = linktwin("check", study)
    assert gone.returncode == 2
    assert "gone.csv: does not exist" in gone.stderr


def test_check_tells_where_no_pose_of_the_drawing_explains_what_was_seen(drawing):
    """A tip that is seen at half its distance from the pin."""
    parts = json.loads(drawing.read_text())
    parts["markers"] = [{"id": "tip", "body": "bar", "position_m": [0.2, 0, 0]}]
    drawing.write_text(json.dumps(parts))
    rows = [f"{k / 100},tip,{0.06 + 1e-5 * (k % 3):.6f},0,{-0.08 - 1e-5 * (k % 2):.6f},\n" for k in range(60)]
    (drawing.parent / "t.csv").write_text("time_s,marker,x_m,y_m,z_m,sigma_m\n" + "".join(rows))
    shot = {"id": "e1", "tracks": "t.csv", "release": {"time_s": 0.2}}
    study = drawing.parent / "study.json"
    study.write_text(json.dumps({"schema_version": "1.0", "mechanism": drawing.name, "experiments": [shot]}))
    said = linktwin("check", study)
    assert said.returncode == 0
    told = "warning: experiment 'e1': no pose of the drawing explains its first samples, marker \"tip\" by 100 mm"
    assert told in said.stdout


def test_check_tells_of_a_drawing_that_was_saved_as_a_study(drawing):
    drawing.rename(drawing.parent / "study.json")
    said = linktwin("check", drawing.parent / "study.json")
    assert "study.json holds a drawing and no experiments, though its name says a study" in said.stdout
