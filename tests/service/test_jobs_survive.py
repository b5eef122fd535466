"""Jobs are done, once, whatever dies on the way; the service is killed as kill -9 does it."""

import math
import os
import signal
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from tests.service.serving import PATIENCE_S, Served, events, serving, settings_in, until


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    with serving(folder, settings_in(folder)) as running:
        yield running
        complaints = [
            line for line in running.log.read_text().splitlines() if "Traceback" in line or '"failed"' in line
        ]
        assert not complaints, running.log.read_text()


@pytest.fixture(scope="module")
def drawing(served: Served) -> str:
    return served.store()


def test_a_job_tells_its_progress_and_then_its_result(served, drawing):
    id = served.start(drawing, duration_s=0.5)
    told = list(events(served.client, id))
    assert [name for name, _ in told][-1] == "end"
    assert told[-1][1]["state"] == "succeeded"
    parts = [data["part"] for _, data in told]
    assert parts == sorted(parts)
    assert any(0.0 < part < 1.0 for part in parts)
    going_on = [data["remaining_s"] for _, data in told if data["state"] == "running" and data["part"] > 0.02]
    assert going_on
    assert all(math.isfinite(remaining_s) and remaining_s >= 0.0 for remaining_s in going_on)
    assert told[-1][1]["remaining_s"] == 0.0
    result = served.client.get(f"/api/v1/jobs/{id}/result").json()
    assert result["report"] == {"mechanism": "fourbar"}
    assert {file["path"] for file in result["files"]} == {"inner/motion.csv", "report.json"}
    (motion,) = [file for file in result["files"] if file["path"] == "inner/motion.csv"]
    assert served.client.get(motion["url"]).text == "time_s\n0\n"


def test_a_killed_worker_loses_no_job_and_its_process_dies_with_it(served, drawing):
    id = served.start(drawing, duration_s=3.0, threshold=0.75)
    served.running(id)
    process = int((served.folder / "ledger").read_text().splitlines()[-1].split()[2])
    for pid in served.processes("backend.service.jobs"):
        os.kill(pid, signal.SIGKILL)
    until("the job's process is gone", lambda: not Path(f"/proc/{process}").exists())
    job = served.finished(id)
    assert job["state"] == "succeeded", job
    assert job["attempt"] == 2
    assert (served.ledger("start", id), served.ledger("end", id)) == (2, 1)


def test_a_killed_web_process_loses_no_job_and_refuses_nobody(served, drawing):
    id = served.start(drawing, duration_s=1.0)
    (web,) = served.processes("backend.service.web")
    os.kill(web, signal.SIGKILL)
    until("the web process is gone", lambda: web not in served.processes("backend.service.web"))
    # A new connection waits in the socket until a new process answers; those that were open are broken.
    assert httpx.get(f"{served.client.base_url}/health", timeout=PATIENCE_S).json()["status"] == "ok"
    job = served.finished(id)
    assert job["state"] == "succeeded"
    assert served.ledger("end", id) == 1


def test_a_job_asked_for_twice_under_one_key_is_done_once(served, drawing):
    key = {"Idempotency-Key": "the-same"}
    first, second = (served.start(drawing, headers=key, duration_s=0.1) for _ in range(2))
    assert first == second
    served.finished(first)
    assert served.ledger("start", first) == 1
    other = served.client.post(
        "/api/v1/jobs", json={"kind": "simulate", "mechanism": drawing, "duration_s": 0.2}, headers=key
    )
    assert other.status_code == 422
    assert other.json()["type"].endswith("key-reused")


def test_cancelling_ends_the_work_and_all_it_started_within_two_seconds(served, drawing):
    id = served.start(drawing, duration_s=600.0, threshold=0.25)
    served.running(id)
    left = int(until("it left a process", lambda: (served.folder / "ledger.left").read_text()))
    began = time.monotonic()
    assert served.client.delete(f"/api/v1/jobs/{id}").json()["state"] == "cancelled"
    until("all its processes are gone", lambda: not _runs(left))
    assert time.monotonic() - began < 2.0
    assert served.job(id)["state"] == "cancelled"
    assert served.ledger("end", id) == 0


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_work_that_fails_says_why_and_keeps_what_it_wrote(served, drawing):
    job = served.finished(served.start(drawing, duration_s=0.1, solve="reduced"))
    assert (job["state"], job["exit_code"]) == ("failed", 1)
    assert job["message"] == "mechanism/mechanism.json: it did not succeed; try another way"
    files = served.client.get(f"/api/v1/jobs/{job['id']}/files").json()
    assert [file["path"] for file in files] == ["inner/motion.csv"]
    answer = served.client.get(f"/api/v1/jobs/{job['id']}/result")
    assert answer.status_code == 409
    assert "did not succeed" in answer.json()["detail"]


def test_a_process_that_is_killed_from_outside_is_begun_again(served, drawing):
    job = served.finished(served.start(drawing, duration_s=0.1, threshold=0.5))
    assert (job["state"], job["attempt"]) == ("succeeded", 2)


def test_a_worker_that_is_stopped_is_ended_and_another_takes_its_job(served, drawing):
    id = served.start(drawing, duration_s=15.0, threshold=0.75)
    worker = _worker_of(served, id)
    os.kill(worker, signal.SIGSTOP)  # perhaps with the records' lock in its hands
    until("another worker takes the job", lambda: served.job(id)["attempt"] == 2)
    until("its process is ended", lambda: not _runs(worker))
    _ended_well(served, id)


def test_a_worker_taken_for_dead_ends_itself_and_cannot_speak_twice(served, drawing):
    id = served.start(drawing, duration_s=5.0, threshold=0.75)
    worker = _worker_of(served, id)
    with closing(sqlite3.connect(served.folder / "data" / "records.sqlite", timeout=30)) as records, records:
        records.execute("UPDATE worker SET ended = ? WHERE pid = ?", (time.time(), worker))
    until("it ends itself", lambda: not _runs(worker))
    _ended_well(served, id)


def _worker_of(served: Served, id: str) -> int:
    served.running(id)
    process = int((served.folder / "ledger").read_text().splitlines()[-1].split()[2])
    return next(pid for pid in served.processes("backend.service.jobs") if process in _children(pid))


def _ended_well(served: Served, id: str) -> None:
    job = served.finished(id)
    assert (job["state"], job["attempt"]) == ("succeeded", 2)
    files = served.client.get(f"/api/v1/jobs/{id}/files").json()
    assert [file["path"] for file in files] == ["inner/motion.csv", "report.json"]


def _children(pid: int) -> list[int]:
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        found += [int(child) for child in task.read_text().split()]
    return found


def test_everything_killed_at_once_goes_on_at_the_next_start(tmp_path):
    settings = settings_in(tmp_path, workers=1)
    with serving(tmp_path, settings) as first:
        ids = [first.start(first.store(), duration_s=2.0, threshold=0.75) for _ in range(2)]
        first.running(ids[0])
        os.kill(first.supervisor.pid, signal.SIGKILL)
        first.supervisor.wait()
    with serving(tmp_path, settings) as second:
        assert [second.finished(id)["state"] for id in ids] == ["succeeded", "succeeded"]
        assert [second.ledger("end", id) for id in ids] == [1, 1]
