"""`--server` and `--upload`: the same commands, done by a service."""

import json
import os
import shutil
import signal
import subprocess
import sys
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from backend.cli import app
from backend.client.packing import bed_told
from backend.service.keys import make_key
from backend.service.service import open_service
from tests.report.test_pages import report as fit_report
from tests.service.clips import clip
from tests.service.serving import FOURBAR, ROOT, Served, serving, settings_in, until

PENDULUM = ROOT / "samples" / "pendulum"
STUDY = PENDULUM / "measured" / "study.json"
STAND_IN = ROOT / "tests" / "client" / "stand_in.py"
JAM = {
    "schema_version": "1.0", "mechanism": "pendulum", "jammed": False, "cause": "none", "margin": {},
    "sentence": "It moves to the end.", "friction_cone_along": {"time_s": [0.0], "shortage": [None]}, "step_s": 1e-3,
    "time_s": [0.0], "mobility": [1], "small_singular_values": [1], "singular_values": [[1.0]],
    "driven_singular_value": [1.0], "creep_ratio": [1.0], "reactions": {},
}  # fmt: skip

TRACKED = {
    "video": "swing.mp4", "frames": 16, "frames_per_s": 240.0, "metres_per_px": 5e-4, "warnings": [],
    "markers": {"bob": {"status": {"observed": 16}, "sigma_m": 2e-5}},
}  # fmt: skip


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A service that wants a key, whose jobs but simulations are stood in for; the key."""
    folder = tmp_path_factory.mktemp("served")
    reports = folder / "reports"
    prepared = json.loads((ROOT / "tests" / "browser" / "prepared" / "diagnose" / "gap.json").read_text())
    for command, file, told in (
        ("fit", "fit", fit_report().model_dump(mode="json")),
        ("diagnose", "gap", prepared),
        ("jam", "jam", {"experiments": {"low": JAM}}),
        ("track", "tracking", TRACKED),
    ):
        place = reports / command / ("low" if command == "jam" else "")
        place.mkdir(parents=True)
        (place / ("preview.mp4" if command == "track" else f"{file}.html")).write_text("a page")
        (place / f"{file}.json").write_text(json.dumps(told))
        (reports / f"{command}.json").write_text(json.dumps(told))
    settings = settings_in(
        folder, require_keys=True, workers=1, job_command=(sys.executable, str(STAND_IN), str(reports))
    )
    settings.data_folder.mkdir()
    records = open_service(settings)
    key = make_key(records.database, "ada")[1]
    records.close()
    with serving(folder, settings) as running:
        running.client.headers["Authorization"] = f"Bearer {key}"
        yield running, key


def asking(served: tuple[Served, str], *arguments: object, option: str = "--server", **given: str) -> dict[str, Any]:
    """The command line and its environment.  given: another key, another url, a file to be told the progress."""
    running, key = served
    url = given.get("url", str(running.client.base_url))
    code = "from backend.cli import main; main()"
    environment = {**os.environ, "LINKTWIN_KEY": given.get("key", key)}
    if "progress" in given:
        environment["LINKTWIN_PROGRESS"] = given["progress"]
    command = [sys.executable, "-c", code, *map(str, arguments), option, url]
    return {"args": command, "env": environment, "cwd": ROOT, "text": True}


def run(*asked: Any, **given: Any) -> subprocess.CompletedProcess:
    return subprocess.run(**asking(*asked, **given), capture_output=True, timeout=240)


def run_here(*asked: Any, **given: Any) -> Result:
    """The same in this process: what is refused ends before Python would have started."""
    command = asking(*asked, **given)
    return CliRunner(env=command["env"]).invoke(app, command["args"][3:])


def test_a_simulation_done_there_leaves_what_one_done_here_does(served, tmp_path):
    there, here = tmp_path / "there", tmp_path / "here"
    options = ("simulate", FOURBAR, "--duration", "0.05", "--json", "--out")
    done = run(served, *options, there, progress=str(tmp_path / "progress"))
    assert done.returncode == 0, done.stderr
    command = [*done.args[: done.args.index(str(there))], str(here)]
    own = subprocess.run(command, capture_output=True, text=True, timeout=240, cwd=ROOT)
    one, other = json.loads(done.stdout), json.loads(own.stdout)
    assert one.pop("files") == {name: path.replace("/here/", "/there/") for name, path in other.pop("files").items()}
    assert one == other
    assert {path.name for path in there.iterdir()} == {path.name for path in here.iterdir()}
    assert (there / "forces.csv").read_text() == (here / "forces.csv").read_text()
    assert json.loads((tmp_path / "progress").read_text())["part"] == 1.0


def test_a_diagnosis_done_there_tells_the_verdict_and_where_it_is_kept(served, tmp_path):
    asked = ("--tolerance", "1", "--without", "air_drag", "--minutes", "20")
    done = run(served, "diagnose", STUDY, *asked, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    verdict = json.loads((tmp_path / "gap.json").read_text())["verdict"]
    assert done.stdout.startswith(f"{verdict.upper()}: ")
    assert f"open      {tmp_path / 'gap.html'}" in done.stdout
    (job,) = served[0].client.get("/api/v1/jobs?limit=1").json()["items"]
    assert f"kept      {served[0].client.base_url}/ui/jobs/{job['id']}" in done.stdout
    request = job["request"]
    assert (request["tolerance_mm"], request["without"], request["minutes"]) == (1.0, ["air_drag"], 20.0)
    assert {path.name for path in tmp_path.iterdir()} == {"gap.json", "gap.html"}


@pytest.mark.parametrize(
    ("free", "code", "words"),
    [("coulomb_friction:*", 0, ""), ("slow:*", 1, "did not converge"), ("wrong:*", 2, "kind")],
)
def test_a_fit_done_there_ends_as_one_done_here(served, tmp_path, free, code, words):
    done = run(served, "fit", STUDY, "--free", free, "--starts", "2", "--out", tmp_path)
    assert done.returncode == code, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert ("coulomb_friction" in done.stdout) == (code < 2)
    assert (tmp_path / "fit.json").is_file() == (code < 2)


def test_a_jam_of_a_study_is_told_by_experiment(served, tmp_path):
    done = run(served, "jam", STUDY, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("low: It moves to the end.")
    assert f"open      {tmp_path / 'low' / 'jam.html'}" in done.stdout


def test_a_clip_is_tracked_there_with_all_that_the_command_takes(served, tmp_path):
    markers = [marker["id"] for marker in json.loads((PENDULUM / "mechanism.json").read_text())["markers"]]
    camera = {"focal_px": [900.0, 900.0]}
    files = {
        "bed.json": {"stick": {"a_px": [1, 2], "b_px": [300, 2], "length_m": 0.2}, "camera_height_m": 0.8},
        "targets.json": dict.fromkeys(markers, "texture:40"),
        "clicks.json": {markers[0]: [12.5, 80.0]},
        "with_camera.json": {"marks": [], "camera": "lens/camera.json"},
        "lens/camera.json": camera,
    }  # fmt: skip
    (tmp_path / "lens").mkdir()
    for name, told in files.items():
        (tmp_path / name).write_text(json.dumps(told))
    (tmp_path / "swing.mp4").write_bytes(clip())
    options = (
        "--targets",
        tmp_path / "targets.json",
        "--clicks",
        tmp_path / "clicks.json",
        "--from",
        "1.5",
        "--to",
        "4",
    )
    asked = ("track", tmp_path / "swing.mp4", "--mechanism", PENDULUM / "mechanism.json", *options)
    done = run(
        served,
        *asked,
        "--bed",
        tmp_path / "bed.json",
        "--filmed-at",
        "240",
        "--keep-truncated",
        "--coast",
        "0.25",
        "--out",
        tmp_path / "out",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("swing.mp4: 16 frames")
    assert f"open      {tmp_path / 'out' / 'preview.mp4'}" in done.stdout
    (job,) = served[0].client.get("/api/v1/jobs?limit=1").json()["items"]
    told = job["request"]
    assert [told[field] for field in ("bed", "targets", "clicks")] == [
        files[f"{field}.json"] for field in ("bed", "targets", "clicks")
    ]
    assert (told["from_s"], told["to_s"], told["filmed_per_s"], told["keep_truncated"]) == (1.5, 4.0, 240.0, True)
    assert told["coast_s"] == 0.25
    assert bed_told(tmp_path / "with_camera.json")["camera"] == camera
    for wrong, words in ((("--cotracker", tmp_path / "weights"), "this machine"), (("--from", "9"), "not before")):
        refused = run_here(served, *asked, "--bed", tmp_path / "bed.json", *wrong)
        assert refused.exit_code == 2
        assert words in refused.stderr
        assert isinstance(refused.exception, SystemExit)


def test_control_c_cancels_the_job(served, tmp_path):
    client = served[0].client
    command = asking(served, "jam", STUDY, "--duration", "600", "--out", tmp_path)
    with subprocess.Popen(**command, stderr=subprocess.PIPE) as process:
        until("it runs", lambda: client.get("/api/v1/jobs?state=running").json()["items"])
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=120)[1]
    assert process.returncode == 1
    assert "cancelled" in said
    assert "Traceback" not in said
    assert client.get("/api/v1/jobs?limit=1").json()["items"][0]["state"] == "cancelled"


def test_what_the_service_refuses_is_said_with_exit_code_2(served, tmp_path):
    for name in ("mechanism.json", "measured/low.csv"):
        shutil.copy(PENDULUM / name, tmp_path)
    marker = json.loads((tmp_path / "mechanism.json").read_text())["markers"][0]["id"]
    (tmp_path / "low.csv").write_text((tmp_path / "low.csv").read_text().replace(marker, "nobody"))
    experiment = {"id": "low", "tracks": "low.csv", "release": {"time_s": 0.1}}
    study = {"schema_version": "1.0", "mechanism": "mechanism.json", "experiments": [experiment]}
    (tmp_path / "study.json").write_text(json.dumps(study))
    for arguments, given, code, words in (
        (("diagnose", tmp_path / "study.json"), {}, 2, "nobody"),
        (("simulate", FOURBAR), {"key": "lt_guessed"}, 2, "LINKTWIN_KEY"),
        (("diagnose", STUDY, "--resume"), {}, 2, "--resume"),
        (("simulate", STUDY), {}, 2, "experiments"),
        (("jam", STUDY, "--samples", "5"), {}, 2, "give a mechanism"),
        (("simulate", FOURBAR), {"url": "http://127.0.0.1:9"}, 1, "linktwin serve"),
        (("simulate", FOURBAR), {"url": "127.0.0.1"}, 2, "no address"),
    ):
        done = run_here(served, *arguments, "--out", tmp_path / "out", **given)
        assert done.exit_code == code, done.stderr
        assert words in done.stderr
        assert isinstance(done.exception, SystemExit)
        assert done.stdout == ""


def test_an_export_is_handed_over_and_its_page_is_named(served, tmp_path):
    done = run(served, "export", PENDULUM / "design.py", "--out", tmp_path, "--json", option="--upload")
    assert done.returncode == 0, done.stderr
    (thing,) = served[0].client.get("/api/v1/mechanisms?limit=1").json()["items"]
    assert json.loads(done.stdout)["page"] == f"{served[0].client.base_url}/ui/mechanisms/{thing['id']}"
    assert thing["summary"]["missing_meshes"] == []
