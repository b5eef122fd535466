"""The pictures in docs/page.md, drawn anew: `python -m pytest tests/browser/pictures.py`."""

from __future__ import annotations

import re
from pathlib import Path

from tests.browser.clip import film_pendulum
from tests.browser.test_page import SAMPLE, diagnosis, study  # noqa: F401  (fixtures)

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
DRAWN_MS = 1500  # until the stage has drawn its first frames


def test_what_was_drawn(visit):
    page = visit()
    page.click("[data-sample=fourbar]")
    page.wait_for_url("**/mechanisms/*")
    page.wait_for_selector(".stage[data-ready]")
    page.wait_for_timeout(DRAWN_MS)
    page.screenshot(path=PICTURES / "page_mechanism.png")


def test_what_is_missing(visit, diagnosis):  # noqa: F811
    for scheme, name in (("light", "page_gap.png"), ("dark", "page_gap_dark.png")):
        page = visit(diagnosis, scheme=scheme)
        page.wait_for_selector(".stage[data-replay]")
        page.wait_for_timeout(DRAWN_MS)
        page.screenshot(path=PICTURES / name)


def test_marks_in_a_clip(visit, tmp_path):
    marks = film_pendulum(tmp_path / "swing.mp4")
    page = visit()
    page.set_input_files("input[type=file]", SAMPLE / "mechanism.json")
    page.wait_for_url("**/mechanisms/*")
    page.get_by_role("link", name="Measure the real one").click()
    page.wait_for_selector(".drop")
    page.set_input_files("input[type=file]", tmp_path / "swing.mp4")
    page.wait_for_selector(".pointing[data-ready]")
    box = page.locator(".pointing-view canvas").bounding_box()
    scale = min(box["width"] / 640, box["height"] / 360)
    left, top = box["x"] + (box["width"] - 640 * scale) / 2, box["y"] + (box["height"] - 360 * scale) / 2
    for name, mark in zip("ABCD", marks[::2], strict=True):
        page.fill(f'[aria-label="x of {name} in mm"]', str(1e3 * mark["x_m"]))
        page.fill(f'[aria-label="y of {name} in mm"]', str(1e3 * mark["y_m"]))
        page.mouse.click(left + (mark["x_px"] + 0.5) * scale, top + (mark["y_px"] + 0.5) * scale)
        page.locator(".pointing-list li", has_text=re.compile(f"^{name}")).locator(".pointing-name span").wait_for()
    page.screenshot(path=PICTURES / "page_clip.png")
