"""The routes as their users meet them: stored things come back, every failure is a problem document."""

import gzip
import io
import json
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest
from pydantic import TypeAdapter

from backend.service.jobs.requests import JobRequest
from backend.service.routes.jobs import MARKS
from tests.service.asked import refused
from tests.service.clips import clip
from tests.service.conftest import JSON
from tests.service.serving import FOURBAR, ROOT

STL = b"solid a\nfacet normal 0 0 1\nendsolid a\n"
TRACKS = "time_s,marker,x_m,y_m,z_m,sigma_m\n" + "".join(f"{0.01 * k},B,0.1,0.0,0.0,\n" for k in range(30))
STUDY = {
    "schema_version": "1.0",
    "mechanism": "mechanism.json",
    "experiments": [{"id": "e1", "tracks": "e1.csv", "release": {"time_s": 0.1}}],
}


def zipped(files: dict[str, bytes | str]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            archive.writestr(path, content)
    return packed.getvalue()


def store_zip(client, room, files):
    return client.post(f"/api/v1/{room}", content=zipped(files), headers={"content-type": "application/zip"})


def test_a_mechanism_comes_back_byte_for_byte_with_its_meshes(client):
    files = {"fourbar/mechanism.json": FOURBAR.read_bytes(), "fourbar/meshes/crank.stl": STL}
    stored = store_zip(client, "mechanisms", files)
    assert stored.status_code == 201, stored.text
    told = client.get(stored.headers["location"]).json()
    assert {file["path"] for file in told["files"]} == {"mechanism.json", "meshes/crank.stl"}
    assert "meshes/crank.stl" not in told["summary"]["missing_meshes"]
    for file in told["files"]:
        assert client.get(file["url"]).content == files[f"fourbar/{file['path']}"]


def test_a_folder_may_come_as_parts_of_a_form(client):
    parts = [("files", ("mechanism.json", FOURBAR.read_bytes())), ("files", ("meshes/crank.stl", STL))]
    stored = client.post("/api/v1/mechanisms", files=parts, params={"name": "Hebel ü"})
    assert stored.status_code == 201, stored.text
    assert stored.json()["name"] == "Hebel ü"
    assert len(stored.json()["files"]) == 2


def test_a_study_comes_as_a_folder_or_is_made_of_what_is_stored(client, drawing):
    folder = {"mechanism.json": FOURBAR.read_bytes(), "e1.csv": TRACKS, "study.json": json.dumps(STUDY)}
    stored = store_zip(client, "studies", folder)
    assert stored.status_code == 201, stored.text
    first = stored.json()
    assert first["summary"]["experiments"] == [{"id": "e1", "use": "fit"}]
    experiment = {**STUDY["experiments"][0], "tracks": f"studies/{first['id']}/files/e1.csv"}
    composed = {**STUDY, "mechanism": f"mechanisms/{drawing}", "experiments": [experiment]}
    stored = client.post("/api/v1/studies", json=composed)
    assert stored.status_code == 201, stored.text
    paths = {file["path"] for file in stored.json()["files"]}
    assert paths == {"study.json", "mechanism.json", "experiment_1_tracks.csv"}


def test_a_faulty_drawing_is_refused_with_every_fault_and_its_remedy(client):
    text = (
        FOURBAR.read_text()
        .replace('"mass_kg": ', '"mass_kg": -')
        .replace('"schema_version": "1.0"', '"schema_version": "1.0", "colour": 1')
    )
    document = refused(client.post("/api/v1/mechanisms", content=text, headers=JSON), 422, "invalid")
    assert any("colour" in fault for fault in document["errors"])
    assert any("mass_kg" in fault and "crank" in fault for fault in document["errors"])


def test_a_table_that_names_an_unknown_marker_is_refused_with_its_row(client):
    folder = {
        "mechanism.json": FOURBAR.read_bytes(),
        "e1.csv": TRACKS.replace(",B,", ",Q,"),
        "study.json": json.dumps(STUDY),
    }
    document = refused(store_zip(client, "studies", folder), 422, "invalid")
    assert any("e1.csv" in fault and "row 2" in fault and '"Q"' in fault for fault in document["errors"])
    assert "/tmp" not in json.dumps(document)


def test_an_upload_under_the_same_key_is_stored_once(opened):
    service, client = opened(stored_bytes_per_owner=20_000)
    key, drawing = (
        {"idempotency-key": "k"},
        {"fourbar/mechanism.json": FOURBAR.read_bytes(), "fourbar/meshes/crank.stl": STL},
    )
    zip_kind = {"content-type": "application/zip", **key}

    packed = zipped(drawing)

    def send(content=packed, headers=zip_kind, **more):
        return client.post("/api/v1/mechanisms", content=content, headers=headers, **more)

    with ThreadPoolExecutor() as several:  # a client asks again while its first request is still at work
        answers = [one.result() for one in [several.submit(send) for _ in range(4)]]
    assert {answer.status_code for answer in answers} == {201}
    assert len({answer.headers["location"] for answer in answers}) == 1
    assert client.get("/api/v1/mechanisms").json()["total"] == 1
    assert len(list(service.storage.written())) == 2  # nothing is left of the repeated ones
    parts = [("files", ("mechanism.json", FOURBAR.read_bytes())), ("files", ("meshes/crank.stl", STL))]
    assert client.post("/api/v1/mechanisms", files=parts, headers=key).json() == answers[0].json()  # the same folder
    for other in (
        send(FOURBAR.read_bytes(), {**JSON, **key}),
        send(params={"name": "another"}),
        client.put("/api/v1/videos", content=clip(), headers=key),
        client.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": answers[0].json()["id"]}, headers=key),
    ):
        refused(other, 422, "key-reused")
    assert len(list(service.storage.written())) == 2
    big = client.put("/api/v1/videos", content=clip(8000), headers={"idempotency-key": "v"})
    assert big.status_code == 201, big.text
    refused(client.put("/api/v1/videos", content=clip(8000)), 507, "storage-full")
    again = client.put("/api/v1/videos", content=clip(8000), headers={"idempotency-key": "v"})
    assert again.json() == big.json()  # it takes no more room
    client.delete(big.headers["location"])
    anew = client.put("/api/v1/videos", content=clip(8000), headers={"idempotency-key": "v"})
    assert (anew.status_code, anew.json()["id"] == big.json()["id"]) == (201, False)


def test_lists_come_in_slices_newest_first(client):
    ids = [
        client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON, params={"name": f"n{k}"}).json()[
            "id"
        ]
        for k in range(5)
    ]
    seen, path = [], "/api/v1/mechanisms?limit=2"
    while path:
        part = client.get(path).json()
        assert part["total"] == 5
        seen += [thing["id"] for thing in part["items"]]
        path = part["next"]
    assert seen == ids[::-1]


def test_a_list_of_jobs_in_one_state_goes_on_in_that_state(client, drawing):
    asked = {"kind": "simulate", "mechanism": drawing}
    ids = [client.post("/api/v1/jobs", json=asked).json()["id"] for _ in range(4)]
    client.delete(f"/api/v1/jobs/{ids[1]}")
    seen, path = [], "/api/v1/jobs?state=queued&limit=2"
    while path:
        part = client.get(path).json()
        seen += [job["id"] for job in part["items"]]
        path = part["next"]
    assert seen == [ids[3], ids[2], ids[0]]


def test_what_an_unfinished_job_needs_is_kept_and_what_is_deleted_is_gone(client, drawing):
    asked = {"kind": "simulate", "mechanism": drawing}
    job = client.post("/api/v1/jobs", json=asked).json()["id"]
    refused(client.delete(f"/api/v1/mechanisms/{drawing}"), 409, "in-use")
    refused(client.get(f"/api/v1/jobs/{job}/result"), 409, "not-finished")
    assert client.delete(f"/api/v1/jobs/{job}").json()["state"] == "cancelled"
    assert client.delete(f"/api/v1/jobs/{job}", params={"forget": True}).status_code == 200
    refused(client.get(f"/api/v1/jobs/{job}"), 404, "not-found")
    assert client.delete(f"/api/v1/mechanisms/{drawing}").status_code == 204
    refused(client.get(f"/api/v1/mechanisms/{drawing}"), 404, "not-found")
    refused(client.post("/api/v1/jobs", json=asked), 404, "not-found")


@pytest.mark.parametrize(
    ("method", "path", "status", "kind"),
    [
        ("GET", "/api/v1/nowhere", 404, "not-found"),
        ("GET", "/nowhere", 404, "not-found"),
        ("PATCH", "/api/v1/jobs", 405, "wrong-method"),
        ("GET", "/api/v1/jobs/not-a-uuid", 422, "invalid"),
        ("GET", "/api/v1/jobs?limit=0", 422, "invalid"),
        ("GET", "/api/v1/jobs/0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55/events", 404, "not-found"),
    ],
)
def test_every_failure_is_a_problem_document(client, method, path, status, kind):
    document = refused(client.request(method, path), status, kind)
    assert document["instance"] == path.partition("?")[0]


def test_a_job_that_is_asked_for_wrongly_is_refused_with_the_field(client, drawing):
    for wrong, field in [
        ({"kind": "dance"}, "kind"),
        ({"kind": "simulate", "mechanism": drawing, "duration_s": -1}, "duration_s"),
        ({"kind": "simulate", "mechanism": drawing, "speed": 3}, "speed"),
        ({"kind": "fit", "study": drawing, "free": []}, "free"),
        ({"kind": "jam"}, "either a mechanism or a study"),
        ({"kind": "simulate", "mechanism": drawing, "duration_s": 3600, "step_s": 1e-6}, "steps"),
    ]:
        document = refused(client.post("/api/v1/jobs", json=wrong), 422, "invalid")
        assert any(field in fault for fault in document["errors"]), document
    refused(client.post("/api/v1/jobs", content="{", headers=JSON), 400, "malformed")


def test_a_body_that_is_sent_as_something_else_is_refused_with_what_to_send(client, drawing):
    job = json.dumps({"kind": "simulate", "mechanism": drawing})
    for kind in ("application/x-www-form-urlencoded", "text/plain", ""):  # the first is what curl -d says
        document = refused(client.post("/api/v1/jobs", content=job, headers={"content-type": kind}), 415, "wrong-type")
        assert "application/json" in document["detail"]
    assert client.post(
        "/api/v1/jobs", content=job, headers={"content-type": "application/json; charset=utf-8"}
    ).is_success
    document = refused(client.put("/api/v1/videos", files={"file": b"\0" * 100}), 415, "wrong-type")
    assert "curl -T" in document["detail"]
    packed = {**JSON, "content-encoding": "gzip"}
    for room in ("mechanisms", "studies"):
        refused(client.post(f"/api/v1/{room}", content=gzip.compress(b"{}"), headers=packed), 415, "wrong-type")
    document = refused(client.post("/api/v1/jobs", content=gzip.compress(b"{}"), headers=packed), 400, "malformed")
    assert "not packed" in document["detail"]
    refused(client.put("/api/v1/videos", content=gzip.compress(b"{}"), headers=packed), 415, "wrong-type")
    no_form = {"content-type": "multipart/form-data"}
    document = refused(client.post("/api/v1/mechanisms", content=b"{}", headers=no_form), 400, "malformed")
    assert ".." not in document["detail"]


@pytest.mark.parametrize(
    ("top", "mechanism", "says"),
    [
        ("", "../mechanism.json", "names ../mechanism.json, outside its folder"),
        ("measured/", "../mechanism.json", "only measured/study.json"),
        ("", "drawing.json", "names drawing.json, not among the files sent"),
    ],
)
def test_a_study_whose_files_lie_elsewhere_is_refused_with_where_to_put_them(client, top, mechanism, says):
    folder = {"mechanism.json": FOURBAR.read_bytes(), f"{top}e1.csv": TRACKS}
    folder[f"{top}study.json"] = json.dumps({**STUDY, "mechanism": mechanism})
    assert says in refused(store_zip(client, "studies", folder), 422, "invalid")["detail"]


def test_a_study_made_of_what_is_stored_takes_the_camera_along(client, drawing):
    camera = json.dumps({"any": "camera"})
    folder = {"mechanism.json": FOURBAR.read_bytes(), "e1.csv": TRACKS, "camera.json": camera}
    folder["study.json"] = json.dumps(STUDY)
    first = store_zip(client, "studies", folder).json()["id"]
    there = {
        field: f"studies/{first}/files/{name}" for field, name in (("tracks", "e1.csv"), ("camera", "camera.json"))
    }
    composed = {**STUDY, "mechanism": f"mechanisms/{drawing}", "experiments": [{**STUDY["experiments"][0], **there}]}
    stored = client.post("/api/v1/studies", json=composed)
    assert stored.status_code == 201, stored.text
    files = {file["path"]: file["url"] for file in stored.json()["files"]}
    assert client.get(files["experiment_1_camera.json"]).text == camera
    (experiment,) = client.get(files["study.json"]).json()["experiments"]
    assert experiment["camera"] == "experiment_1_camera.json"


def test_health_tells_of_workers_and_jobs(client, drawing):
    assert client.get("/health").json() == {"status": "ok", "workers": 0, "waiting": 0, "running": 0}
    client.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": drawing})
    assert client.get("/health").json()["waiting"] == 1


def test_the_schema_is_openapi_3_1_with_examples(client):
    schema = client.get("/api/v1/openapi.json").json()
    assert schema["openapi"].startswith("3.1")
    body = schema["paths"]["/api/v1/jobs"]["post"]["requestBody"]["content"]["application/json"]
    assert set(body["examples"]) >= {"simulate", "jam", "fit", "diagnose", "track"}
    for example in body["examples"].values():
        TypeAdapter(JobRequest).validate_python(example["value"])
    for path, methods in schema["paths"].items():
        for method, told in methods.items():
            codes = set(told["responses"])
            assert {"401", "422", "429"} <= codes, (path, method)
            if taken := codes & {"201", "202"}:
                assert all("Location" in told["responses"][code]["headers"] for code in taken), (path, method)


def test_the_web_process_loads_no_solver_no_vision_no_cad_and_no_queue():
    code = (
        "import sys, backend.service.web\n"
        "heavy = {'jax', 'equinox', 'cv2', 'av', 'cadquery', 'trimesh', 'dbos', 'pandas'}\n"
        "print(*heavy & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


STICK = {"stick": {"a_px": [20, 300], "b_px": [620, 300], "length_m": 0.94}}


def test_a_clip_is_tracked_with_all_that_the_command_takes(client, drawing):
    video = client.put("/api/v1/videos", content=clip()).json()["id"]
    markers = client.get(f"/api/v1/mechanisms/{drawing}").json()["summary"]["markers"]
    asked = {
        "kind": "track",
        "video": video,
        "mechanism": drawing,
        "bed": STICK,
        "from_s": 1.5,
        "to_s": 4,
        "filmed_per_s": 240,
    }
    for way in ("dark", "patch", "texture", "texture:40"):
        answer = client.post("/api/v1/jobs", json={**asked, "targets": dict.fromkeys(markers, way)})
        assert answer.status_code == 202, answer.text
        assert answer.json()["request"]["bed"] == STICK
    tags = {marker: number for number, marker in enumerate(markers)}
    assert client.post("/api/v1/jobs", json={**asked, "bed": MARKS, "targets": tags}).status_code == 202
    for wrong, says in [
        ({"bed": []}, "0 bed marks are given"),
        ({"bed": {"marks": MARKS, **STICK}}, "a stick stands in for marks"),
        ({"bed": {"stick": {**STICK["stick"], "length_m": -1}}}, "stick.length_m"),
        ({"bed": {**STICK, "colour": 1}}, "colour"),
        ({"bed": {"marks": MARKS, "camera": "/etc/passwd"}}, "give what stands in it"),
        ({"bed": [{**mark, "x_m": 1.7e308 * (1 + mark["y_m"] / 20)} for mark in MARKS]}, "cannot be reckoned with"),
        ({"bed": [{**MARKS[0], "id": str(k)} for k in range(1001)]}, "1001 marks are above 1000"),
        ({"targets": dict.fromkeys(markers, "dotted")}, "targets"),
        ({"targets": dict.fromkeys(markers, "texture:2")}, "5 pixels or more"),
        ({"targets": dict.fromkeys(markers, f"texture:{10**30}")}, "at most 10000"),
        ({"targets": {f"{k}" * 300: 3 for k in range(1000)}}, "the same tag"),
        ({"targets": {markers[0]: "dark", markers[1]: 3}}, "measured in one way"),
        ({"targets": dict.fromkeys(markers, 3)}, "the same tag"),
        ({"targets": {markers[0]: True}}, "targets"),
        ({"targets": dict.fromkeys(markers[1:], "dark")}, markers[0]),
        ({"clicks": {"nobody": [1, 2]}}, "Clicks name nobody"),
        ({"from_s": -1}, "from_s"),
        ({"from_s": 4.0}, "not before to_s"),
        ({"filmed_per_s": 0}, "filmed_per_s"),
    ]:
        document = refused(client.post("/api/v1/jobs", json={**asked, **wrong}), 422, "invalid")
        assert says in " ".join([document["detail"], *document.get("errors", [])]), document
        assert len(json.dumps(document)) < 10_000  # whatever was sent


def test_clicks_may_be_left_empty_and_are_counted(client, drawing):
    nobody = "0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55"
    asked = {"kind": "track", "video": nobody, "mechanism": drawing, "bed": MARKS, "clicks": None}
    assert client.post("/api/v1/jobs", json=asked).status_code == 404  # no such clip; the request itself is sound
    many = {f"m{k}": (1.0, 2.0) for k in range(1001)}
    assert client.post("/api/v1/jobs", json={**asked, "clicks": many}).status_code == 422


@pytest.mark.parametrize("url", [None, "memory://linktwin-parts"], ids=["folder", "object store"])
def test_a_file_comes_in_the_part_that_is_asked_for(opened, url):
    _, client = opened(storage_url=url)
    film = clip(3 * 2**20)
    stored = client.put("/api/v1/videos", content=film).json()["files"][0]
    whole = client.get(stored["url"])
    assert (whole.status_code, whole.content, whole.headers["accept-ranges"]) == (200, film, "bytes")
    size, etag = len(film), whole.headers["etag"]

    def part(asked, **more):
        answer = client.get(stored["url"], headers={"Range": asked, **more})
        return answer.status_code, answer.headers.get("content-range"), answer.content

    assert part("bytes=0-0") == (206, f"bytes 0-0/{size}", film[:1])
    assert part("Bytes=1048570-2097160") == (206, f"bytes 1048570-2097160/{size}", film[1048570:2097161])
    assert part("bytes=3145000-") == (206, f"bytes 3145000-{size - 1}/{size}", film[3145000:])
    assert part("bytes=-7") == (206, f"bytes {size - 7}-{size - 1}/{size}", film[-7:])
    assert part(f"bytes=-{9 * size}") == (206, f"bytes 0-{size - 1}/{size}", film)
    assert part(f"bytes=5-{9 * size}", **{"If-Range": etag}) == (206, f"bytes 5-{size - 1}/{size}", film[5:])
    for ignored in ("bytes=0-1,5-6", "bytes=9-3", "bytes=-", "lines=0-1", "bytes=x-", "bytes=0-" + "9" * 40, ""):
        assert part(ignored) == (200, None, film), ignored
    assert part("bytes=0-1", **{"If-Range": '"another"'}) == (200, None, film)
    for none in (f"bytes={size}-", "bytes=-0"):
        refusal = client.get(stored["url"], headers={"Range": none})
        refused(refusal, 416, "no-such-part")
        assert refusal.headers["content-range"] == f"bytes */{size}"


def test_a_storage_that_is_away_is_said_to_be_and_keeps_nothing_from_being_deleted(opened, monkeypatch):
    service, client = opened(storage_url="memory://linktwin-away")
    drawing = client.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()

    def away(*given, **more):
        raise RuntimeError("whatever a store's library raises")

    for name in ("open", "cat_file", "rm_file"):
        monkeypatch.setattr(service.storage.files, name, away)
    refused(client.get(drawing["files"][0]["url"]), 503, "unavailable")
    refused(client.put("/api/v1/videos", content=clip()), 503, "unavailable")
    assert client.delete(f"/api/v1/mechanisms/{drawing['id']}").status_code == 204
    assert client.get("/api/v1/mechanisms").json()["total"] == 0
