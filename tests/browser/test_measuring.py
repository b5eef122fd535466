"""Measurements brought by hand, in a real Chromium: points in a clip, tables of tracks."""

from __future__ import annotations

import httpx
import pytest

from tests.browser.clip import film_pendulum
from tests.browser.conftest import SAMPLE
from tests.browser.pointing import bring_clip, place_of, point_at, point_at_marks


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A clip, the bed's marks in it, and where each dot is in its first frame [px]."""
    path = tmp_path_factory.mktemp("film") / "swing.mp4"
    return path, *film_pendulum(path)


def test_a_clip_is_marked_by_clicks_tracked_and_becomes_a_study(visit, film, served):
    clip, marks, dots = film
    page = visit()
    bring_clip(page, clip)
    assert page.get_by_role("button", name="Track the dots").is_disabled()
    point_at_marks(page, marks)
    page.get_by_role("tab", name="Dots").click()
    for marker, place in dots.items():
        point_at(page, marker, *place)
    page.get_by_role("button", name="Track the dots").click()
    page.wait_for_url("**/jobs/*")
    job = page.url.rsplit("/", 1)[1]
    api, key = served[0].replace("/ui/", "/api/v1"), {"Authorization": f"Bearer {served[1]}"}
    clicks = httpx.get(f"{api}/jobs/{job}", headers=key).json()["request"]["clicks"]
    assert clicks.keys() == dots.keys() == {"middle", "bob"}
    for marker, place in dots.items():
        assert clicks[marker] == pytest.approx(place, abs=1.0)
    page.wait_for_selector(".film[data-ready]")
    page.get_by_role("link", name="Make a study of the runs").click()
    page.wait_for_selector("table")
    let_go = float(page.get_by_label("swing let go at").input_value())
    assert abs(let_go - 0.2) < 0.05  # frame 12 of 60 a second; a twentieth of a second is three frames
    page.get_by_role("button", name="Save the study").click()
    page.wait_for_url("**/studies/*")
    assert "swing" in page.locator("table").inner_text()


def test_points_are_placed_and_moved_by_the_keyboard(visit, film):
    page = visit()
    bring_clip(page, film[0])
    view = page.locator(".pointing-view")
    view.focus()
    for key in ("ArrowRight", "Shift+ArrowDown", "Enter"):
        page.keyboard.press(key)
    x, y = place_of(page, "A")
    assert (x, y) == (321.0, 190.0)  # from the middle of the picture
    page.keyboard.press("ArrowRight")  # the next one's turn: A stays
    page.keyboard.press("Enter")
    assert (place_of(page, "A"), place_of(page, "B")) == ((x, y), (x + 1, y))
    point_at(page, "C", 100.0, 100.0)
    page.locator(".pointing-name").first.click()  # A
    for key in ("ArrowLeft", "ArrowUp", "Shift+ArrowUp"):
        page.keyboard.press(key)
    assert place_of(page, "A") == (x - 1, y - 11)
    for _ in range(20):
        page.keyboard.press("Shift+ArrowUp")
    assert place_of(page, "A") == (x - 1, 9.0)  # never out of the picture
    assert place_of(page, "C") == pytest.approx((100.0, 100.0), abs=1.0)


def test_tables_of_tracks_become_a_study(visit, tmp_path):
    page = visit()
    page.set_input_files("input[type=file]", SAMPLE / "mechanism.json")
    page.wait_for_url("**/mechanisms/*")
    page.get_by_role("link", name="Measure the real one").click()
    page.get_by_role("link", name="Bring tables").click()
    page.get_by_text("Bring tables below, or track a clip first.").wait_for()
    assert page.get_by_role("button", name="Save the study").is_disabled()
    (tmp_path / "odd.csv").write_text("frame,left\n1,2\n")
    page.set_input_files("input[type=file]", tmp_path / "odd.csv")
    page.locator("[role=alert]", has_text="frame, left").wait_for()
    page.set_input_files("input[type=file]", [SAMPLE / "measured" / f"{run}.csv" for run in ("low", "high", "far")])
    page.get_by_label("use of far").wait_for()
    uses = [page.get_by_label(f"use of {run}").input_value() for run in ("low", "high", "far")]
    assert uses == ["fit", "fit", "held_out"]
    assert float(page.get_by_label("low let go at").input_value()) == pytest.approx(0.25, abs=0.05)
    page.get_by_label("use of high").select_option("none")
    page.get_by_role("button", name="Save the study").click()
    page.wait_for_url("**/studies/*")
    rows = page.locator("#content table").first.locator("tbody tr").all_inner_texts()
    assert [row.split("\t")[:3] for row in rows] == [["low", "fitted", "markers"], ["far", "kept aside", "markers"]]
