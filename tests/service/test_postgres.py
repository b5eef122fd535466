"""The same service on PostgreSQL, told by its URL alone."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from backend.service.jobs.desk import find_job
from backend.service.keys import make_key, owner_of
from backend.service.service import open_service
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


def test_a_killed_worker_loses_no_job_on_postgresql(url, tmp_path):
    settings = settings_in(tmp_path, database_url=url, workers=1)
    with serving(tmp_path, settings) as served:
        drawing = served.store()
        ids = [served.start(drawing, duration_s=2.0, headers={"Idempotency-Key": f"k{k}"}) for k in range(2)]
        assert served.start(drawing, duration_s=2.0, headers={"Idempotency-Key": "k0"}) == ids[0]
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
