"""The kit on paper is as large as it says, and what looks for it finds it where it was printed."""

import re
from dataclasses import replace
from functools import cache

import av
import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from backend.observe import kit
from backend.observe.detect import detect
from backend.observe.dots import HUE_GAP_DEG, learn_look
from backend.observe.tags import find_tags
from backend.observe.video import upright
from backend.report.kit_pages import PAPERS_MM, board_place, dot_places, kit_pages, tag_places, write_kit

PAPERS = pytest.mark.parametrize("paper", list(PAPERS_MM))
PX_PER_MM = 10  # both papers are whole pixels high and wide: a canvas of broken size is cut at its top
PAGES = ("guide", "dots", "tags", "board")


def drawn(figure, dpi=25.4 * PX_PER_MM):
    """The page as RGB, one pixel per 1/dpi inch."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(dpi)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


@cache
def grey(paper, name):
    return cv2.cvtColor(drawn(kit_pages(paper)[name]), cv2.COLOR_RGB2GRAY)


def millimetres(px):
    """From pixels, (0, 0) the centre of the corner one, to millimetres from the page's upper left corner."""
    return (np.asarray(px, float) + 0.5) / PX_PER_MM


@PAPERS
def test_every_page_is_as_large_as_its_paper(paper, tmp_path):
    pdf = write_kit(tmp_path / "kit.pdf", paper).read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf)
    assert len(boxes) == 4
    points = np.array(PAPERS_MM[paper]) / 25.4 * 72
    np.testing.assert_allclose(np.array(boxes, float), [points] * 4, atol=1e-4)  # what the file rounds to
    assert b"/Subtype /Image" not in pdf  # drawn, not rastered


@PAPERS
def test_nothing_is_printed_where_printers_cannot(paper):
    for name in PAGES:
        page = grey(paper, name)
        rows, columns = (np.flatnonzero((page < 250).any(axis)) for axis in (1, 0))
        margin = min(rows[0], columns[0], page.shape[0] - 1 - rows[-1], page.shape[1] - 1 - columns[-1]) / PX_PER_MM
        assert margin > 4.3, name  # mm: the unprintable edge of common printers is 4.2


@PAPERS
def test_every_tag_is_found_where_it_was_printed(paper):
    page = grey(paper, "tags")
    found, expected = {tag.number: laid for tag, laid in find_tags(page).items()}, tag_places(paper)
    assert sorted(found) == sorted(expected) == sorted(kit.TAG_IDS)
    at = millimetres([found[tag].centre_px for tag in expected])
    np.testing.assert_allclose(at, list(expected.values()), atol=0.1)  # mm; one pixel is 0.1
    x, y = np.round(np.array(expected[0]) * PX_PER_MM).astype(int)
    ink = 1 - page[y - 250 : y + 250, x - 250 : x + 250] / 255
    edge = int(0.44 * 1e3 * kit.TAG_SIDE_M * PX_PER_MM)  # within the black cells all round
    for side in (ink[250 + edge].sum(), ink[:, 250 - edge].sum()):
        assert side / PX_PER_MM == pytest.approx(1e3 * kit.TAG_SIDE_M, abs=0.02)  # mm; grey levels round


@PAPERS
def test_every_corner_of_the_board_is_found_where_it_was_printed(paper):
    corners, ids, _, _ = cv2.aruco.CharucoDetector(kit.board()).detectBoard(grey(paper, "board"))
    printed = board_place(paper) + 1e3 * kit.board_corners_m()[:, :2]
    assert sorted(np.ravel(ids)) == list(range((kit.BOARD_COLUMNS - 1) * (kit.BOARD_ROWS - 1)))
    np.testing.assert_allclose(millimetres(corners.reshape(-1, 2)), printed[np.ravel(ids)], atol=0.1)  # mm


@PAPERS
def test_the_rulers_are_100_mm_long(paper):
    for name in PAGES:
        rows = grey(paper, name)[-int(16 * PX_PER_MM) : -int(10 * PX_PER_MM)] < 200
        across = np.flatnonzero(rows.any(0))
        ruler = across[across < int(121 * PX_PER_MM)]
        assert (ruler[-1] - ruler[0]) / PX_PER_MM == pytest.approx(100.0, abs=0.2), name  # lines are 0.12 mm wide


def test_the_tracker_finds_every_dot_of_a_size_and_tells_the_inks_apart():
    dots, px_per_mm = dot_places("a4"), 5
    page = drawn(kit_pages("a4")["dots"], 25.4 * px_per_mm)
    page = page[: page.shape[0] // 2 * 2, : page.shape[1] // 2 * 2]
    # A camera's limited contrast: white paper at 80% under a lamp.
    lit = av.VideoFrame.from_ndarray(np.ascontiguousarray(0.8 * page).astype(np.uint8), format="rgb24")
    frame = upright(lit.reformat(format="yuv420p"), 0, 0.0)
    hues = []
    for ink in kit.INKS:
        for size in kit.DOT_SIZES:
            own = [d for d in dots if d.ink == ink and d.size == size]
            places = np.array([[d.x_mm, d.y_mm] for d in own]) * px_per_mm - 0.5
            alone = only(frame, places, 1e3 * size.ring_m * px_per_mm)
            look = learn_look(alone, len(own))
            found = detect(alone, look)
            away = np.hypot(*(places[:, None] - found.px[None]).transpose(2, 0, 1)).min(1)
            assert len(found) == len(own)
            assert away.max() / px_per_mm < 0.05  # mm
            hues.append(look.hue_rad)
    hues = np.array(hues).reshape(len(kit.INKS), -1)
    assert np.ptp(np.rad2deg(hues), axis=1).max() < 5  # one ink, one hue, whatever the size
    gaps = np.rad2deg(np.abs(np.angle(np.exp(1j * (hues[:, None, 0] - hues[None, :, 0])))))
    assert gaps[~np.eye(len(gaps), dtype=bool)].min() > 2 * HUE_GAP_DEG


def only(frame, places, ring_px):
    """The frame with white paper in place of all but these dots."""
    near = np.zeros(frame.luma.shape, np.uint8)
    for place in places:
        cv2.circle(near, np.round(place).astype(int).tolist(), int(0.55 * ring_px), 1, -1)
    planes = {
        "luma": np.where(near, frame.luma, np.median(frame.luma).astype(np.uint8)),
        "cb": np.where(near[::2, ::2], frame.cb, np.uint8(128)),
        "cr": np.where(near[::2, ::2], frame.cr, np.uint8(128)),
    }
    return replace(frame, **planes)


def test_an_unknown_paper_is_refused_by_name():
    with pytest.raises(ValueError, match="no paper 'a5'; choose a4 or letter"):
        kit_pages("a5")
