"""The add-in's uploads against the project's own service."""

import threading

import pytest

from backend.client import Linktwin
from tests.plugin_fusion import test_handover
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.test_handover import handed_over

pytest.importorskip("backend.service.app", reason="the service is not in this checkout")
saved = test_handover.saved


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """The service's web process on a free port of this machine, asking for keys; its address and a key."""
    import uvicorn

    from backend.service.app import create_app
    from backend.service.keys import make_key
    from backend.service.service import open_service
    from backend.service.settings import Settings

    folder = tmp_path_factory.mktemp("service")
    service = open_service(Settings(data_folder=folder, require_keys=True, port=0))
    _, key = make_key(service.database, "fusion")
    server = uvicorn.Server(uvicorn.Config(create_app(service), port=0, log_config=None))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        thread.join(0.01)
        assert thread.is_alive()
    (port,) = [socket.getsockname()[1] for one in server.servers for socket in one.sockets]
    yield f"http://127.0.0.1:{port}", key
    server.should_exit = True
    thread.join()
    service.close()


def test_the_service_takes_an_export_with_all_its_meshes(running, saved):
    url, key = running
    last = handed_over(url, saved.folder, key=key)[-1]
    assert last["step"] == "done"
    with Linktwin(url, key) as there:
        stored = there.thing("mechanism", last["page"].rpartition("/")[2])
        assert last["page"] == there.page(stored)
    assert (stored.summary["bodies"], stored.summary["joints"]) == (4, 4)
    assert stored.summary["missing_meshes"] == []
    assert len(stored.files or []) == 5


def test_the_addin_and_the_client_ask_for_the_same_simulation(running, saved):
    url, key = running
    with Linktwin(url, key) as there:
        thing = there.store_mechanism(saved.folder)
        asked = {"kind": "simulate", "mechanism": thing.id, "duration_s": 2.0}
        job = there.job(room("lib.service").Service(url, key).start_job(asked, "the-same")["id"])
        assert there.simulate(thing, duration_s=2.0, repeat_key="the-same") == job


def test_the_service_refuses_a_wrong_key_in_words_that_the_palette_shows(running, saved):
    (last,) = handed_over(running[0], saved.folder, key="lt_wrong")
    assert last["step"] == "failed"
    assert "Set the key in LinkTwin's settings." in last["text"]
