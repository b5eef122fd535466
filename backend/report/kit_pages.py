"""The kit as pages to print: true scale, vector art, positions in millimetres from the page's upper left corner."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline

from backend.observe import kit
from backend.report.filming_guide import GUIDE, set_up

MM_PER_INCH = 25.4
PAPERS_MM = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}
TOP, SIDE, CUT, DARK = 14.0, 17.5, 0.12, "0.15"
RULER_MM = 100.0
TAG_CARD_MM = (56.0, 62.0)  # 8 mm of white round the square, a line of text below it
TAG_GAP_MM = (3.5, 4.0)
TAG_COLUMNS = 3
DOT_GAP_MM = 2.0


@dataclass(frozen=True)
class PlacedDot:
    """A dot on its page: centre [mm], size and ink."""

    x_mm: float
    y_mm: float
    size: kit.DotSize
    ink: kit.Ink


def write_kit(path: str | Path, paper: str = "a4") -> Path:
    """Write the kit's PDF for "a4" or "letter" paper.  Raises ValueError for other papers."""
    path = Path(path)
    with PdfPages(path, metadata={"Title": "linktwin kit: print at 100%", "CreationDate": None}) as pdf:
        for page in kit_pages(paper).values():
            pdf.savefig(page)
    return path


def kit_pages(paper: str) -> dict[str, Figure]:
    """The pages by name, in the order in which they are printed: guide, dots, tags, board."""
    if paper not in PAPERS_MM:
        raise ValueError(f"There is no paper {paper!r}; choose {' or '.join(PAPERS_MM)}.")
    width, height = PAPERS_MM[paper]
    pages = {}
    for name, draw in {"guide": _guide, "dots": _dots, "tags": _tags, "board": _board}.items():
        figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=(0, width), ylim=(height, 0))
        axes.axis("off")
        draw(axes, paper)
        _ruler(axes, SIDE, height - 11)
        _words(axes, SIDE + RULER_MM + 4, height - 12.4, "100 mm. Print at 100% (actual size); measure this.", 7)
        pages[name] = figure
    return pages


def dot_places(paper: str) -> list[PlacedDot]:
    """Where the dots are on their page, row by row: an ink after the other, large ones first."""
    width, y, dots = PAPERS_MM[paper][0], TOP + 14.0, []
    for size in kit.DOT_SIZES:
        ring = 1e3 * size.ring_m
        pitch = ring + DOT_GAP_MM
        count = int((width - 2 * SIDE + DOT_GAP_MM) / pitch)
        y += 6.0
        for ink in kit.INKS:
            dots += [PlacedDot(SIDE + ring / 2 + k * pitch, y + ring / 2, size, ink) for k in range(count)]
            y += pitch
        y += 2.0
    return dots


def tag_places(paper: str) -> dict[int, tuple[float, float]]:
    """Centre of each bed tag on its page [mm]."""
    width = PAPERS_MM[paper][0]
    dx, dy = TAG_CARD_MM[0] + TAG_GAP_MM[0], TAG_CARD_MM[1] + TAG_GAP_MM[1]
    left = (width - TAG_COLUMNS * dx + TAG_GAP_MM[0]) / 2 + TAG_CARD_MM[0] / 2
    top = TOP + 20.0 + TAG_CARD_MM[0] / 2
    return {tag: (left + k % TAG_COLUMNS * dx, top + k // TAG_COLUMNS * dy) for k, tag in enumerate(kit.TAG_IDS)}


def board_place(paper: str) -> tuple[float, float]:
    """Upper left corner of the board on its page [mm]."""
    width, height = PAPERS_MM[paper]
    long = 1e3 * kit.BOARD_SQUARE_M
    return (width - kit.BOARD_COLUMNS * long) / 2, (height - 4 - kit.BOARD_ROWS * long) / 2


def _guide(axes: Axes, paper: str) -> None:
    _words(axes, SIDE, TOP - 4, "How to film a mechanism", 15, weight="bold")
    y = TOP + 9.0
    for title, lines in GUIDE:
        _words(axes, SIDE, y, title, 9.2, weight="bold")
        _words(axes, SIDE + 29.0, y + 0.1, "\n".join(lines), 8.4)
        y += 4.6 * len(lines) + 2.0
    set_up(axes, SIDE, y + 3.0, PAPERS_MM[paper][0] - 2 * SIDE)


def _dots(axes: Axes, paper: str) -> None:
    _words(axes, SIDE, TOP - 4, "Ringed dots", 15, weight="bold")
    _words(
        axes,
        SIDE,
        TOP + 4,
        "Cut along the grey line and keep the white ring: it is what places the dot. Use one ink for a mechanism,\n"
        "one that the bed and the bars do not show. A pin through the white point centres a dot on its joint.",
        8.2,
    )
    seen: set[kit.DotSize] = set()
    for dot in dot_places(paper):
        disc, ring = 1e3 * dot.size.disc_m, 1e3 * dot.size.ring_m
        if dot.size not in seen:
            seen.add(dot.size)
            title = f"{disc:.0f} mm dot, {ring:.0f} mm ring: pixels of {disc / 24:.2g} to {disc / 8:.2g} mm on the bed"
            _words(axes, SIDE, dot.y_mm - ring / 2 - 5.2, title, 8.2, weight="bold")
        at = (dot.x_mm, dot.y_mm)
        axes.add_patch(Circle(at, ring / 2, facecolor="white", edgecolor="0.6", linewidth=CUT / MM_PER_INCH * 72))
        axes.add_patch(Circle(at, disc / 2, facecolor=dot.ink.rgb, linewidth=0))
        axes.add_patch(Circle(at, 0.2, facecolor="white", linewidth=0))


def _tags(axes: Axes, paper: str) -> None:
    side, (wide, high) = 1e3 * kit.TAG_SIDE_M, TAG_CARD_MM
    _words(axes, SIDE, TOP - 4, "Bed tags", 15, weight="bold")
    _words(
        axes,
        SIDE,
        TOP + 4,
        f"{kit.TAG_FAMILY}, black square {side:.0f} mm. Cut along the grey line and keep the white margin. Glue four\n"
        "or more flat on the bed, round the mechanism, far apart. Measure each tag's centre, where its side marks\n"
        'cross, to half a millimetre, and list it in the bed file: "tags": [{"id": 0, "x_m": -0.3, "y_m": 0.15}]',
        8.2,
    )
    for tag, (x, y) in tag_places(paper).items():
        corner = (x - wide / 2, y - wide / 2)
        axes.add_patch(Rectangle(corner, wide, high, fill=False, edgecolor="0.6", linewidth=CUT / MM_PER_INCH * 72))
        _cells(axes, x - side / 2, y - side / 2, side / 8, kit.tag_cells(tag))
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):  # short, so that the tag keeps a cell of white round it
            reach = np.array([wide / 2 - 2.4, wide / 2])
            axes.plot(x + dx * reach, y + dy * reach, color=DARK, linewidth=0.6, solid_capstyle="butt")
        _words(axes, x - wide / 2 + 8, y + wide / 2 + 0.6, f"bed tag {tag}", 9, weight="bold")
        _words(axes, x + wide / 2 - 8, y + wide / 2 + 1.0, f"{side:.0f} mm", 7, ha="right")


def _board(axes: Axes, paper: str) -> None:
    x, y = board_place(paper)
    square, marker = 1e3 * kit.BOARD_SQUARE_M, 1e3 * kit.BOARD_MARKER_M
    columns, rows = kit.BOARD_COLUMNS, kit.BOARD_ROWS
    _words(
        axes,
        x,
        6.5,
        f"ChArUco {columns} x {rows}: squares {square:.0f} mm, markers {marker:.0f} mm, {kit.BOARD_FAMILY}\n"
        "Lens board: glue it to a flat plate. Film it with the settings of your clips, then: linktwin calibrate CLIP",
        8.2,
    )
    _cells(axes, x, y, square, kit.board_squares())
    for mx, my, cells in kit.board_markers():
        _cells(axes, x + 1e3 * mx, y + 1e3 * my, marker / len(cells), cells)
    _ruler(axes, x - 3, y, upright=True)


def _cells(axes: Axes, x: float, y: float, cell: float, black: Bool[np.ndarray, "r c"]) -> None:
    """Black cells as one outline: viewers would show seams between separate squares."""
    rows, columns = np.nonzero(black)
    corner = np.stack([x + cell * columns, y + cell * rows], 1)
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * cell
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
    outline = Outline((corner[:, None] + ring).reshape(-1, 2), codes * len(corner))
    axes.add_patch(PathPatch(outline, facecolor="black", linewidth=0, snap=False))


def _ruler(axes: Axes, x: float, y: float, upright: bool = False) -> None:
    """100 mm with a tick at every millimetre, from (x, y) to the right or downwards."""
    lines = [[(0.0, 0.0), (RULER_MM, 0.0)]]
    for k in range(int(RULER_MM) + 1):
        tick = 4.0 if k % 10 == 0 else 2.8 if k % 5 == 0 else 1.8
        lines.append([(k, 0.0), (k, -tick)])
    turned = [[(x + v, y + u) if upright else (x + u, y + v) for u, v in line] for line in lines]
    axes.add_collection(LineCollection(turned, colors=DARK, linewidths=0.35, snap=False), autolim=False)
    for k in range(0, int(RULER_MM) + 1, 50):
        at = (x - 6.8, y + k - 1.0) if upright else (x + k, y + 0.8)
        _words(axes, *at, str(k), 6, ha="center")


def _words(axes: Axes, x: float, y: float, text: str, size: float, **style: Any) -> None:
    """Text whose upper left corner is at (x, y) [mm]; size in points."""
    axes.text(x, y, text, fontsize=size, va="top", color=DARK, linespacing=1.35, parse_math=False, **style)
