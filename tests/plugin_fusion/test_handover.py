"""Uploads against a server on this machine: progress, refusals, a server that is down, and stopping."""

import json
import random
import socket
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from tests.plugin_fusion.addin import room
from tests.plugin_fusion.local_service import JOB, KEY, MECHANISM, local_service
from tests.plugin_fusion.snapshots import box_mesh, fourbar

LARGE = random.Random(0).randbytes(1_000_000)  # what zip cannot make smaller
ENOUGH_S = 20.0  # for a thread that has seconds of nothing to wait for


@pytest.fixture
def saved(tmp_path):
    """An export of the four-bar on disk."""
    bundle, stl, placement = (room(f"lib.{name}") for name in ("bundle", "stl", "placement"))
    design = fourbar()
    (tmp_path / "raw" / "meshes").mkdir(parents=True)
    for part in design["components"].values():
        for body in part["bodies"]:
            stl.write(tmp_path / "raw" / body["mesh"], [(box_mesh(*body["box_cm"]), 1.0, placement.Placement())])
    bundle.save_snapshot(design, tmp_path)
    return bundle.save(tmp_path)


def handed_over(url: str, folder, key=KEY, simulate_s=0.0, stop_at: str | None = None) -> list[dict]:
    """Everything that a handover told; stopped by the user at the first message of a step."""
    told: list[dict] = []
    work = None

    def report(message: dict) -> None:
        told.append(json.loads(json.dumps(message)))  # it travels as text
        if message["step"] == stop_at and work:
            work.cancel()

    work = room("lib.handover").Handover(room("lib.service").Service(url, key), folder, report, simulate_s)
    work.start()
    work.join(ENOUGH_S)
    assert not work.is_alive()
    return told


def test_mechanism_and_meshes_arrive_and_what_fusion_said_stays_here(saved):
    with local_service() as service:
        told = handed_over(service.url, saved.folder)
        (files,) = service.folders
    assert set(files) == {"mechanism.json", *(f"meshes/{name}.stl" for name in ("Frame", "Crank", "Coupler", "Rocker"))}
    assert files["mechanism.json"] == saved.mechanism.read_bytes()
    assert told[-1]["step"] == "done"
    assert told[-1]["page"] == f"{service.url}/ui/mechanisms/{MECHANISM}"


def test_an_upload_whose_answer_was_lost_is_sent_again_under_its_key(saved, monkeypatch):
    monkeypatch.setattr(room("lib.service"), "PAUSES_S", (0.0, 0.0))
    with local_service() as service:
        service.breaks = 2
        assert handed_over(service.url, saved.folder)[-1]["step"] == "done"
        handed_over(service.url, saved.folder)
        first, *again, other = service.upload_keys
    assert first
    assert again == [first, first]
    assert other != first, "another export of the same drawing is stored by itself"


def test_the_upload_tells_its_share_from_the_first_to_the_last_byte(saved):
    (saved.folder / "meshes" / "large.stl").write_bytes(LARGE)
    with local_service() as service:
        told = handed_over(service.url, saved.folder)
    shares = [message["share"] for message in told if message["step"] == "upload"]
    assert shares == sorted(set(shares))
    assert shares[-1] == 1.0
    assert len(shares) <= 101, "a palette is not flooded"


def test_a_simulation_is_asked_for_once_and_followed(saved, monkeypatch):
    monkeypatch.setattr(room("lib.handover"), "POLL_S", 0.001)
    with local_service() as service:
        told = handed_over(service.url, saved.folder, simulate_s=2.0)
        assert service.requests == [{"kind": "simulate", "mechanism": MECHANISM, "duration_s": 2.0}]
        assert service.repeat_keys[0]
    assert [message["share"] for message in told if message["step"] == "simulate"] == [0.0, 0.5]
    steps = list(dict.fromkeys(message["step"] for message in told))
    assert steps == ["upload", "stored", "simulate", "done"], "the page can be opened before the motion is there"


def test_a_job_that_stands_still_is_not_told_again_and_again(saved, monkeypatch):
    monkeypatch.setattr(room("lib.handover"), "POLL_S", 0.001)
    with local_service() as service:
        service.parts = (0.5,) * 20 + (1.0,)
        told = handed_over(service.url, saved.folder, simulate_s=2.0)
        assert service.asked == 21
    assert sum(message["step"] == "simulate" for message in told) == 1


def test_a_simulation_that_fails_is_told_with_its_reason(saved, monkeypatch):
    monkeypatch.setattr(room("lib.handover"), "POLL_S", 0.001)
    with local_service() as service:
        service.ends = "failed"
        last = handed_over(service.url, saved.folder, simulate_s=2.0)[-1]
    assert last["step"] == "failed"
    assert "The mechanism is on the service; simulating it failed: it broke" in last["text"]


def test_stopping_ends_the_job_on_the_service_too(saved, monkeypatch):
    monkeypatch.setattr(room("lib.handover"), "POLL_S", 0.001)
    with local_service() as service:
        service.endless = True
        last = handed_over(service.url, saved.folder, simulate_s=2.0, stop_at="simulate")[-1]
        assert service.cancelled.is_set()
    assert last["step"] == "cancelled"


def test_stopping_ends_an_upload(saved):
    (saved.folder / "meshes" / "large.stl").write_bytes(LARGE)
    with local_service() as service:
        last = handed_over(service.url, saved.folder, stop_at="upload")[-1]
        assert service.folders == []
    assert last["step"] == "cancelled"
    assert str(saved.folder) in last["text"]


@pytest.mark.parametrize("key", ["", "lt_wrong"])
def test_a_refused_key_is_told_before_anything_is_sent_and_the_files_stay(saved, key):
    with local_service() as service:
        (last,) = handed_over(service.url, saved.folder, key=key)
        assert service.folders == []
    assert last["step"] == "failed"
    assert "This key is not known. Set the key in LinkTwin's settings." in last["text"]
    assert f"The files stay in {saved.folder}" in last["text"]
    assert saved.mechanism.is_file()


def test_faults_that_the_service_finds_are_told_one_by_one(saved):
    document = json.loads(saved.mechanism.read_text(encoding="utf-8"))
    document["joints"][0]["body_a"] = "nobody"
    saved.mechanism.write_text(json.dumps(document), encoding="utf-8")
    with local_service() as service:
        last = handed_over(service.url, saved.folder)[-1]
    assert last["step"] == "failed"
    assert 'body_a "nobody" is not a body' in last["text"]


def test_a_service_that_is_down_leaves_the_files_and_says_how_to_start_it(saved):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        (last,) = handed_over(f"http://127.0.0.1:{taken.getsockname()[1]}", saved.folder)
    assert last["step"] == "failed"
    assert "does not answer" in last["text"]
    assert "linktwin serve" in last["text"]
    assert saved.mechanism.is_file()


class Elsewhere(BaseHTTPRequestHandler):
    """Some other server: it sends everybody on, or answers with a page."""

    def log_message(self, format, *args):
        pass

    def do_GET(self):
        keys.append(self.headers["Authorization"])
        if self.path.startswith("/page"):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<html>hello</html>")
            return
        self.send_response(302)
        self.send_header("Location", "/page")
        self.send_header("Content-Length", "0")
        self.end_headers()


keys: list[str | None] = []


@pytest.mark.parametrize(("path", "words"), [("", "302"), ("/page", "not a LinkTwin service")])
def test_another_server_is_not_followed_and_not_taken_for_the_service(saved, path, words):
    keys.clear()
    server = HTTPServer(("127.0.0.1", 0), Elsewhere)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        last = handed_over(f"http://127.0.0.1:{server.server_address[1]}{path}", saved.folder)[-1]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert last["step"] == "failed"
    assert words in last["text"]
    assert keys == [f"Bearer {KEY}"], "a redirect would carry the key elsewhere"


def test_the_job_is_named_by_the_service():
    with local_service() as service:
        client = room("lib.service").Service(service.url, KEY)
        assert client.start_job({"kind": "simulate"}, "once")["id"] == JOB
