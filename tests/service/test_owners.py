"""One owner's things are nobody else's; keys, quotas and limits hold."""

import json
import sys

import pytest

from backend.service.gate import Gate
from backend.service.keys import list_keys, make_key, revoke_key
from backend.service.records import ApiKey
from backend.service.states import FINISHED
from tests.service.asked import refused
from tests.service.conftest import JSON
from tests.service.serving import FOURBAR, events, serving, settings_in


def key_of(service, owner):
    return {"Authorization": f"Bearer {make_key(service.database, owner)[1]}"}


def test_a_public_service_answers_nobody_without_a_key(opened):
    service, client = opened(host="0.0.0.0")
    assert service.settings.keys_required
    document = refused(client.get("/api/v1/jobs"), 401, "no-key")
    assert "linktwin key new" in document["detail"]
    refused(client.get("/api/v1/jobs", headers={"Authorization": "Bearer lt_guessed"}), 401, "no-key")
    refused(client.get("/api/v1/jobs", headers={"Authorization": "Basic abc"}), 401, "no-key")
    assert client.get("/api/v1/jobs", headers=key_of(service, "ada")).status_code == 200


def test_a_key_is_kept_as_a_digest_and_a_revoked_one_opens_nothing(opened):
    service, client = opened(require_keys=True)
    key, text = make_key(service.database, "ada")
    assert text not in json.dumps(ApiKey.model_dump(list_keys(service.database)[0]))
    shown = {"Authorization": f"Bearer {text}"}
    assert client.get("/api/v1/jobs", headers=shown).status_code == 200
    revoke_key(service.database, key.id)
    refused(client.get("/api/v1/jobs", headers=shown), 401, "no-key")


def test_what_is_one_owners_does_not_exist_for_another(opened):
    service, client = opened(require_keys=True)
    ada, bob = key_of(service, "ada"), key_of(service, "bob")
    thing = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers={**ada, **JSON}).json()["id"]
    asked = {"kind": "simulate", "mechanism": thing}
    job = client.post("/api/v1/jobs", json=asked, headers={**ada, "Idempotency-Key": "k"}).json()["id"]
    for path in (f"mechanisms/{thing}", f"mechanisms/{thing}/files/mechanism.json", f"jobs/{job}", f"jobs/{job}/events",
                 f"jobs/{job}/result", f"jobs/{job}/files", f"jobs/{job}/files/report.json"):  # fmt: skip
        refused(client.get(f"/api/v1/{path}", headers=bob), 404, "not-found")
    for path in (f"mechanisms/{thing}", f"jobs/{job}"):
        refused(client.delete(f"/api/v1/{path}", headers=bob), 404, "not-found")
    refused(client.post("/api/v1/jobs", json=asked, headers=bob), 404, "not-found")
    experiment = {"id": "e", "tracks": f"jobs/{job}/files/report.json", "release": {"time_s": 0}}
    study = {"schema_version": "1.0", "mechanism": f"mechanisms/{thing}", "experiments": [experiment]}
    refused(client.post("/api/v1/studies", json=study, headers=bob), 404, "not-found")
    assert client.get("/api/v1/mechanisms", headers=bob).json()["total"] == 0
    assert client.get("/api/v1/jobs", headers=bob).json()["total"] == 0
    # The same Idempotency-Key of another owner is another key.
    mine = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers={**bob, **JSON}).json()["id"]
    other = client.post(
        "/api/v1/jobs", json={"kind": "simulate", "mechanism": mine}, headers={**bob, "Idempotency-Key": "k"}
    )
    assert other.json()["id"] != job
    assert client.get(f"/api/v1/jobs/{job}", headers=ada).json()["state"] not in FINISHED


def test_two_keys_of_one_owner_open_the_same_things(opened):
    service, client = opened(require_keys=True)
    stored = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers={**key_of(service, "ada"), **JSON})
    assert client.get(stored.headers["location"], headers=key_of(service, "ada")).status_code == 200


def test_storage_granted_is_not_exceeded_and_comes_back_by_deleting(opened):
    size = FOURBAR.stat().st_size
    _, client = opened(stored_bytes_per_owner=2 * size)

    def store():
        return client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON)

    first = store()
    assert store().status_code == 201
    document = refused(store(), 507, "storage-full")
    assert str(2 * size) in document["detail"]
    client.delete(first.headers["location"])
    assert store().status_code == 201


def test_more_jobs_than_are_granted_wait_for_others_to_end(opened):
    _, client = opened(active_jobs_per_owner=2)
    drawn = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()["id"]
    asked = {"kind": "simulate", "mechanism": drawn}
    jobs = [client.post("/api/v1/jobs", json=asked).json()["id"] for _ in range(2)]
    answer = client.post("/api/v1/jobs", json=asked)
    refused(answer, 429, "too-many-jobs")
    assert int(answer.headers["retry-after"]) > 0
    client.delete(f"/api/v1/jobs/{jobs[0]}")
    assert client.post("/api/v1/jobs", json=asked).status_code == 202


def test_who_asks_too_often_is_told_when_to_come_back(opened):
    _, client = opened(requests_per_minute=1, request_burst=5)
    answers = [client.get("/api/v1/jobs") for _ in range(7)]
    assert [answer.status_code for answer in answers[:5]] == [200] * 5
    refused(answers[-1], 429, "too-often")
    assert int(answers[-1].headers["retry-after"]) >= 1


def test_views_are_counted_by_address_and_what_they_are_made_of_is_not(tmp_path):
    with serving(tmp_path, settings_in(tmp_path, workers=0, requests_per_minute=6, request_burst=5)) as served:
        views = [served.client.get(f"/ui/{at}") for at in ("", "work", "nowhere", "", "mechanisms/x", "", "nowhere")]
        assert [view.status_code for view in views[:5]] == [200] * 5
        assert [view.status_code for view in views[5:]] == [429] * 2
        assert int(views[-1].headers["retry-after"]) >= 1
        assert "try again in" in views[-1].text
        parts = [served.client.get("/ui/favicon.ico") for _ in range(7)]
        assert [(part.status_code, part.headers["content-type"]) for part in parts] == [(200, "image/svg+xml")] * 7
        assert served.client.get("/api/v1/jobs").status_code == 200  # which is counted by itself


def test_a_key_is_one_asker_however_it_is_written_and_invented_keys_are_counted_together(opened):
    service, client = opened(requests_per_minute=1, request_burst=5)
    key = make_key(service.database, "ada")[1]
    ways = [f"Bearer {key}", f"bearer {key}", f"BEARER {key}", f"Bearer   {key}"]
    answers = [client.get("/api/v1/jobs", headers={"Authorization": way}).status_code for way in 2 * ways]
    assert answers[:5] == [200] * 5
    assert answers[-1] == 429
    spent = make_key(service.database, "bob")[1]
    assert client.get("/api/v1/jobs", headers={"Authorization": f"Bearer {spent}"}).status_code == 200
    for at in range(60):  # a new key each time, on an address that names no owner too
        path = "jobs" if at % 2 else "openapi.json"
        answer = client.get(f"/api/v1/{path}", headers={"Authorization": f"Bearer invented{at}"})
    refused(answer, 429, "too-often")
    assert client.get("/api/v1/jobs", headers={"Authorization": f"Bearer {spent}"}).status_code == 200


def test_a_stream_of_events_ends_when_its_key_is_revoked(opened, monkeypatch):
    monkeypatch.setattr("backend.service.jobs.desk.MAY_EVERY_S", 0.5)
    service, client = opened(require_keys=True)
    key, text = make_key(service.database, "ada")
    client.headers["Authorization"] = f"Bearer {text}"
    drawn = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()["id"]
    job = client.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": drawn}).json()["id"]
    stream = events(client, job)
    assert next(stream)[0] == "progress"
    revoke_key(service.database, key.id)
    assert list(stream) == []  # the job waits on, and is watched by nobody


@pytest.mark.parametrize(
    ("path", "largest"),
    [("/api/v1/jobs", 2**20), ("/ui/sign-in", 2**20), ("/ui/_nicegui/client/a/upload/7", 2**32)],
)
def test_a_body_is_as_large_as_its_address_needs(tmp_path, path, largest):
    assert Gate(None, settings_in(tmp_path))._largest({"path": path}) == largest


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", ""])
def test_without_keys_the_service_answers_to_its_own_names_alone(client, host):
    refused(client.get("/api/v1/jobs", headers={"Host": host}), 421, "misdirected")


def test_a_page_of_another_site_may_write_nothing_and_no_answer_is_shared_with_it(client, drawing):
    foreign = {"Origin": "https://evil.example"}
    refused(
        client.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": drawing}, headers=foreign),
        403,
        "foreign-origin",
    )
    refused(client.delete(f"/api/v1/mechanisms/{drawing}", headers=foreign), 403, "foreign-origin")
    assert not any(name.startswith("access-control") for name in client.get("/api/v1/jobs", headers=foreign).headers)


@pytest.mark.parametrize(
    ("variables", "says"),
    [
        ({}, "linktwin key new"),
        ({"LINKTWIN_REQUIRE_KEYS": "false"}, "holds on loopback alone"),
        ({"LINKTWIN_STORAGE_URL": "nowhere://bucket"}, "storage nowhere:// cannot be opened"),
    ],
    ids=["no key", "keys switched off", "no such storage"],
)
def test_serving_in_public_without_a_key_or_on_no_storage_is_refused_in_a_sentence(tmp_path, variables, says):
    import os
    import subprocess

    code = "from backend.cli import main; main()"
    command = [sys.executable, "-c", code, "serve", "--host", "0.0.0.0", "--port", "0", "--data", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env={**os.environ, **variables})
    assert done.returncode == 2
    assert says in done.stderr
    assert "Traceback" not in done.stderr
