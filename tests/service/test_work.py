"""A worker's work on one job, done in this process: real commands, limits, checkpoints, claims."""

import json
import os
import threading
import time
from glob import glob
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event
from sqlalchemy.exc import OperationalError
from sqlmodel import Session

from backend.service.jobs import work
from backend.service.jobs.checkpoint import Checkpoints
from backend.service.jobs.command import arguments
from backend.service.jobs.desk import cancel_job, find_job, job_files, job_report, list_jobs, start_job
from backend.service.jobs.holding import HeldElsewhere, claim, finish, lost
from backend.service.jobs.requests import FitRequest, SimulateRequest, TrackRequest
from backend.service.jobs.work import carry_out
from backend.service.mechanisms import store_mechanism_document
from backend.service.problems import Problem
from backend.service.records import Job, Worker
from backend.service.retention import tidy_up
from backend.service.routes.jobs import MARKS
from backend.service.service import LOCAL, open_service
from backend.service.settings import Settings
from backend.service.storage import Storage
from backend.service.studies import store_study
from backend.service.things import delete_thing, files_of, list_things
from backend.service.videos import store_video
from tests.service.clips import clip
from tests.service.serving import FOURBAR, settings_in, until
from tests.service.test_routes import STUDY, TRACKS

ME, ANOTHER = "this-worker", "another-worker"


@pytest.fixture
def opened(tmp_path):
    def make(**settings):
        return open_service(settings_in(tmp_path, **settings))

    return make


def simulation(service, **options):
    drawing = store_mechanism_document(service, LOCAL, FOURBAR.read_bytes())
    return start_job(service, LOCAL, SimulateRequest(kind="simulate", mechanism=drawing.id, **options))


def done(service, job):
    carry_out(service, job.id, ME, lambda: True)
    return find_job(service, LOCAL, job.id)


def test_a_clip_is_tracked_by_the_same_command_as_on_the_command_line(opened, tmp_path):
    from tests.observe.scenes import film, four

    clip = film(tmp_path / "clip.mp4", np.arange(20) / 240, four, [("base", "swing"), ("post", "wheel")])
    service = opened(job_command=Settings().job_command)
    video = store_video(service, LOCAL, clip.path)
    drawing = store_mechanism_document(service, LOCAL, clip.mechanism.model_dump_json().encode())
    part = {"from_s": 3.5 / 240, "filmed_per_s": 480.0}  # without the first four pictures, twice as fast as it plays
    asked = TrackRequest(kind="track", video=video.id, mechanism=drawing.id, bed=clip.bed, **part)
    job = done(service, start_job(service, LOCAL, asked))
    assert job.state == "succeeded", job.message
    assert {"tracks.csv", "preview.mp4", "report.json"} <= {file.path for file in job_files(service, LOCAL, job.id)}
    report = job_report(service, LOCAL, job.id)
    assert (report["frames"], round(report["frames_per_s"]), round(report["slower"])) == (16, 480, 2)
    assert report["begins_s"] == pytest.approx(4 / 240, abs=1e-4)  # stamps are rounded
    told = json.dumps(report)
    assert str(tmp_path) not in told  # nothing of this machine's folders
    assert job.words  # the command told of its progress


def test_what_markers_carry_reaches_the_command(opened, tmp_path):
    service = opened()
    drawing = store_mechanism_document(service, LOCAL, FOURBAR.read_bytes())
    (tmp_path / "clip").write_bytes(clip())
    video = store_video(service, LOCAL, tmp_path / "clip")
    targets = dict.fromkeys(drawing.summary["markers"], "texture:40")
    asked = TrackRequest(
        kind="track", video=video.id, mechanism=drawing.id, bed=MARKS, targets=targets, to_s=2.5, coast_s=0.25
    )
    job = start_job(service, LOCAL, asked)
    words = arguments(service, job.request, tmp_path, tmp_path / "out", resume=False)
    options = dict(word.partition("=")[::2] for word in words)
    assert json.loads(Path(options["--targets"]).read_text()) == targets
    assert json.loads(Path(options["--bed"]).read_text()) == MARKS
    assert (options["--from"], options["--to"], options["--coast"]) == ("0.0", "2.5", "0.25")
    assert not {"--clicks", "--filmed-at"} & set(options)


def test_a_study_that_cannot_be_fitted_fails_with_the_commands_own_sentence(opened, tmp_path):
    service = opened(job_command=Settings().job_command)
    files = {
        "mechanism.json": FOURBAR.read_bytes(),
        "e1.csv": TRACKS.encode(),
        "study.json": json.dumps(STUDY).encode(),
    }
    laid = {}
    for path, content in files.items():
        laid[path] = tmp_path / path
        laid[path].write_bytes(content)
    study = store_study(service, LOCAL, laid)
    job = done(service, start_job(service, LOCAL, FitRequest(kind="fit", study=study.id, free=["no_such_friction:*"])))
    assert (job.state, job.exit_code) == ("failed", 2)
    assert "no_such_friction" in job.message
    assert str(tmp_path) not in job.message


def test_a_fit_that_was_cut_off_goes_on_from_its_checkpoint_kept_in_an_object_store(opened, tmp_path):
    service = opened(storage_url="memory://linktwin-test", checkpoint_s=0.1)
    assert not service.storage.is_local
    files = {
        "mechanism.json": FOURBAR.read_bytes(),
        "e1.csv": TRACKS.encode(),
        "study.json": json.dumps(STUDY).encode(),
    }
    laid = {}
    for path, content in files.items():
        laid[path] = tmp_path / path
        laid[path].write_bytes(content)
    study = store_study(service, LOCAL, laid)
    job = start_job(service, LOCAL, FitRequest(kind="fit", study=study.id, free=["coulomb_friction:*"]))
    assert done(service, job).state == "queued"  # given back, because its process was killed
    assert done(service, job).state == "succeeded"
    assert job_report(service, LOCAL, job.id) == {"went on from": "as far as the first half"}
    assert files_of(service, f"checkpoint:{job.id}") == []
    assert "fit.checkpoint.json" not in {file.path for file in job_files(service, LOCAL, job.id)}


def test_what_a_job_shows_of_its_work_is_seen_while_it_runs_and_is_no_result(opened):
    service = opened()
    job = simulation(service, duration_s=1.5)
    working = threading.Thread(target=carry_out, args=(service, job.id, ME, lambda: True))
    working.start()
    try:
        until("a picture", lambda: [f.path for f in files_of(service, f"checkpoint:{job.id}")] == ["watching.jpg"])
    finally:
        working.join()
    assert find_job(service, LOCAL, job.id).state == "succeeded"
    assert files_of(service, f"checkpoint:{job.id}") == []
    assert "watching.jpg" not in {file.path for file in job_files(service, LOCAL, job.id)}


@pytest.mark.parametrize(
    ("limits", "options", "says"),
    [
        ({"job_timeout_s": 0.5}, {"duration_s": 60.0}, "above the limit of 0 s"),
        (
            {"job_memory_bytes": 50 * 2**20},
            {"duration_s": 60.0, "threshold": 0.125},
            "MiB of memory, above the limit of 50",
        ),
    ],
    ids=["time", "memory"],
)
def test_a_job_beyond_its_limits_is_ended_with_the_reason(opened, limits, options, says):
    service = opened(**limits)
    job = done(service, simulation(service, **options))
    assert job.state == "failed"
    assert says in job.message


def test_a_job_whose_process_is_always_killed_is_given_up(opened):
    service = opened(most_crashes=1)
    job = done(service, simulation(service, duration_s=0.1, threshold=0.5))
    assert job.state == "failed"
    assert "signal 9" in job.message


def failing(monkeypatch, owner, name, times, error):
    """Let a function fail so many times, then do its work; the list of its calls."""
    done, calls = getattr(owner, name), []

    def fails_first(*given):
        calls.append(given)
        if len(calls) <= times:
            raise error
        return done(*given)

    monkeypatch.setattr(owner, name, fails_first)
    return calls


AWAY = OperationalError("SELECT 1", {}, Exception("the database is away"))


def test_a_hiccup_of_the_database_or_the_storage_does_not_end_the_work(opened, monkeypatch, tmp_path):
    service = opened(poll_s=0.02, most_attempts=1)
    job = simulation(service, duration_s=1.0)
    hiccups = [
        failing(monkeypatch, work, "lost", 2, AWAY),
        failing(monkeypatch, work, "note_progress", 2, AWAY),
        failing(monkeypatch, Checkpoints, "copy", 2, OSError("the storage is away")),
    ]
    job = done(service, job)
    assert (job.state, job.attempt, job.crashes) == ("succeeded", 1, 0)
    assert all(len(calls) > 2 for calls in hiccups)
    assert (tmp_path / "ledger").read_text().count("start") == 1


@pytest.mark.parametrize("name", ["bring", "put"], ids=["before the work", "after the work"])
def test_storage_that_is_away_costs_a_job_no_attempt(opened, monkeypatch, tmp_path, name):
    service = opened(most_attempts=1, heartbeat_s=0.01)
    job = simulation(service, duration_s=0.1)
    failing(monkeypatch, service.storage, name, 2, OSError("the storage is away"))
    job = done(service, job)
    assert (job.state, job.attempt) == ("succeeded", 1)
    assert (tmp_path / "ledger").read_text().count("start") == 1
    assert len(list(service.storage.written())) == 3  # the drawing, the report and the motion


def test_a_job_cancelled_while_the_storage_is_away_is_left_alone(opened, monkeypatch):
    service = opened(heartbeat_s=0.01)
    job = simulation(service, duration_s=0.1)

    def away(*given):
        cancel_job(service, LOCAL, job.id)
        raise OSError("the storage is away")

    monkeypatch.setattr(service.storage, "put", away)
    assert done(service, job).state == "cancelled"


def test_pauses_after_errors_grow_up_to_a_minute():
    settings = Settings(heartbeat_s=1.0)
    assert [work.pause_s(settings, failures) for failures in (0, 1, 5, 6, 5000)] == [1.0, 2.0, 32.0, 60.0, 60.0]


def test_who_lost_a_claim_cannot_say_how_the_job_ended(opened):
    service = opened()
    job = simulation(service)
    first = claim(service, job.id, ANOTHER)  # of a worker without a heartbeat
    second = claim(service, job.id, ME)
    assert (first.attempt, second.attempt) == (1, 2)
    assert lost(service, first)
    assert not finish(service, first, "failed", [], "late", 1)
    assert finish(service, second, "succeeded", [], "", 0)
    assert claim(service, job.id, ME) is None
    assert find_job(service, LOCAL, job.id).state == "succeeded"


def test_who_lost_a_job_to_another_stays_with_it_until_it_has_ended(opened):
    # To return would tell the durable queue that the job is done, and nobody would resume it if the other died.
    service = opened()
    with service.database.writing() as session:
        session.add(Worker(id=ANOTHER, host="here", pid=1))
    job = simulation(service, duration_s=600.0)
    late = threading.Thread(target=carry_out, args=(service, job.id, ME, lambda: True))
    late.start()
    until("it works", lambda: find_job(service, LOCAL, job.id).words)
    taken = claim(service, job.id, ANOTHER)
    folders = service.settings.scratch / "jobs"
    until("the late one has dropped its work", lambda: not glob(f"{folders}/*/*"))  # as folders come and go
    assert late.is_alive()
    assert finish(service, taken, "succeeded", [], "", 0)
    late.join(30)
    assert not late.is_alive()
    assert find_job(service, LOCAL, job.id).attempt == 2


def test_a_job_held_by_a_living_worker_is_not_taken(opened):
    service = opened(most_attempts=1)
    with service.database.writing() as session:
        session.add(Worker(id=ANOTHER, host="here", pid=1))
    job = simulation(service)
    claim(service, job.id, ANOTHER)
    with pytest.raises(HeldElsewhere):
        claim(service, job.id, ME)
    with service.database.writing() as session:
        session.get(Worker, ANOTHER).ended = time.time()
    assert claim(service, job.id, ME) is None  # one attempt was all it was granted
    assert "Given up" in find_job(service, LOCAL, job.id).message


def test_a_cancelled_job_is_not_begun_and_one_whose_input_is_gone_says_so(opened):
    service = opened()
    cancelled, orphan = simulation(service), simulation(service)
    cancel_job(service, LOCAL, cancelled.id)
    assert done(service, cancelled).attempt == 0
    with service.database.writing() as session:
        row = session.get(Job, orphan.id)
        row.request = {**row.request, "mechanism": "0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55"}
        session.add(row)
    assert "was deleted" in done(service, orphan).message


def test_what_is_past_its_time_goes_and_takes_its_files_with_it(opened):
    service = opened(retention_days=1.0)
    old, young = simulation(service, duration_s=0.1), simulation(service, duration_s=0.1)
    for job in (old, young):
        assert done(service, job).state == "succeeded"
    with service.database.writing() as session:
        row = session.get(Job, old.id)
        row.finished -= 2 * 86_400
        session.add(row)
    before = len(list(service.storage.written()))
    tidy_up(service)
    assert [job.id for job in list_jobs(service, LOCAL).rows] == [young.id]
    assert len(list(service.storage.written())) == before - 2  # its report and its motion
    for thing in list_things(service, LOCAL, "mechanism").rows:
        delete_thing(service, LOCAL, "mechanism", thing.id)
    assert len(list(service.storage.written())) == 2


@pytest.mark.parametrize("marked", [True, False], ids=["marked", "before there were marks"])
def test_files_of_another_database_are_not_taken_for_strays(opened, tmp_path, marked):
    service = opened()
    store_mechanism_document(service, LOCAL, FOURBAR.read_bytes())
    if marked:
        tidy_up(service)
    stray = service.storage.put(FOURBAR).key
    files = [path for path in (tmp_path / "data" / "files").rglob("*") if len(path.name) == 36]
    for path in files:
        os.utime(path, (1, 1))
    tidy_up(other := opened(database_url=f"sqlite:///{tmp_path / 'other.sqlite'}"))
    assert len(files) == 2
    assert all(path.exists() for path in files)
    tidy_up(service)
    assert {path.name for path in files if not path.exists()} == {stray}
    other.close()


def test_no_time_at_all_is_no_time_to_keep_things():
    with pytest.raises(ValueError, match="greater than 0"):
        Settings(retention_days=0.0)


@pytest.mark.parametrize("url", ["file://{folder}/files", "memory://linktwin-storage"])
def test_storage_keeps_bytes_whole_under_names_of_its_own(tmp_path, url):
    storage = Storage(url.format(folder=tmp_path))
    source = tmp_path / "source"
    source.write_bytes(b"a" * 3_000_000)
    kept = storage.put(source)
    assert kept.bytes == 3_000_000
    assert storage.read(kept.key) == source.read_bytes()
    storage.bring(kept.key, tmp_path / "brought" / "here")
    assert (tmp_path / "brought" / "here").read_bytes() == source.read_bytes()
    assert kept.key in {key for key, _ in storage.written()}
    storage.drop(kept.key)
    storage.drop(kept.key)
    assert kept.key not in {key for key, _ in storage.written()}
    with pytest.raises(FileNotFoundError):
        storage.read(kept.key)


@pytest.mark.parametrize("answered", [True, False], ids=["refused", "unheard"])
def test_the_files_of_an_upload_outlive_a_commit_whose_answer_is_lost(opened, monkeypatch, answered):
    service = opened()

    def fails(session):
        raise AWAY

    listened = "before_flush" if answered else "after_commit"
    event.listen(Session, listened, hear := lambda session, *given: fails(session))
    try:
        with pytest.raises(OperationalError):
            store_mechanism_document(service, LOCAL, FOURBAR.read_bytes())
    finally:
        event.remove(Session, listened, hear)
    listed = list_things(service, LOCAL, "mechanism").rows
    assert len(listed) == (0 if answered else 1)
    assert len(list(service.storage.written())) == len(listed)


def test_a_job_for_a_thing_of_the_wrong_kind_is_refused(opened):
    service = opened()
    drawing = store_mechanism_document(service, LOCAL, FOURBAR.read_bytes())
    with pytest.raises(Problem, match="no study"):
        start_job(service, LOCAL, FitRequest(kind="fit", study=drawing.id, free=["coulomb_friction:*"]))
