"""The stage in a real Chromium: meshes of every kind, forces in a jam, and where a gap lies."""

from __future__ import annotations

import colorsys
import json
import shutil
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from backend.service.service import open_service
from backend.service.settings import Settings
from backend.service.things import file_of
from tests.browser.conftest import PREPARED

# A slider crank, seized at its crank's pin; its bodies' meshes are one of each kind.
BARS_MM = {"frame.stl": (140, 12, 4), "crank.glb": (50, 12, 5), "rod.obj": (130, 12, 5), "block.ply": (30, 30, 14)}
TONES = {"crank": "#e0b08a", "rod": "#9ec7a6", "block": "#c3aad0"}  # style.css, in the order of the bodies
ARROW = "#b02e4c"
DRAWN_MS = 500  # until what is ready has been painted
ASIDE = """[...document.querySelectorAll('#content *')].filter((part) =>
  part.getBoundingClientRect().right > innerWidth + 1 && !part.closest('.scroll')).length"""


def picture_of(page) -> np.ndarray:
    """Pixels (height, width, 3) of the stage."""
    page.wait_for_timeout(DRAWN_MS)
    return np.asarray(Image.open(BytesIO(page.locator(".stage-view").screenshot())).convert("RGB"))


def painted(picture: np.ndarray, tone: str) -> int:
    """How many pixels have the hue of a tone, however much light falls on them."""
    hue, saturation, _ = np.moveaxis(np.asarray(Image.fromarray(picture).convert("HSV"), float) / 255, 2, 0)
    wanted, strength, _ = colorsys.rgb_to_hsv(*(int(tone[k : k + 2], 16) / 255 for k in (1, 3, 5)))
    return int(np.sum((np.abs((hue - wanted + 0.5) % 1 - 0.5) < 0.03) & (saturation > 0.5 * strength)))


def px_per_mm(page) -> float:
    """What the scale bar says, once all meshes are there."""
    page.wait_for_selector(".stage[data-ready]")
    page.wait_for_timeout(DRAWN_MS)
    mm = page.locator(".stage-scale span").inner_text().removesuffix(" mm")
    return page.locator(".stage-scale i").bounding_box()["width"] / float(mm)


@pytest.fixture(scope="module")
def bars(tmp_path_factory):
    """The drawing and a bar for each of its bodies, in the kind of file that it names."""
    folder = tmp_path_factory.mktemp("bars")
    shutil.copyfile(PREPARED / "stuck.json", folder / "mechanism.json")
    for name, size in BARS_MM.items():
        bar = trimesh.creation.box(size)
        bar.apply_translation([size[0] / 2 - 6, 0, size[2] / 2])
        bar.export(folder / name)
    return folder


@pytest.fixture(scope="module")
def drawing(window, address, bars) -> str:
    """Path of the stored drawing."""
    with window() as opened:
        page = opened.new_page()
        page.goto(address)
        page.set_input_files("input[type=file]", list(bars.iterdir()))
        page.wait_for_url("**/mechanisms/*")
        return page.url.split("/ui/")[1]


@pytest.fixture(scope="module")
def jam(finished, drawing) -> str:
    """Path of a finished jam report of it."""
    return finished(drawing, "Does it jam?", ".stage[data-replay]")


def test_meshes_of_every_kind_are_drawn(visit, drawing):
    page = visit(drawing)
    page.wait_for_selector(".stage[data-ready]")
    page.get_by_role("button", name="Flat").click()
    assert page.locator(".stage-trouble").count() == 0
    scale = px_per_mm(page)
    picture = picture_of(page)
    for body, tone in TONES.items():
        area_mm2 = painted(picture, tone) / scale**2
        length, width, _ = next(size for name, size in BARS_MM.items() if name.startswith(body))
        # Seen square on, some of it behind another body; a bar through the joints would be 2 mm broad.
        assert 0.5 < area_mm2 / (length * width) < 1.1, body


def test_a_mesh_that_comes_after_the_motion_is_in_view_too(visit, diagnosis):
    at_once = px_per_mm(visit(diagnosis))
    page = visit()
    held = []
    page.route("**/meshes/link.stl", lambda route: held.append(route))
    page.goto(page.url + diagnosis)
    page.wait_for_selector(".stage[data-replay]")
    page.wait_for_timeout(DRAWN_MS)
    held[0].continue_()
    assert px_per_mm(page) == pytest.approx(at_once, rel=0.01)


def test_what_of_a_drawing_is_not_shown_is_said_with_the_reason(visit, bars, tmp_path):
    shutil.copytree(bars, tmp_path / "bad")
    (tmp_path / "bad" / "crank.glb").write_bytes(b"glTF\2\0\0\0\x10\0\0\0half")
    (tmp_path / "bad" / "block.ply").write_bytes(trimesh.PointCloud([[0, 0, 0], [1, 1, 1]]).export(file_type="ply"))
    (tmp_path / "bad" / "rod.obj").unlink()
    page = visit()
    page.set_input_files("input[type=file]", list((tmp_path / "bad").iterdir()))
    page.wait_for_url("**/mechanisms/*")
    page.wait_for_selector(".stage[data-ready]")
    said = page.locator(".stage-trouble").inner_text()
    assert "Not every mesh is shown" in said
    assert '"meshes/crank.glb" cannot be read as GLB' in said
    assert '"meshes/block.ply" holds no facets' in said
    assert '"meshes/rod.obj" did not come with the drawing' in said
    assert "frame.stl" not in said


def test_a_jam_has_an_arrow_for_what_each_joint_carries(visit, jam):
    page = visit(jam)
    page.wait_for_selector(".stage[data-replay]")
    report = json.loads((PREPARED / "jam_stuck" / "jam.json").read_text())
    carried = [np.linalg.norm(one["force_on_a_n"][0]) for one in report["reactions"].values()]
    page.locator(".stage-names .force").nth(3).wait_for()
    told = [float(text.removesuffix(" N")) for text in page.locator(".stage-names .force").all_inner_texts()]
    assert told == pytest.approx(sorted(carried, reverse=True), rel=5e-3)  # three digits
    assert painted(picture_of(page), ARROW) > 500  # px: four arrows of a hundred by three
    page.get_by_role("checkbox", name="joint forces").uncheck()
    page.wait_for_function("document.querySelectorAll('.stage-names .force').length === 0")
    assert painted(picture_of(page), ARROW) < 50
    assert page.locator(".stage-names .hot").all_inner_texts() == ["A"]  # where it holds
    assert "C, rail" in page.locator(".stage-names .joint").all_inner_texts()  # in one place


def test_whoever_has_the_link_to_a_jam_sees_its_meshes(visit, jam):
    page = visit(jam)
    page.get_by_role("button", name="Share").click()
    page.wait_for_function("document.getElementById('share-link').value !== ''")
    stranger = visit(signed_in=False)
    stranger.goto(page.locator("#share-link").input_value())
    stranger.wait_for_selector(".stage[data-ready]")
    assert stranger.locator(".stage-trouble").count() == 0


def test_a_jam_fits_a_phone(visit, jam):
    page = visit(jam, width=390, height=844)
    page.wait_for_selector(".stage[data-replay]")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.evaluate(ASIDE) == 0
    whole = Image.open(BytesIO(page.screenshot(full_page=True)))
    assert whole.width == 390
    cells = [cell.bounding_box() for cell in page.locator(".figures > div").all()]
    assert {round(cell["x"] + cell["width"]) for cell in cells[1::2]} == {round(cells[-1]["x"] + cells[-1]["width"])}


def test_everything_of_a_result_is_in_its_archive(visit, jam, tmp_path):
    page = visit(jam)
    with page.expect_download() as coming:
        page.get_by_role("link", name="Download everything").click()
    coming.value.save_as(tmp_path / "all.zip")
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        assert archive.testzip() is None
        inside = {name: archive.read(name) for name in archive.namelist()}
    listed = page.locator("#content td a")
    assert set(listed.all_inner_texts()) == set(inside) == {"report.json", "jam.json", "jam.html", "pictures.json"}
    report = json.loads(inside["report.json"])
    assert report == json.loads((PREPARED / "jam_stuck" / "jam.json").read_text())
    assert inside["jam.html"].lstrip().lower().startswith(b"<!doctype html")
    assert report["sentence"] in inside["jam.html"].decode()
    for link in listed.all():
        alone = page.request.get(page.url.split("/ui/")[0] + link.get_attribute("href"))
        assert alone.body() == inside[link.inner_text()]


@pytest.fixture(scope="module")
def doubt(finished, study, folder) -> str:
    """Path of a diagnosis that is not sure where the gap lies: as prepared, its places told otherwise."""
    path = finished(study, "Diagnose", ".badge")
    service = open_service(Settings(data_folder=folder))
    place = Path(service.storage._place(file_of(service, path.rsplit("/", 1)[1], "pictures.json").key))
    before = place.read_bytes()
    told = json.loads(before)
    told["story"]["places"] = [
        {"name": name, "probability": share, "percent": f"{100 * share:.0f}%", "at": at}
        for name, share, at in (("body link", 0.6, "body:link"), ("marker bob", 0.4, "marker:bob"))
    ]
    told["story"]["meaning"] = ""  # room for one more place
    made = json.dumps(told, separators=(",", ":"), ensure_ascii=False).encode()
    assert len(made) <= len(before)
    place.write_bytes(made.ljust(len(before)))  # its size stands on record
    service.close()
    return path


def test_places_are_coloured_by_how_likely_the_gap_lies_there(visit, diagnosis, doubt):
    seen = []
    for path in (diagnosis, doubt):
        page = visit(path)
        page.wait_for_selector(".stage[data-ready][data-replay]")
        page.get_by_role("checkbox", name="as drawn").uncheck()  # it has the colour of what is wrong
        warmth = np.subtract(*np.moveaxis(picture_of(page)[..., ::2].astype(int), 2, 0))  # red less blue
        names = page.locator(".stage-names .hot").all_inner_texts()
        seen.append((int(np.sum(warmth > 30)), int(np.sum(warmth < -30)), names))
    (at_the_pivot, steel, first), (at_the_link, left, second) = seen
    assert (first, second) == (["pivot"], ["bob"])
    assert 100 < at_the_pivot < 0.1 * steel  # px: its ring alone
    assert at_the_link > 0.8 * steel  # the whole bar, which was of steel
    assert left < 0.2 * steel
