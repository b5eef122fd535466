"""The client against a served service: what it stores, starts, watches, cancels, brings and deletes."""

import hashlib
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest
import trimesh

from backend.client import Linktwin, ServiceProblem
from backend.client.packing import study_files
from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.study import ExperimentFile, Release, StudyFile
from backend.service.jobs import requests
from backend.service.keys import make_key
from backend.service.service import open_service
from tests.client.lossy import lossy
from tests.service.clips import clip
from tests.service.serving import FOURBAR, ROOT, Served, serving, settings_in, until

PENDULUM = ROOT / "samples" / "pendulum"
STUDY = PENDULUM / "measured" / "study.json"
CLIP = clip(3_000_000)


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    with serving(folder, settings_in(folder, largest_video=4_000_000)) as running:
        yield running


@pytest.fixture
def address(served: Served) -> str:
    return str(served.client.base_url)


@pytest.fixture
def there(address):
    with Linktwin(address) as client:
        yield client


@pytest.fixture
def fourbar(there):
    return there.store_mechanism(FOURBAR)


def test_a_simulation_from_the_drawing_to_its_files(there, tmp_path):
    sent, told = [], []
    thing = there.store_mechanism(FOURBAR, sent=sent.append)
    assert sent[-1] == 1.0
    assert (thing.kind, thing.name, thing.summary["bodies"]) == ("mechanism", "fourbar", 4)
    job = there.wait(there.simulate(thing, duration_s=0.5), told.append)
    assert job.state == "succeeded"
    assert told[-1].state == "succeeded"
    assert [progress.part for progress in told] == sorted(progress.part for progress in told)
    assert any(0.0 < progress.part < 1.0 for progress in told)
    assert there.result(job).report == {"mechanism": "fourbar"}
    written = there.download(job, tmp_path, without=["report.json"])
    assert written == [tmp_path / "inner" / "motion.csv"]
    assert written[0].read_text() == "time_s\n0\n"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == written


def test_a_drawing_goes_with_those_of_its_meshes_that_are_there(there, tmp_path):
    (tmp_path / "meshes").mkdir()
    shutil.copy(FOURBAR, tmp_path)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "meshes" / "crank.stl")
    (tmp_path / "meshes" / "stray.stl").write_text("named by nobody")
    thing = there.store_mechanism(tmp_path, name="mine")
    assert thing.name == "mine"
    assert {file.path for file in thing.files} == {"mechanism.json", "meshes/crank.stl"}
    assert thing.summary["missing_meshes"] == [f"meshes/{name}.stl" for name in ("coupler", "frame", "rocker")]
    there.delete(thing)
    with pytest.raises(ServiceProblem, match="There is no mechanism") as found:
        there.thing("mechanism", thing.id)
    assert (found.value.status, found.value.kind, found.value.title) == (404, "not-found", "There is no such thing")
    there.delete(thing)  # gone is gone


def test_a_study_goes_with_all_that_it_names_wherever_that_lies(there):
    assert '"../mechanism.json"' in STUDY.read_text()
    thing = there.store_study(STUDY)
    tables = [one["tracks"] for one in json.loads(STUDY.read_text())["experiments"]]
    assert {file.path for file in thing.files} >= {"study.json", "mechanism.json", *tables}
    assert [one["id"] for one in thing.summary["experiments"]][:2] == ["low", "middle"]


def test_a_study_of_ones_own_tracks_and_one_of_what_is_stored(there, tmp_path):
    table = PENDULUM / "measured" / "low.csv"
    study = StudyFile(
        mechanism=str(PENDULUM / "mechanism.json"),
        experiments=(ExperimentFile(id="e1", tracks=str(table), release=Release(time_s=0.1)),),
    )
    first = there.store_study(study)
    assert {"mechanism.json", "experiment_1_tracks.csv"} < {file.path for file in first.files}
    address = f"studies/{first.id}/files"
    second = there.compose_study(
        {
            "schema_version": "1.0",
            "mechanism": f"{address}/mechanism.json",
            "experiments": [{"id": "e", "tracks": f"{address}/experiment_1_tracks.csv", "release": {"time_s": 0.1}}],
        }
    )
    assert second.summary["experiments"] == [{"id": "e", "use": "fit"}]


def test_files_outside_a_study_get_names_inside_it_and_one_file_is_sent_once(tmp_path):
    (tmp_path / "here").mkdir()
    shutil.copy(PENDULUM / "mechanism.json", tmp_path / "drawn.json")
    for name in ("a b.csv", "here/plain.csv"):
        (tmp_path / name).write_text("time_s\n")
    names = ["../a b.csv", "plain.csv", "plain.csv"]
    release = {"time_s": 0.1}
    told = {
        "schema_version": "1.0",
        "mechanism": "../drawn.json",
        "experiments": [{"id": f"e{i}", "tracks": name, "release": release} for i, name in enumerate(names)],
    }
    path = tmp_path / "here" / "study.json"
    path.write_text(json.dumps(told))
    files = study_files(path, path.parent)
    assert set(files) == {"study.json", "mechanism.json", "experiment_1_tracks.csv", "plain.csv"}
    renamed = json.loads(files["study.json"])
    assert renamed["mechanism"] == "mechanism.json"
    assert [one["tracks"] for one in renamed["experiments"]] == ["experiment_1_tracks.csv", "plain.csv", "plain.csv"]
    (tmp_path / "here" / "plain.csv").unlink()
    with pytest.raises(DrawingError, match=r"plain\.csv"):
        study_files(path, path.parent)


def test_a_clip_is_streamed_and_what_is_none_is_refused(there, tmp_path):
    clip = tmp_path / "e1.mp4"
    clip.write_bytes(CLIP)
    sent = []
    thing = there.store_clip(clip, sent=sent.append)
    assert (thing.kind, thing.name, thing.bytes) == ("video", "e1", clip.stat().st_size)
    assert len(sent) > 10
    clip.write_text("no clip")
    with pytest.raises(ServiceProblem) as found:
        there.store_clip(clip)
    assert (found.value.status, found.value.kind) == (415, "wrong-type")


def test_a_clip_that_is_too_large_is_refused_before_it_has_all_been_sent(there, tmp_path):
    clip, sent = tmp_path / "long.mp4", []
    with clip.open("wb") as file:
        file.truncate(100_000_000)
    with pytest.raises(ServiceProblem, match="above the limit of 4000000") as found:
        there.store_clip(clip, sent=sent.append)
    assert (found.value.status, found.value.kind) == (413, "too-large")
    assert max(sent, default=0.0) < 0.5


def test_a_refused_study_says_each_fault_in_the_services_words(there, tmp_path):
    for name in ("mechanism.json", "measured/low.csv"):
        shutil.copy(PENDULUM / name, tmp_path)
    table = tmp_path / "low.csv"
    marker = json.loads((tmp_path / "mechanism.json").read_text())["markers"][0]["id"]
    table.write_text(table.read_text().replace(marker, "nobody"))
    experiment = ExperimentFile(id="e1", tracks="low.csv", release=Release(time_s=0.1))
    study = StudyFile(mechanism="mechanism.json", experiments=(experiment,))
    with pytest.raises(ServiceProblem) as found:
        there.store_study(study, tmp_path)
    problem = found.value
    assert (problem.status, problem.kind, problem.title) == (422, "invalid", "The input has faults")
    assert any("nobody" in fault for fault in problem.faults)
    assert all(fault in str(problem) for fault in problem.faults)


def test_a_request_that_the_service_refuses_says_why(there, fourbar):
    with pytest.raises(ServiceProblem) as found:
        there.simulate(fourbar, duration_s=-1.0)
    assert found.value.status == 422
    assert any("duration_s" in fault for fault in found.value.faults)
    with pytest.raises(ServiceProblem, match="no mechanism"):
        there.simulate("0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55")


def test_a_wrong_key_is_refused_before_anything_is_sent(tmp_path):
    settings = settings_in(tmp_path, require_keys=True, workers=0)
    settings.data_folder.mkdir()
    records = open_service(settings)
    key = make_key(records.database, "ada")[1]
    records.close()
    with serving(tmp_path, settings) as locked:
        url, sent = str(locked.client.base_url), []
        for wrong, words in ((None, "linktwin key new"), ("lt_guessed", "unknown or was revoked")):
            with Linktwin(url, wrong) as there, pytest.raises(ServiceProblem) as found:
                there.store_mechanism(FOURBAR, sent=sent.append)
            assert (found.value.status, found.value.kind) == (401, "no-key")
            assert words in found.value.detail
        assert sent == []
        with Linktwin(url + "/", key) as there:
            assert there.job(there.simulate(there.store_mechanism(FOURBAR))).state == "queued"


@pytest.mark.parametrize(
    ("url", "key", "words"),
    [
        ("127.0.0.1:8000", None, "no address"),
        ("ftp://127.0.0.1", None, "no address"),
        ("http://127.0.0.1:port", None, "no address"),
        ("http://far.example", "lt_1", "unencrypted"),
        ("https://far.example", "lt 1", "a space"),
    ],
)
def test_an_address_that_is_none_or_would_show_the_key_is_refused(url, key, words):
    with pytest.raises(ValueError, match=words):
        Linktwin(url, key)


def test_a_cancelled_job_ends_the_wait(there, fourbar):
    job = there.simulate(fourbar, duration_s=600.0)
    ending = threading.Timer(1.5, there.cancel, [job])
    ending.start()
    began = time.monotonic()
    ended = there.wait(job)
    ending.join()
    assert ended.state == "cancelled"
    assert time.monotonic() - began < 20.0
    with pytest.raises(ServiceProblem) as found:
        there.result(job)
    assert found.value.kind == "no-result"


def test_a_job_that_failed_says_why_and_one_that_takes_too_long_goes_on(there, fourbar):
    ended = there.wait(there.simulate(fourbar, duration_s=0.1, solve="reduced"))
    assert (ended.state, ended.exit_code) == ("failed", 1)
    assert "try another way" in ended.message
    job = there.simulate(fourbar, duration_s=600.0)
    began = time.monotonic()
    with pytest.raises(TimeoutError, match="goes on"):
        there.wait(job, longest_s=0.5)
    assert time.monotonic() - began < 10.0
    assert there.job(job).state in ("queued", "running")
    there.delete(there.cancel(job))
    with pytest.raises(ServiceProblem, match="no job"):
        there.wait(job)


def test_a_job_is_started_once_though_the_answer_was_lost(served, address, fourbar):
    before = served.client.get("/api/v1/jobs").json()["total"]
    # No answer comes, then the beginning of one.
    with lossy(address, 0, 30) as line, Linktwin(line.url) as there:
        job = there.simulate(fourbar, duration_s=0.1)
        assert line.connections == 3
        assert there.wait(job).state == "succeeded"
    assert served.client.get("/api/v1/jobs").json()["total"] == before + 1
    assert served.ledger("start", job.id) == 1


def test_an_upload_whose_answer_was_lost_is_sent_again_and_stored_once(served, address):
    before = served.client.get("/api/v1/mechanisms").json()["total"]
    with lossy(address, 1500) as line, Linktwin(line.url) as there:
        first = there.store_mechanism(FOURBAR)
        second = there.store_mechanism(FOURBAR)
        assert line.connections == 2
    assert first.id != second.id  # two uploads, each of a key of its own
    assert served.client.get("/api/v1/mechanisms").json()["total"] == before + 2


@pytest.mark.parametrize(("part", "after_s"), [(0.3, 0.0), (1.0, 0.0), (1.0, 0.03)])
def test_an_upload_outlives_the_web_process(served, there, tmp_path, part, after_s):
    (tmp_path / "clip.mp4").write_bytes(CLIP)
    before = served.client.get("/api/v1/videos").json()["total"]
    (web,) = served.processes("backend.service.web")
    killing = threading.Timer(after_s, os.kill, [web, signal.SIGKILL])

    def sent(gone: float) -> None:
        if gone >= part and not killing.is_alive() and killing.ident is None:
            killing.start()
            if after_s == 0.0:
                killing.join()

    thing = there.store_clip(tmp_path / "clip.mp4", sent=sent)
    killing.join()
    until("it answers again", lambda: served.processes("backend.service.web"))
    assert there._line.ask("GET", "/videos").json()["total"] == before + 1
    (file,) = there.thing("video", thing.id).files
    assert file.sha256 == hashlib.sha256(CLIP).hexdigest()


def test_a_program_that_asks_again_under_its_key_gets_what_it_stored(there, tmp_path):
    first = there.store_study(STUDY, repeat_key="mine")
    assert there.store_study(STUDY, repeat_key="mine").id == first.id  # packed anew, with other stamps
    with pytest.raises(ServiceProblem, match="stood for another request") as found:
        there.store_mechanism(FOURBAR, repeat_key="mine")
    assert (found.value.status, found.value.kind) == (422, "key-reused")


def test_a_wait_outlives_lines_that_break(address, fourbar):
    # They break amid the events, and then in the polls that follow.
    with lossy(address, None, 600, 0, 200) as line, Linktwin(line.url) as there:
        job = there.simulate(fourbar, duration_s=4.0)
        told = []
        assert there.wait(job, told.append).state == "succeeded"
        assert any(0.0 < progress.part < 1.0 for progress in told)


def test_a_wait_outlives_the_web_process(served, there, fourbar):
    job = there.simulate(fourbar, duration_s=4.0)
    served.running(job.id)
    (web,) = served.processes("backend.service.web")
    killing = threading.Timer(0.5, os.kill, [web, signal.SIGKILL])
    killing.start()
    assert there.wait(job).state == "succeeded"
    killing.join()


def test_where_no_events_come_through_the_job_is_polled(there, fourbar, monkeypatch):
    asked = []

    def silent(job, silence_s):
        asked.append(job)
        raise ServiceProblem("No stream", "a proxy answers", 404, "not-found")
        yield

    monkeypatch.setattr(there, "events", silent)
    told = []
    assert there.wait(there.simulate(fourbar, duration_s=2.0), told.append).state == "succeeded"
    assert len(asked) == 1
    assert any(0.0 < progress.part < 1.0 for progress in told)


def test_a_download_that_breaks_off_is_begun_again_and_leaves_nothing_half(
    there, address, fourbar, tmp_path, monkeypatch
):
    job = there.wait(there.simulate(fourbar, duration_s=0.1))
    files = there.files(job)
    answer = httpx.get(f"{address}{files[0].url}")
    whole = sum(len(name) + len(value) + 4 for name, value in answer.headers.raw) + 19 + len(answer.content)
    with lossy(address, 0, whole - 3) as line, Linktwin(line.url) as lost:  # nothing comes, then most of a file
        monkeypatch.setattr(lost, "files", lambda _: files)
        written = lost.download(job, tmp_path)
        assert line.connections == 3
    assert sorted(path.name for path in written) == ["motion.csv", "report.json"]
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(written)


def test_a_file_that_comes_changed_or_would_lie_outside_is_not_kept(there, fourbar, tmp_path, monkeypatch):
    monkeypatch.setattr("backend.client.line.PAUSES_S", (0.0,))
    job = there.wait(there.simulate(fourbar, duration_s=0.1))
    files = there.files(job)
    monkeypatch.setattr(there, "files", lambda _: [file.model_copy(update={"sha256": "0"}) for file in files])
    with pytest.raises(ServiceProblem, match="not what was stored"):
        there.download(job, tmp_path / "a")
    assert not [path for path in (tmp_path / "a").rglob("*") if path.is_file()]
    monkeypatch.setattr(there, "files", lambda _: [files[0].model_copy(update={"path": "../../up"})])
    with pytest.raises(ServiceProblem, match="outside the folder"):
        there.download(job, tmp_path / "b")


def test_nobody_there_is_said_in_a_sentence(monkeypatch):
    monkeypatch.setattr("backend.client.line.PAUSES_S", (0.0,))
    with Linktwin("http://127.0.0.1:9") as there, pytest.raises(ServiceProblem, match="linktwin serve") as found:
        there.job("any")
    assert found.value.status is None


@pytest.mark.parametrize(
    "request_kind",
    [
        requests.SimulateRequest,
        requests.JamRequest,
        requests.FitRequest,
        requests.DiagnoseRequest,
        requests.TrackRequest,
    ],
)
def test_each_method_has_its_requests_options_and_their_defaults(request_kind):
    name = request_kind.__name__.removesuffix("Request").lower()
    options = dict(inspect.signature(getattr(Linktwin, name)).parameters)
    for own in ("self", "repeat_key"):
        options.pop(own)
    fields = {field: info for field, info in request_kind.model_fields.items() if field != "kind"}
    assert set(options) == set(fields)
    for field, info in fields.items():
        told = options[field].default
        default = [] if told == () else told
        assert (told is inspect.Parameter.empty) if info.is_required() else (default == info.default), field


def test_the_client_loads_nothing_of_the_service_but_its_models():
    code = "import sys; import backend.client; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(ROOT), check=True)
    assert set(done.stdout.split()) & {"jax", "cv2", "fastapi", "sqlmodel", "sqlalchemy", "dbos", "pandas"} == set()
