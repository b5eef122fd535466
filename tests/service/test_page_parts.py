"""Parts of the page that need no browser: releases read off tables, links that cannot be forged, planes of motion."""

import asyncio
import errno
import json
import os
import sys
from contextlib import nullcontext
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import httpx
import numpy as np
import pytest
import trimesh
from fastapi import FastAPI

from backend.mechanism.read import parse_mechanism, read_mechanism
from backend.observe.camera import Camera, Deviations, write_camera
from backend.service.jobs.desk import start_job
from backend.service.jobs.requests import FitRequest
from backend.service.page import results, running
from backend.service.page.access import share_token, shared_job
from backend.service.page.bed_file import known
from backend.service.page.clip_view import PLANES, STICK, asked_for, ready, sentences
from backend.service.page.compose_view import _tracked
from backend.service.page.files import add_files
from backend.service.page.marked_before import marked_before
from backend.service.page.runs import kind_of, released
from backend.service.page.stage import on_stage, plane_of_motion
from backend.service.page.study_view import _request
from backend.service.page.upload import told
from backend.service.problems import Problem
from backend.service.records import Job
from backend.service.service import LOCAL, open_service
from backend.service.studies import store_study
from backend.service.things import files_of, stored
from tests.service.serving import FOURBAR, settings_in
from tests.service.test_routes import STUDY, TRACKS

SAMPLES = Path(__file__).parents[2] / "samples"
MEASURED = SAMPLES / "pendulum" / "measured"


@pytest.mark.parametrize("run", ["low", "middle", "high", "far"])
def test_the_release_is_read_off_the_first_motion(run):
    found = released(MEASURED / f"{run}.csv", "tracks")
    assert found == pytest.approx(0.25, abs=0.05)  # three frames of 60 a second: the first way hides in the noise


def test_a_run_that_starts_in_motion_has_no_release(tmp_path):
    t = np.arange(60) / 60.0
    rows = [f"{at:.6f},tip,{np.sin(3 * at):.6f},0,0" for at in t]
    (tmp_path / "moving.csv").write_text("time_s,marker,x_m,y_m,z_m\n" + "\n".join(rows))
    assert released(tmp_path / "moving.csv", "tracks") is None


def test_a_table_of_another_kind_is_refused_with_what_is_taken(tmp_path):
    (tmp_path / "odd.csv").write_text("frame,left,right\n1,2,3\n")
    with pytest.raises(Problem, match=r"frame, left, right.*linktwin convert"):
        kind_of(tmp_path / "odd.csv", "odd.csv")


def test_a_table_that_is_none_is_refused_and_measured_by_nobody(tmp_path):
    wide = "x" * 200_000
    (tmp_path / "wide.csv").write_text(wide)
    with pytest.raises(Problem, match=r"wide\.csv is no table .*131072"):
        kind_of(tmp_path / "wide.csv", "wide.csv")
    (tmp_path / "later.csv").write_text(f"time_s,marker,x_m,y_m,z_m\n0,tip,0,0,0\n0.1,{wide},0,0,0\n")
    assert released(tmp_path / "later.csv", "tracks") is None
    assert told(OSError(errno.ENOSPC, "full")).kind == "storage-full"
    assert told(KeyError("what")).kind == "internal"


def test_a_shared_link_opens_its_own_result_alone(tmp_path):
    settings = settings_in(tmp_path)
    settings.data_folder.mkdir()
    service = open_service(settings)
    try:
        with service.database.writing() as session:
            jobs = [Job(owner="someone", kind="fit", request={}) for _ in range(2)]
            session.add_all(jobs)
            ids = [job.id for job in jobs]
        token = share_token(service, ids[0])
        assert shared_job(service, ids[0], token).id == ids[0]
        for id, forged in ((ids[1], token), (ids[0], token[:-1]), (ids[0], ""), (ids[0], "é" * 32)):
            with pytest.raises(Problem, match="cut short"):
                shared_job(service, id, forged)
        assert (settings.data_folder / "share.key").stat().st_mode & 0o077 == 0
    finally:
        service.close()


def test_a_shared_link_shows_the_meshes_of_its_drawing_and_nothing_else_of_the_study(tmp_path):
    service = open_service(settings_in(tmp_path))
    mesh = bytes(84)  # an STL of no triangles
    files = {"mechanism.json": FOURBAR.read_text(), "study.json": json.dumps(STUDY), "e1.csv": TRACKS}
    laid = {}
    for number, (path, text) in enumerate(files.items()):
        laid[path] = tmp_path / str(number)
        laid[path].write_text(text)
    for path in ("meshes/crank.stl", "secret.stl"):
        laid[path] = tmp_path / path.replace("/", "-")
        laid[path].write_bytes(mesh)
    study = store_study(service, LOCAL, laid)
    job = start_job(service, LOCAL, FitRequest(kind="fit", study=study.id, free=["coulomb_friction:*"]))
    app = FastAPI()
    add_files(app, lambda: service)
    base = f"http://here/shared-files/{job.id}/{share_token(service, job.id)}/subject"

    async def asked(path):
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app)) as browser:
            return await browser.get(f"{base}/{path}")

    assert asyncio.run(asked("meshes/crank.stl")).content == mesh
    for path in ("all.zip", "study.json", "mechanism.json", "e1.csv", "secret.stl"):
        assert asyncio.run(asked(path)).status_code == 404, path
    service.close()


def test_an_empty_key_signs_no_link(tmp_path):
    service = open_service(settings_in(tmp_path))
    (service.settings.data_folder / "share.key").write_bytes(b"")
    with pytest.raises(Problem, match=r"0 of 32 bytes; remove it"):
        share_token(service, "a job")
    service.close()


@pytest.mark.parametrize(
    ("sample", "plane"), [("fourbar", "xz"), ("slider_crank", "xz"), ("scissor", "xy"), ("bennett", None)]
)
def test_the_plane_of_motion_is_seen(sample, plane):
    normal = plane_of_motion(read_mechanism(SAMPLES / sample / "mechanism.json"))
    if plane is None:
        assert normal is None
        return
    assert normal is not None
    np.testing.assert_allclose(np.abs(normal), {"xz": [0, 1, 0], "xy": [0, 0, 1]}[plane], atol=1e-9)  # as drawn


CORNERS = {"A": (0, 0, 10, 200), "B": (200, 0, 410, 200), "C": (200, 100, 410, 100), "D": (0, 100, 10, 100)}


ID = "0b6d2f0e-6c1b-4a7e-9a53-0d7f6f1f3c55"
BENT = dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0)
CAMERA = Camera(
    image_size_px=(640, 360), focal_px=(900.0, 901.0), centre_px=(320.0, 180.0), **BENT, views=12, coverage=0.7,
    sd=Deviations(focal_px=(1.0, 1.0), centre_px=(1.0, 1.0), **BENT), reprojection_rms_px=0.1,
    covariance=tuple(map(tuple, np.eye(9).tolist())),
)  # fmt: skip


def pointed(marks="", ends=0, tagged=0, length=None, carried=None, **typed):
    """What the view of a clip was given: so many marks and ends placed, and what was typed."""
    seen = [
        {"id": id, "x_mm": x, "y_mm": y, "x_px": u if id in marks else None, "y_px": v if id in marks else None}
        for id, (x, y, u, v) in CORNERS.items()
    ]
    stick = [{"id": id, "x_px": 5.0 + 100 * k if k < ends else None, "y_px": 7.0} for k, id in enumerate(STICK)]
    tags = [{"id": f"tag {n}", "number": n, "x_mm": 100.0 * n, "y_mm": 40.0 * (n % 2)} for n in range(tagged)]
    both = (("middle", None, "21"), ("bob", 3.0, carried))
    dots = [{"id": id, "x_px": x, "y_px": x, "tag": tag} for id, x, tag in both]
    points = {"marks": seen, "tags": tags, "stick": stick, "dots": dots, "length_mm": length}
    return {"points": points, "plane": "xz", "way": "", "markers": ["middle", "bob"], **typed}


def test_what_was_pointed_out_becomes_the_job_that_was_meant():
    assert not ready(pointed("ABC")["points"])
    assert not ready(pointed("ABC", ends=1)["points"])
    for given in (pointed("ABCD"), pointed(ends=2)):
        assert ready(given["points"])
    plain = asked_for(ID, ID, pointed("ABCD", height="2.5"))
    assert plain.bed["marks"][1] == {"id": "B", "x_m": 0.2, "y_m": 0.0, "x_px": 410, "y_px": 200}
    assert (plain.bed["marker_height_m"], plain.targets, plain.from_s, plain.to_s) == (0.0025, None, 0.0, None)
    typed = {"way": "texture", "reach": "40", "from": "1.5", "to": "4", "rate": "240", "length": 500}
    part = asked_for(ID, ID, pointed(ends=2, **typed))
    assert part.bed["stick"] == {"a_px": (5.0, 7.0), "b_px": (105.0, 7.0), "length_m": 0.5, "origin_px": None}
    assert part.bed["plane"]["y_axis"] == (0.0, 0.0, 1.0)
    assert part.targets == {"middle": "texture:40", "bob": "texture:40"}
    assert part.clicks == {"bob": (3.0, 3.0)}
    assert (part.from_s, part.to_s, part.filmed_per_s) == (1.5, 4.0, 240.0)
    assert asked_for(ID, ID, pointed("ABCD", way="dark")).targets == {"middle": "dark", "bob": "dark"}


def test_tags_a_camera_and_a_bed_file_come_to_the_tracker_as_they_are(tmp_path):
    assert not ready(pointed("AB", tagged=1)["points"])
    assert ready(pointed("AB", tagged=2)["points"])
    tagged = asked_for(ID, ID, pointed(tagged=4, way="tag", carried="aruco_4x4_50:20"))
    assert tagged.bed["tags"][2] == {"id": 2, "x_m": 0.2, "y_m": 0.0}
    assert tagged.targets == {"middle": "21", "bob": "aruco_4x4_50:20"}
    write_camera(CAMERA, tmp_path / "camera.json")
    bed = {"tags": tagged.bed["tags"], "camera": "camera.json", "readout_s": 0.01}
    (tmp_path / "bed.json").write_text(json.dumps(bed))
    brought = dict(known(name, tmp_path / name) for name in ("camera.json", "bed.json"))
    found = asked_for(ID, ID, pointed(**brought)).bed
    assert found["camera"]["focal_px"] == [900.0, 901.0]
    assert (found["readout_s"], found["plane"]["y_axis"]) == (0.01, (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    "given",
    [
        pointed("ABCD", height="2.5", focal="900"),
        pointed("CD", tagged=2, way="tag", carried="0", camera="700"),
        pointed("ABCD", way="tag", carried="aruco_4x4_50:3"),
        pointed(ends=2, length=940, way="texture", reach="40", **{"from": "1.5", "to": "4", "rate": "240"}),
        pointed(bed_file={"marks": asked_for(ID, ID, pointed("ABCD")).bed["marks"], "readout_s": 0.01}),
        pointed(bed_file={"marks": asked_for(ID, ID, pointed("ABCD")).bed["marks"], "marker_height_m": "drawn"}),
        pointed("ABCD", camera_file=json.loads(CAMERA.model_dump_json()), plane="yz", keep=True),
    ],
)
def test_a_clip_that_is_marked_again_has_what_was_said_of_it_before(given):
    asked = asked_for(ID, ID, given).model_dump(mode="json")
    again = marked_before(asked, pointed(), PLANES)
    assert "bed_file" in again or ready(again["points"])
    assert asked_for(ID, ID, again).model_dump(mode="json") == asked


@pytest.mark.parametrize(("text", "says"), [("{", "not JSON"), ("{}", "neither"), ('{"focal_px": 1}', "no camera")])
def test_a_file_that_is_neither_camera_nor_bed_is_refused(tmp_path, text, says):
    (tmp_path / "it.json").write_text(text)
    with pytest.raises(Problem, match=says):
        known("it.json", tmp_path / "it.json")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (pointed(ends=2), "Type how long"),
        (pointed(ends=2, length=0), "greater than 0"),
        (pointed("ABCD", **{"from": "4", "to": "2"}), "not before"),
        (pointed("ABCD", way="texture", reach="2"), "5 pixels or more"),
        (pointed(ends=2, length=940, focal="900"), "stands in for marks"),
        (pointed("ABCD", way="tag"), "which tag is on bob"),
        (pointed("ABCD", way="tag", carried="aruco_4x4_50:99"), "has numbers from 0 to 49"),
        (pointed(tagged=3), "Type how long"),
        (pointed(bed_file={"tags": [], "camera": "camera.json"}), "names the camera camera.json"),
    ],
)
def test_what_cannot_be_meant_is_said_in_a_sentence(given, says):
    with pytest.raises(ValueError, match=says) as found:
        asked_for(ID, ID, given)
    assert "validation error" not in " ".join(sentences(found.value))


def test_few_frames_of_a_clip_are_kept_whatever_is_asked_for(tmp_path, monkeypatch):
    service = open_service(settings_in(tmp_path))

    async def still(service, *words):
        Path(words[-1].removeprefix("--out=")).write_text(words[-2])

    monkeypatch.setattr(running, "files_of", lambda service, video: [SimpleNamespace(path="clip")])
    monkeypatch.setattr(running, "brought", lambda service, video, path: tmp_path / "clip")
    monkeypatch.setattr(running, "linktwin", still)
    for k in range(20):
        shown = asyncio.run(running.first_frame(service, "a", 0.5 * k))
        assert shown.read_text() == f"--from={0.5 * k}"
        os.utime(shown, (k, k))
    other = asyncio.run(running.first_frame(service, "b"))
    assert len(list(other.parent.glob("frame-a-*"))) == running.MOST_FRAMES
    assert asyncio.run(running.first_frame(service, "a", 9.5)).exists()
    service.close()


def test_each_mesh_is_asked_for_as_stl_or_its_fault_is_told():
    text = (SAMPLES / "fourbar" / "mechanism.json").read_text()
    text = text.replace("coupler.stl", "coupler.GLB").replace("frame.stl", "frame.step")
    drawn = on_stage(parse_mechanism(json.loads(text), "it"), lambda uri: None if "crank" in uri else f"/files/{uri}")
    meshes = {body["id"]: body["meshes"] for body in drawn["bodies"]}
    assert meshes["crank"] == [{"uri": "meshes/crank.stl", "scale_to_m": 0.001}]  # it was not sent
    assert meshes["rocker"][0]["url"] == "/files/meshes/rocker.stl"
    assert meshes["coupler"][0]["url"] == "/files/meshes/coupler.GLB?as=stl"
    (frame,) = meshes[next(body["id"] for body in drawn["bodies"] if body["fixed"])]
    assert frame["fault"].startswith('"meshes/frame.step" is no mesh that is drawn here; export it as .stl')
    assert all(len(body["points_m"]) >= 2 for body in drawn["bodies"])  # so that it can be drawn as a bar


def test_a_mesh_of_another_kind_is_handed_out_as_stl_and_made_once(tmp_path, monkeypatch):
    whole = [sys.executable, "-c", "from backend.cli import main; main()"]
    service = open_service(settings_in(tmp_path, job_command=whole))
    bar = trimesh.creation.box((80.0, 20.0, 6.0))
    bar.export(tmp_path / "bar.glb")
    (tmp_path / "dots.ply").write_bytes(trimesh.PointCloud(bar.vertices).export(file_type="ply"))
    with service.database.writing() as session:
        job = Job(owner=LOCAL, kind="jam", request={})
        files = {name: service.storage.put(tmp_path / name) for name in ("bar.glb", "dots.ply")}
        session.add_all([job, *(stored(job.id, f"meshes/{name}", kept) for name, kept in files.items())])
    app = FastAPI()
    add_files(app, lambda: service)
    base = f"http://here/files/jobs/{job.id}/meshes"

    def asked(path):
        async def answer():
            async with httpx.AsyncClient(transport=httpx.ASGITransport(app)) as browser:
                return await browser.get(f"{base}/{path}")

        return asyncio.run(answer())

    found = asked("bar.glb?as=stl")
    assert found.headers["content-type"] == "model/stl"
    drawn = trimesh.load_mesh(BytesIO(found.content), file_type="stl")
    np.testing.assert_allclose(drawn.extents, [80.0, 20.0, 6.0], rtol=1e-6)
    assert asked("bar.glb").content == (tmp_path / "bar.glb").read_bytes()
    refused = asked("dots.ply?as=stl")
    assert (refused.status_code, refused.text) == (
        422, '"meshes/dots.ply" holds no facets; export the surface, not its points or edges alone.',
    )  # fmt: skip
    monkeypatch.setattr(running, "linktwin", None)  # no process is begun for what is there
    assert asked("bar.glb?as=stl").content == found.content
    service.close()


def test_what_was_tracked_in_a_clip_that_was_deleted_is_shown_and_studied_all_the_same(tmp_path, monkeypatch):
    service = open_service(settings_in(tmp_path))
    (tmp_path / "report.json").write_text("{}")
    with service.database.writing() as session:
        job = Job(owner=LOCAL, kind="track", request={"video": ID, "mechanism": ID}, state="succeeded")
        files = {"report.json": tmp_path / "report.json", "tracks.csv": MEASURED / "low.csv"}
        session.add_all([job, *(stored(job.id, path, service.storage.put(file)) for path, file in files.items())])
    shown = []
    monkeypatch.setattr(results, "Film", lambda clip, preview, *rest: shown.append((clip, preview)))
    for part in ("notice", "tag", "facts", "film_tracks"):
        monkeypatch.setattr(results, part, lambda *words, **more: nullcontext())
    results.tracking(service, job, "files/jobs/", "files/videos/")
    assert shown == [("files/jobs/preview.mp4", "files/jobs/preview.mp4")]
    (run,) = _tracked(service, LOCAL, ID, tmp_path)
    assert run.id == "a_deleted_clip"
    service.close()


def test_a_file_on_its_way_is_served_to_nobody(tmp_path, monkeypatch):
    service = open_service(settings_in(tmp_path, storage_url="memory://half-fetched"))
    (tmp_path / "clip").write_bytes(b"a" * 1000)
    with service.database.writing() as session:
        session.add(stored(ID, "clip.mp4", service.storage.put(tmp_path / "clip")))
    kept = files_of(service, ID)[0].key
    seen = []

    def breaks_off(key):
        yield b"half"
        seen.append(running.place(service, f"{kept}.mp4").exists())
        raise ConnectionError

    with monkeypatch.context() as line:
        line.setattr(service.storage, "chunks", breaks_off)
        with pytest.raises(ConnectionError):
            running.brought(service, ID, "clip.mp4")
    assert seen == [False]
    assert running.brought(service, ID, "clip.mp4").read_bytes() == b"a" * 1000
    assert len(list(running.place(service, "").iterdir())) == 1
    service.close()


def test_two_who_ask_for_a_file_first_both_get_it(tmp_path):
    service = open_service(settings_in(tmp_path))
    kept = service.storage.put(FOURBAR)
    for _ in range(2):  # as if the other had looked before this one was done
        service.storage.bring(kept.key, tmp_path / "there")
    assert (tmp_path / "there").read_bytes() == FOURBAR.read_bytes()
    service.close()


def test_a_check_that_is_cut_off_is_made_again(tmp_path, monkeypatch):
    service = open_service(settings_in(tmp_path))

    async def said(service, *words):
        return "\ud800"  # cannot be written

    monkeypatch.setattr(running, "brought", lambda service, thing, drawing: tmp_path / "mechanism.json")
    monkeypatch.setattr(running, "linktwin", said)
    with pytest.raises(UnicodeEncodeError):
        asyncio.run(running.checked(service, "a", "mechanism.json"))
    assert list(running.place(service, "").iterdir()) == []
    service.close()


@pytest.mark.parametrize(("typed", "sent"), [("", None), ("0", 0.0), ("90.5", 90.5)])
def test_a_diagnosis_is_asked_for_with_the_minutes_that_were_typed(typed, sent):
    asked = {"tolerance": "", "minutes": typed, "without": "air_drag"}
    request = _request("diagnose", "00000000-0000-0000-0000-000000000001", asked)
    assert (request.minutes, request.tolerance_mm, request.without) == (sent, None, ["air_drag"])


def test_less_than_no_minutes_are_refused():
    with pytest.raises(ValueError, match="minutes"):
        _request("diagnose", "00000000-0000-0000-0000-000000000001", {"tolerance": "", "minutes": "-1", "without": ""})
