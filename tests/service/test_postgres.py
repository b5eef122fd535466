"""The same service on PostgreSQL, told by its URL alone."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from backend.service.jobs.desk import cancel_job, delete_job, find_job, start_job
from backend.service.jobs.requests import SimulateRequest
from backend.service.keys import make_key, owner_of
from backend.service.mechanisms import store_mechanism_document
from backend.service.problems import Problem
from backend.service.records import Job
from backend.service.service import open_service
from backend.service.things import delete_thing, locked_account
from tests.service.asked import refused
from tests.service.conftest import JSON, asking
from tests.service.postgres import postgres
from tests.service.serving import FOURBAR, serving, settings_in


@pytest.fixture(scope="module")
def url():
    with postgres() as found:
        yield found


def test_many_uploads_at_once_are_counted_to_the_byte_and_never_beyond_the_quota(url, tmp_path):
    size = FOURBAR.stat().st_size
    service = open_service(settings_in(tmp_path, database_url=url, stored_bytes_per_owner=5 * size, require_keys=True))
    shown = {"Authorization": f"Bearer {make_key(service.database, 'ada')[1]}", **JSON}
    with asking(service) as client, ThreadPoolExecutor(8) as many:

        def store(_):
            return client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=shown).status_code

        codes = list(many.map(store, range(12)))
        assert sorted(codes) == [201] * 5 + [507] * 7
        listed = client.get("/api/v1/mechanisms", headers=shown).json()
        assert listed["total"] == 5
        for thing in listed["items"]:
            assert client.delete(f"/api/v1/mechanisms/{thing['id']}", headers=shown).status_code == 204
        assert store(0) == 201
        # What PostgreSQL cannot hold in text is refused, not failed at.
        refused(client.get("/api/v1/mechanisms/%00", headers=shown), 422, "invalid")
        text = FOURBAR.read_text().replace('"name": "fourbar"', '"name": "a\\u0000b"')
        refused(client.post("/api/v1/mechanisms", content=text.encode(), headers=shown), 422, "invalid")


def test_what_is_deleted_by_many_at_once_is_counted_off_once_and_needed_by_no_job(url, tmp_path):
    service = open_service(settings_in(tmp_path, database_url=url))
    owner, text = "carol", FOURBAR.read_bytes()
    kept = store_mechanism_document(service, owner, text)

    def quietly(ask, *given):
        try:
            return ask(service, owner, *given)
        except Problem as problem:
            return problem.kind

    with ThreadPoolExecutor(8) as many:
        for _ in range(5):
            thing = store_mechanism_document(service, owner, text)
            said = list(many.map(lambda _, id=thing.id: quietly(delete_thing, "mechanism", id), range(8)))
            assert sorted(said, key=str) == [None, *["not-found"] * 7]
            asked = SimulateRequest(kind="simulate", mechanism=kept.id)
            job = cancel_job(service, owner, start_job(service, owner, asked).id)
            with service.database.writing() as session:  # as if it had written something
                session.get_one(Job, job.id).bytes = 1000
                locked_account(session, owner).stored_bytes += 1000
            list(many.map(lambda _, id=job.id: quietly(delete_job, id), range(8)))
            weighed(service, owner, kept.bytes)
        for _ in range(10):
            thing = store_mechanism_document(service, owner, text)
            asked = SimulateRequest(kind="simulate", mechanism=thing.id)
            begun = many.submit(quietly, start_job, asked)
            gone = many.submit(quietly, delete_thing, "mechanism", thing.id).result()
            assert (begun.result(), gone).count("not-found") + (gone == "in-use") == 1
            if gone == "in-use":
                cancel_job(service, owner, begun.result().id)
                delete_thing(service, owner, "mechanism", thing.id)
    weighed(service, owner, kept.bytes)
    service.close()


def weighed(service, owner, size):
    with service.database.writing() as session:
        assert locked_account(session, owner).stored_bytes == size


def test_a_killed_worker_loses_no_job_on_postgresql(url, tmp_path):
    settings = settings_in(tmp_path, database_url=url, workers=1)
    with serving(tmp_path, settings) as served:
        drawing = served.store()
        brief = {"duration_s": 2.0, "threshold": 0.75}
        ids = [served.start(drawing, headers={"Idempotency-Key": f"k{k}"}, **brief) for k in range(2)]
        assert served.start(drawing, headers={"Idempotency-Key": "k0"}, **brief) == ids[0]
        served.running(ids[0])
        (worker,) = served.processes("backend.service.jobs")
        os.kill(worker, signal.SIGKILL)
        assert [served.finished(id)["state"] for id in ids] == ["succeeded", "succeeded"]
        assert [served.ledger("end", id) for id in ids] == [1, 1]
        assert served.job(ids[0])["attempt"] == 2
    service = open_service(settings)
    assert find_job(service, "local", ids[0]).kind == "simulate"
    assert owner_of(service.database, make_key(service.database, "bob")[1]) == "bob"
    service.close()
