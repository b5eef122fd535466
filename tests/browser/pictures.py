"""The pictures in docs/page.md, drawn anew: `python -m pytest tests/browser/pictures.py`."""

from __future__ import annotations

from pathlib import Path

from tests.browser.clip import film_pendulum
from tests.browser.pointing import bring_clip, point_at_marks

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
DRAWN_MS = 1500  # until the stage has drawn its first frames


def test_what_was_drawn(visit):
    page = visit()
    page.click("[data-sample=fourbar]")
    page.wait_for_url("**/mechanisms/*")
    page.wait_for_selector(".stage[data-ready]")
    page.wait_for_timeout(DRAWN_MS)
    page.screenshot(path=PICTURES / "page_mechanism.png")


def test_what_is_missing(visit, diagnosis):
    for scheme, name in (("light", "page_gap.png"), ("dark", "page_gap_dark.png")):
        page = visit(diagnosis, scheme=scheme)
        page.wait_for_selector(".stage[data-replay]")
        page.wait_for_timeout(DRAWN_MS)
        page.screenshot(path=PICTURES / name)


def test_marks_in_a_clip(visit, tmp_path):
    marks, _ = film_pendulum(tmp_path / "swing.mp4")
    page = visit()
    bring_clip(page, tmp_path / "swing.mp4")
    point_at_marks(page, marks)
    page.screenshot(path=PICTURES / "page_clip.png")
