"""What somebody sends to break it: refused in a sentence, with bounded memory, and the service goes on."""

import errno
import io
import json
import os
import resource
import socket
import struct
import threading
import time
import zipfile
from contextlib import ExitStack
from urllib.parse import urlsplit

import httpx
import pytest

from backend.mechanism.study import ExperimentFile
from tests.service.asked import refused
from tests.service.clips import box
from tests.service.conftest import JSON, asking
from tests.service.serving import FOURBAR, events
from tests.service.test_routes import STUDY, TRACKS, store_zip, zipped

ZIP = {"content-type": "application/zip"}
MIB = 2**20


@pytest.fixture(autouse=True)
def alive_and_not_swollen(client):
    """After each attack the service answers, and this process, which holds it, has not taken much memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert client.get("/health").status_code == 200
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert grown < 256 * MIB  # the largest document taken is 16 MiB, and decoding it takes ten times that


def drawing_of(**changes) -> bytes:
    return json.dumps({**json.loads(FOURBAR.read_text()), **changes}).encode()


def packed_as(path: str, content: bytes, attributes: int = 0) -> bytes:
    """An archive with one entry under any name, and with any kind of file."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo(path)
        entry.external_attr = attributes << 16
        archive.writestr(entry, content)
        archive.writestr("mechanism.json", FOURBAR.read_bytes())
    return made.getvalue()


def test_an_archive_that_swells_is_refused_unread(client):
    bomb = zipped({"mechanism.json": FOURBAR.read_bytes(), "meshes/a.stl": b"\0" * (400 * MIB // 8)})
    assert len(bomb) < MIB
    refused(client.post("/api/v1/mechanisms", content=bomb, headers=ZIP), 413, "too-large")


def test_an_archive_that_lies_about_its_sizes_is_refused(client):
    honest = zipped({"mechanism.json": FOURBAR.read_bytes(), "meshes/a.obj": b"v 0 0 0\n" * 200_000})
    size = struct.pack("<I", 1_600_000)
    assert honest.count(size) == 2  # in the entry's own head, and in the directory
    lying = honest.replace(size, struct.pack("<I", 1000))
    assert client.post("/api/v1/mechanisms", content=lying, headers=ZIP).status_code in (413, 422)


def test_an_archive_of_too_many_files_is_refused(client):
    many = zipped({"mechanism.json": FOURBAR.read_bytes(), **{f"m/{k}.csv": b"a" for k in range(2100)}})
    refused(client.post("/api/v1/mechanisms", content=many, headers=ZIP), 413, "too-large")


def test_an_archive_that_is_all_directory_is_refused_before_it_is_read(client):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for number in range(40):
            entry = zipfile.ZipInfo(f"{number}.txt")
            entry.comment = b"-" * 60_000
            archive.writestr(entry, b"")
    answer = client.post("/api/v1/mechanisms", content=made.getvalue(), headers=ZIP)
    refused(answer, 413, "too-large")
    assert "directory has 240" in answer.json()["detail"]


@pytest.mark.parametrize(
    "path",
    ["../../etc/cron.csv", "/etc/passwd.csv", "a/../../b.csv", "..\\..\\b.csv", "C:\\b.csv", "a//b.csv", "a/./b.csv",
     "a\nb.csv", "x" * 301 + ".csv"],
)  # fmt: skip
def test_a_path_out_of_the_folder_is_refused(client, path):
    refused(client.post("/api/v1/mechanisms", content=packed_as(path, b"a"), headers=ZIP), 422, "invalid")
    # Readers of forms take a folder off a file's name, or escape it: what is left must be plain.
    part = [("files", (path, b"a")), ("files", ("mechanism.json", FOURBAR.read_bytes()))]
    answer = client.post("/api/v1/mechanisms", files=part)
    stored = {file["path"] for file in answer.json().get("files", [])}
    assert answer.status_code in (400, 422) or stored <= {"mechanism.json", "b.csv", "a%0Ab.csv"}


def test_links_encryption_strange_files_and_no_archive_at_all_are_refused(client):
    link = packed_as("mesh.stl", b"/etc/passwd", attributes=0o120777)
    refused(client.post("/api/v1/mechanisms", content=link, headers=ZIP), 422, "invalid")
    refused(client.post("/api/v1/mechanisms", content=packed_as("run.sh", b"rm"), headers=ZIP), 415, "wrong-type")
    refused(client.post("/api/v1/mechanisms", content=b"PK\x03\x04 no archive", headers=ZIP), 422, "invalid")
    refused(client.post("/api/v1/mechanisms", content=b"x", headers={"content-type": "text/plain"}), 415, "wrong-type")


@pytest.mark.parametrize(
    ("uri", "mechanism"),
    [("../../../etc/passwd", "mechanism.json"), ("/etc/passwd", "mechanism.json"), ("m.stl", "../mechanism.json"),
     ("m.stl", "/etc/passwd")],
)  # fmt: skip
def test_paths_inside_documents_do_not_lead_out_either(client, uri, mechanism):
    bodies = json.loads(FOURBAR.read_text())["bodies"]
    bodies[0]["meshes"] = [{"uri": uri, "scale_to_m": 1.0}]
    study = {**STUDY, "mechanism": mechanism}
    folder = {"mechanism.json": drawing_of(bodies=bodies), "e1.csv": TRACKS, "study.json": json.dumps(study)}
    refused(store_zip(client, "studies", folder), 422, "invalid")
    for field in set(ExperimentFile.model_fields) - {"id", "use", "release", "overrides"}:
        experiment = {"id": "e1", "release": {"time_s": 0.1}, field: "/etc/passwd"}
        folder |= {
            "mechanism.json": FOURBAR.read_bytes(),
            "study.json": json.dumps({**STUDY, "experiments": [experiment]}),
        }
        refused(store_zip(client, "studies", folder), 422, "invalid")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bomb.stl", b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50),
        ("short.stl", b"\0" * 30),
        ("bomb.ply", b"ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n"),
        ("bomb.glb", b"glTF" + struct.pack("<II", 2, 2**31)),
        ("not.obj", b"\0\1\2"),
        ("not.png", b"<svg onload=alert(1)>"),
        ("not.mp4", b"\0\0\0\x18ftypmp42" + b"\0" * 500),
    ],
)
def test_meshes_pictures_and_clips_that_claim_what_they_are_not_are_refused(client, name, content):
    folder = {"mechanism.json": FOURBAR.read_bytes(), name: content}
    refused(store_zip(client, "mechanisms", folder), 422, "invalid")


def test_a_million_joints_are_refused_before_they_are_read(client):
    joint = {"id": "j", "type": "fixed", "body_a": "a", "body_b": "b"}
    million = drawing_of(joints=[joint] * 1_000_000)
    refused(client.post("/api/v1/mechanisms", content=million, headers=JSON), 413, "too-large")
    below_the_size = drawing_of(joints=[{}] * 1_000_000)
    assert len(below_the_size) < 16 * MIB
    refused(client.post("/api/v1/mechanisms", content=below_the_size, headers=JSON), 413, "too-large")


@pytest.mark.parametrize(
    "text",
    [
        FOURBAR.read_text().replace('"mass_kg": 0.', '"mass_kg": NaN, "x": 0.', 1),
        FOURBAR.read_text().replace("-9.80665", "1e400"),
        FOURBAR.read_text().replace("-9.80665", "-Infinity"),
        FOURBAR.read_text().replace("-9.80665", "9" * 5000),
        FOURBAR.read_text().replace('"name": "fourbar"', '"name": "\\ud800"'),
        FOURBAR.read_text().replace('"name": "fourbar"', '"name": "a\\u0000b"'),
        FOURBAR.read_text().replace('"name": "fourbar"', '"name": "\\u202e\\u2066evil"'),
        "[" * 100_000,
        '{"a":' * 50_000,
        "null",
        "",
        "\ufeff",
    ],
    ids=["nan", "inf", "infinity", "digits", "surrogate", "nul", "bidi", "deep", "deeper", "null", "empty", "mark"],
)
def test_numbers_and_names_that_are_none_are_refused(client, text):
    refused(client.post("/api/v1/mechanisms", content=text.encode(), headers=JSON), 422, "invalid")


def test_text_that_is_no_utf8_is_refused(client):
    refused(client.post("/api/v1/mechanisms", content=b'{"name": "\xff\xfe"}', headers=JSON), 422, "invalid")


def test_a_job_asked_for_with_what_json_cannot_say_is_refused(client, drawing):
    id = "0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55"
    for bed in ('{"a": NaN}', '{"a": 1e999}', '{"a": "\\ud800"}', "[" * 3000 + "]" * 3000):
        text = f'{{"kind": "track", "video": "{id}", "mechanism": "{drawing}", "bed": {bed}}}'
        answer = client.post("/api/v1/jobs", content=text, headers=JSON)
        assert answer.status_code in (400, 422), answer.text
    for spec in ("--out=/etc", "a\nb", "\x00", ""):
        asked = {"kind": "fit", "study": id, "free": [spec]}
        assert client.post("/api/v1/jobs", json=asked).status_code in (404, 422)
    huge = {"kind": "track", "video": id, "mechanism": drawing, "bed": {"a": "x" * 17 * MIB}}
    refused(client.post("/api/v1/jobs", json=huge), 413, "too-large")


@pytest.mark.parametrize(
    ("content", "status", "kind"),
    [
        (b"", 415, "wrong-type"),
        (b"MZ" + b"\0" * 5000, 415, "wrong-type"),
        (b"\0\0\0\x18ftypmp42" + b"\0" * 5000, 422, "invalid"),
        (box(b"ftyp", b"isom") + box(b"mdat", b"\0" * 1000), 422, "invalid"),
        (box(b"ftyp", b"isom") + struct.pack(">I4s", 3, b"moov"), 422, "invalid"),
        (box(b"ftyp", b"isom") + struct.pack(">I4sQ", 1, b"mdat", 2**63), 422, "invalid"),
        (box(b"ftyp", b"isom") + box(b"moov", b"\0" * 1000)[:200], 422, "invalid"),
    ],
    ids=["empty", "program", "garbage", "no index", "box too short", "box too long", "index cut off"],
)
def test_a_clip_that_is_none_is_refused(client, content, status, kind):
    refused(client.put("/api/v1/videos", content=content), status, kind)


def test_a_clip_above_the_limit_is_refused_by_what_it_declares_and_by_what_comes(opened):
    _, client = opened(largest_video=MIB)
    refused(client.put("/api/v1/videos", content=b"\0" * (MIB + 1)), 413, "too-large")

    def endless():
        for _ in range(64):
            yield b"\0" * (64 * 1024)

    try:
        answer = client.put("/api/v1/videos", content=endless())
    except OSError:
        return  # the connection was closed before all was sent, which refuses it too
    refused(answer, 413, "too-large")


def test_an_upload_that_falls_silent_or_trickles_is_dropped_and_leaves_nothing(opened):
    service, client = opened(stall_s=0.5, slowest_bytes_per_s=1000.0)
    address = urlsplit(str(client.base_url))

    def send(pause_s, count):
        with socket.create_connection((address.hostname, address.port), timeout=30) as line:
            line.sendall(
                f"PUT /api/v1/videos HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: 100000\r\n\r\n".encode()
            )
            stop = threading.Event()

            def trickle():
                for _ in range(count):
                    if stop.wait(pause_s):
                        return
                    try:
                        line.sendall(b"\0" * 10)
                    except OSError:
                        return

            sending = threading.Thread(target=trickle)
            sending.start()
            answer = line.recv(65536).decode()
            stop.set()
            sending.join()
            return answer

    for answer in (send(60.0, 1), send(0.05, 1000)):
        assert answer.startswith("HTTP/1.1 408"), answer
        assert "too-slow" in answer
    assert not list(service.settings.scratch.iterdir())


def test_many_silent_uploads_do_not_keep_others_from_being_answered(client):
    address = urlsplit(str(client.base_url))
    lines = []
    try:
        for _ in range(100):
            line = socket.create_connection((address.hostname, address.port), timeout=30)
            line.sendall(
                f"PUT /api/v1/videos HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: 1000\r\n\r\n".encode()
            )
            lines.append(line)
        began = time.monotonic()
        assert client.get("/api/v1/mechanisms").status_code == 200
        assert time.monotonic() - began < 5.0
    finally:
        for line in lines:
            line.close()


WHOLE = b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@pytest.mark.parametrize(
    "sent", [b"", WHOLE[:30], WHOLE, WHOLE + b"\r\n"], ids=["nothing", "part", "whole", "and more"]
)
def test_a_connection_that_brings_no_request_is_closed(opened, sent):
    # Two thousand that are left open keep everybody else out.
    _, client = opened(stall_s=0.5)
    address = urlsplit(str(client.base_url))
    with socket.create_connection((address.hostname, address.port), timeout=20) as line:
        line.sendall(sent)
        answered = b""
        while part := line.recv(65536):
            answered += part
    assert (b"200 OK" in answered) == (WHOLE in sent)


def test_the_longest_silent_connection_gives_way_to_one_more(opened):
    service, _ = opened()
    with asking(service, most_silent=20) as client, ExitStack() as stack:
        address = urlsplit(str(client.base_url))

        def silent() -> socket.socket:
            return stack.enter_context(socket.create_connection((address.hostname, address.port), timeout=20))

        first, lines = silent(), [silent() for _ in range(30)]
        assert first.recv(1) == b""
        assert client.get("/health").status_code == 200  # and holds a connection open since
        lines[-1].sendall(WHOLE)  # the youngest were let be
        assert lines[-1].recv(100).startswith(b"HTTP/1.1 200")


def test_heads_whose_bodies_do_not_come_give_way_too(opened):
    service, _ = opened()
    announced = b"POST /api/v1/mechanisms HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    announced += b"Content-Length: 5\r\n\r\n"
    with asking(service, most_silent=20) as client, ExitStack() as stack:
        address = urlsplit(str(client.base_url))

        def waiting(begun: bytes) -> socket.socket:
            line = stack.enter_context(socket.create_connection((address.hostname, address.port), timeout=20))
            line.sendall(announced + begun)
            return line

        mute, begun = waiting(b""), waiting(b"{")
        for _ in range(19):
            waiting(b"")
        assert mute.recv(1) == b""
        begun.sendall(b"}   ")  # the last but one in coming, and heard of since
        assert begun.recv(100).startswith(b"HTTP/1.1 4")
        for _ in range(30):
            waiting(b"{")
        assert client.get("/health").status_code == 200


def test_a_stream_of_events_may_last_longer_than_a_head_may_take(opened):
    _, client = opened(stall_s=0.5)
    drawn = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()["id"]
    job = client.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": drawn}).json()["id"]
    ending = threading.Timer(1.5, lambda: httpx.delete(f"{client.base_url}/api/v1/jobs/{job}"))
    ending.start()
    assert [name for name, _ in events(client, job)][-1] == "end"
    ending.join()


def test_a_table_that_unpacks_to_a_billion_rows_is_refused(client):
    import pyarrow as pa
    import pyarrow.parquet as pq

    made = io.BytesIO()
    column = pa.array([0.0]).take(pa.array([0] * 1_000_000))
    with pq.ParquetWriter(made, pa.schema([("time_s", pa.float64())]), compression="zstd") as writer:
        for _ in range(3):
            writer.write_table(pa.table({"time_s": column}))
    assert len(made.getvalue()) < 100_000
    study = {**STUDY, "experiments": [{**STUDY["experiments"][0], "tracks": "e1.parquet"}]}
    folder = {"mechanism.json": FOURBAR.read_bytes(), "e1.parquet": made.getvalue(), "study.json": json.dumps(study)}
    refused(store_zip(client, "studies", folder), 413, "too-large")
    broken = {**folder, "e1.parquet": b"PAR1" + b"\xff" * 100 + b"PAR1"}
    refused(store_zip(client, "studies", broken), 422, "invalid")


@pytest.mark.parametrize(
    "name", ["Größe 大きさ 🦾", "<script>alert(1)</script>", "a'; DROP TABLE thing;--", "%00", "..\\.."]
)
def test_names_of_any_script_are_kept_as_data(client, name):
    stored = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON, params={"name": name})
    assert stored.status_code == 201, stored.text
    assert client.get(stored.headers["location"]).json()["name"] == name


@pytest.mark.parametrize("path", ["%00", "..%2f..%2fetc%2fpasswd", "../mechanism.json", "%ff", "a" * 500])
def test_a_files_address_leads_to_stored_files_alone(client, drawing, path):
    answer = client.get(f"/api/v1/mechanisms/{drawing}/files/{path}")
    assert answer.status_code in (404, 422), answer.text


def test_results_that_are_pages_are_kept_apart_from_the_service(client, drawing):
    answer = client.get(f"/api/v1/mechanisms/{drawing}/files/mechanism.json")
    assert "sandbox" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("where", ["storage.os.fsync", "intake.folder._write", "routes.uploads._copy"])
def test_a_full_disk_is_told_as_such_and_nothing_is_left_by_half(client, tmp_path, monkeypatch, where, error):
    def full(*given):
        raise OSError(error, os.strerror(error))

    monkeypatch.setattr(f"backend.service.{where}", full)
    if where.endswith("_copy"):
        answer = client.post("/api/v1/mechanisms", files={"files": ("mechanism.json", FOURBAR.read_bytes())})
    else:
        answer = client.post(
            "/api/v1/mechanisms", content=zipped({"mechanism.json": FOURBAR.read_bytes()}), headers=ZIP
        )
    refused(answer, 507, "storage-full")
    assert [path for path in (tmp_path / "data" / "files").rglob("*") if path.is_file()] == []
