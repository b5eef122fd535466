"""How to film, as the kit prints it: headings, lines short enough for a page, and a sketch of the set-up."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

INK, FAINT, RED = "0.15", "0.65", (0.78, 0.06, 0.12)

GUIDE: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "Print",
        (
            'At 100% ("actual size", not "fit to page"). The ruler below must measure 100 mm to half a',
            "millimetre. Matt paper: gloss reflects the lamps.",
        ),
    ),
    (
        "Camera",
        (
            "On a stand that does not shake, looking square at the bed (within 5 degrees), 0.6 to 1.2 m away.",
            "The bed fills the picture. Every millimetre that a dot lies above the tags shifts it by up to 0.7 mm",
            "at the picture's corners: measure that height and give it as marker_height_m.",
            "The 1x lens, no zoom, stabilisation off; hold a finger on the picture until focus and exposure lock.",
        ),
    ),
    (
        "Picture rate",
        (
            "240 or 120 pictures a second for falling and springing parts, 60 for slow ones; 1080p or more.",
            "A dot is at least 8 pixels across. For a picture 1920 pixels wide:",
            "bed up to 1.4 m wide: 6 mm dots.   Up to 1.9 m: 8 mm dots.   Up to 2.8 m: 12 mm dots.",
        ),
    ),
    (
        "Light",
        (
            "Bright and even, from two sides, low enough that the camera sees no reflection in the bed.",
            "Daylight or lamps that do not flicker. No coloured light. Keep your shadow out.",
        ),
    ),
    (
        "Shutter",
        (
            "1/1000 s or shorter, set by hand where the camera allows it: a dot at 1 m/s moves 1 mm meanwhile.",
            "If the picture gets dark, add light.",
        ),
    ),
    (
        "Dots and bars",
        (
            "One dot on each marker of the drawing, all of one ink. Put a dot on both pins of a bar and measure",
            "their distance to 0.1 mm: bars of known length check the scale.",
            "Dots face the camera and lie at one height where possible. Nothing else in view has their colour.",
        ),
    ),
    (
        "Bed tags",
        (
            "Four or more (six are better) flat in one plane, round the mechanism and near the picture's edges,",
            "never covered at the start. Measure their centres to half a millimetre from one origin.",
        ),
    ),
    (
        "Lens board",
        (
            "Once per camera and setting (same size of picture, rate, lens and focus), 20 to 40 s. Hold the flat",
            "board as far away as the bed or nearer, still for a second in each of 20 places: the middle, the four",
            "edges and four corners of the picture; in each place leaning 20 to 40 degrees to another side.",
            "Then:  linktwin calibrate board.mp4 --out camera",
        ),
    ),
    (
        "The take",
        (
            "Start recording at the drawn pose, every dot in view. Leave everything still for a full second, then",
            "release, hands out of the picture. Record until it rests. Do not touch the camera; do three takes.",
        ),
    ),
    (
        "The file",
        (
            "The camera's own file, copied by cable or as unmodified original. No editing, no messenger, no",
            "slow-motion export: these change the clock, drop pictures and blur the dots.",
            "Note what you loaded, the masses and lengths you measured, and which take is which.",
        ),
    ),
)


def set_up(axes: Axes, x: float, y: float, width: float) -> None:
    """Sketch the set-up at (x, y), y down [mm]: from the side, and as the camera sees it; 56 mm high."""
    _from_the_side(axes, x, y)
    _in_the_picture(axes, x + 84.0, y, width - 84.0)


def _from_the_side(axes: Axes, x: float, y: float) -> None:
    bed = y + 46.0
    axes.plot([x, x + 72], [bed, bed], color=INK, linewidth=1.4)
    axes.add_patch(Rectangle((x + 31, y + 2), 10, 6, facecolor=INK))
    axes.add_patch(Rectangle((x + 34.5, y + 8), 3, 2, facecolor=INK))
    axes.plot([x + 6, x + 36, x + 66], [bed, y + 10, bed], color=FAINT, linewidth=0.6, linestyle="--")
    axes.add_patch(Rectangle((x + 22, bed - 2.2), 26, 1.4, facecolor=FAINT))
    for at in (24, 46):
        axes.add_patch(Rectangle((x + at - 1.2, bed - 2.9), 2.4, 0.7, facecolor=RED))
    for at, corners in ((2, ((0, 14), (6, 10), (8, 14), (2, 18))), (70, ((0, 14), (-6, 10), (-8, 14), (-2, 18)))):
        axes.add_patch(
            Polygon([(x + at + u, y + v) for u, v in corners], facecolor="none", edgecolor=INK, linewidth=0.8)
        )
    axes.annotate("", (x + 36, bed), (x + 36, y + 10.5), arrowprops={"arrowstyle": "<->", "lw": 0.6, "color": INK})
    for at, down, text in (
        (37, 33, "0.6 to 1.2 m"),
        (43, 3.2, "camera, square to the bed"),
        (0, 19, "lamp"),
        (64, 19, "lamp"),
        (0, 48, "bed with tags; measure how high the dots lie above them"),
    ):
        axes.text(x + at, y + down, text, fontsize=7.2, va="top", color=INK)


def _in_the_picture(axes: Axes, x: float, y: float, width: float) -> None:
    high = 46.0
    axes.add_patch(Rectangle((x, y), width, high, facecolor="0.93", edgecolor=INK, linewidth=1.0))
    for u in (5.0, width / 2, width - 5.0):
        for v in (5.0, high - 5.0):
            axes.add_patch(Rectangle((x + u - 3, y + v - 3), 6, 6, facecolor="white"))
            axes.add_patch(Rectangle((x + u - 2, y + v - 2), 4, 4, facecolor="black"))
    joints = [(0.16, 31.0), (0.30, 16.0), (0.66, 13.0), (0.82, 31.0)]
    at = [(x + share * width, y + v) for share, v in joints]
    axes.plot(*zip(*at, strict=True), color="0.55", linewidth=4.5, solid_capstyle="round")
    for centre in at:
        axes.add_patch(Circle(centre, 2.1, facecolor="white", linewidth=0, zorder=3))
        axes.add_patch(Circle(centre, 1.4, facecolor=RED, linewidth=0, zorder=3))
    axes.text(
        x + 0.48 * width, y + 23.0, "a dot on both pins of each bar", fontsize=7.2, ha="center", va="top", color=INK
    )
    axes.text(x, y + 48.0, "the picture: six tags near its edges, every dot in view", fontsize=7.2, va="top", color=INK)
