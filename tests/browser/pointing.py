"""How a person points at places in a clip's first frame."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.browser.conftest import SAMPLE

WIDE_PX, HIGH_PX = 640, 360  # of the clip


def bring_clip(page, clip: Path) -> None:
    """Open the sample's drawing and drop a clip of the real one."""
    page.set_input_files("input[type=file]", SAMPLE / "mechanism.json")
    page.wait_for_url("**/mechanisms/*")
    page.get_by_role("link", name="Measure the real one").click()
    page.wait_for_selector(".drop")
    page.set_input_files("input[type=file]", clip)
    page.wait_for_selector(".pointing[data-ready]")


def point_at(page, name: str, x_px: float, y_px: float) -> None:
    """Click on a pixel of the clip; the point whose turn it is must be there."""
    box = page.locator(".pointing-view canvas").bounding_box()
    scale = min(box["width"] / WIDE_PX, box["height"] / HIGH_PX)
    left, top = box["x"] + (box["width"] - WIDE_PX * scale) / 2, box["y"] + (box["height"] - HIGH_PX * scale) / 2
    page.mouse.click(left + (x_px + 0.5) * scale, top + (y_px + 0.5) * scale)
    assert place_of(page, name) == pytest.approx((x_px, y_px), abs=1.0)  # a click falls on a whole pixel of the screen


def place_of(page, name: str) -> tuple[float, float]:
    """Where the list says that a point was placed [px]."""
    said = page.locator(".pointing-list li", has_text=re.compile(f"^{name}")).locator(".pointing-name span")
    x, y = said.inner_text().removesuffix(" px").split(",")
    return float(x), float(y)


def point_at_marks(page, marks: list[dict]) -> None:
    """Type where every other mark of the bed is, and click on it."""
    for name, mark in zip("ABCD", marks[::2], strict=True):
        page.fill(f'[aria-label="x of {name} in mm"]', str(1e3 * mark["x_m"]))
        page.fill(f'[aria-label="y of {name} in mm"]', str(1e3 * mark["y_m"]))
        point_at(page, name, mark["x_px"], mark["y_px"])
