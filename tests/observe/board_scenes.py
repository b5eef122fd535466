"""The printed board, photographed by a camera of known lens: rays from OpenCV's model, the page as the texture."""

from functools import cache

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Circle

from backend.observe.board_views import BoardView
from backend.observe.kit import INKS, board_corners_m
from backend.report.kit_pages import MM_PER_INCH, PAPERS_MM, board_place, kit_pages, tag_places

SIZE = (1280, 720)
K = np.array([[1003.0, 0, 646.0], [0, 1001.0, 353.0], [0, 0, 1]])
BENDS = np.array([0.09, -0.18, 0.0008, -0.0005, 0.0])  # a phone's main lens
DPI = 127  # 5 px per mm: whole pixels on A4


@cache
def page(name, dots_mm=()):
    """A page of the kit, softened a little: a camera's lens is never sharper.  In colour where dots are added."""
    figure = kit_pages("a4")[name]
    for at in dots_mm:
        figure.axes[0].add_patch(Circle(at, 4.0, facecolor=INKS[0].rgb, linewidth=0))
    figure.set_dpi(DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    seen = np.asarray(canvas.buffer_rgba())[..., :3]
    seen = seen if dots_mm else cv2.cvtColor(seen, cv2.COLOR_RGB2GRAY)
    return cv2.GaussianBlur(seen, (0, 0), 1.5).astype(np.float32)


@cache
def rays(size=SIZE):
    """Directions of the pixels' rays, z = 1; the lens scales with the picture."""
    scale = size[0] / SIZE[0]
    u, v = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    px = (np.stack([u, v], -1).reshape(-1, 1, 2) + 0.5) / scale - 0.5
    exact = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-12)
    xy = cv2.undistortPoints(px, K, BENDS, criteria=exact)
    return np.c_[xy.reshape(-1, 2), np.ones(len(px))].reshape(size[1], size[0], 3)


def lean(about_x_deg, about_y_deg, about_z_deg=0.0):
    """A rotation from the page (x right, y down, z into it) to the camera's axes."""
    a, b, c = np.deg2rad([about_x_deg, about_y_deg, about_z_deg])
    return cv2.Rodrigues(np.array([a, b, 0]))[0] @ cv2.Rodrigues(np.array([0, 0, c]))[0]


def photograph(R, middle_mm, name="board", about_mm=None, size=SIZE, noise=1.5, seed=0, dots_mm=()):
    """The page seen with its point `about_mm` (default: the board's middle) at `middle_mm` before the camera."""
    texture = page(name, dots_mm)
    about = np.array([*(about_mm or (PAPERS_MM["a4"][0] / 2, board_place("a4")[1] + 112.5)), 0.0])
    normal, t = R[:, 2], np.asarray(middle_mm, float) - R @ about
    ray = rays(size)
    on_page = (ray * ((normal @ t) / (ray @ normal))[..., None] - t) @ R
    at = (on_page[..., :2] * DPI / MM_PER_INCH - 0.5).astype(np.float32)
    picture = cv2.remap(texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=(90.0, 90.0, 90.0))
    sensor = 20 + 0.75 * picture + np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(np.round(sensor), 0, 255).astype(np.uint8)


def board_poses(count, seed=0, lean_deg=35.0):
    """Places over the whole picture, 380 to 560 mm away, leaning every way."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        away = rng.uniform(380, 560)
        across = np.array([(-1, 0, 1)[k % 3] * 0.40, (-1, 0, 1)[k // 3 % 3] * 0.17]) + rng.uniform(-0.06, 0.06, 2)
        turn = rng.uniform(-20, 20) + (90 if k % 2 else 0)
        yield lean(*rng.uniform(-lean_deg, lean_deg, 2), turn), (across[0] * away, across[1] * away, away)


def computed_views(seed, count=14, sag_mm=0.0):
    """Corners where the lens puts them, with 0.05 px of noise; a bent board's ends rise by `sag_mm`."""
    rng, drawn = np.random.default_rng(seed), []
    at = 1e3 * board_corners_m() - np.array([87.5, 112.5, 0])
    at[:, 2] = sag_mm * (at[:, 1] / at[:, 1].max()) ** 2
    for R, middle in board_poses(count, seed=seed):
        px = cv2.projectPoints(at, cv2.Rodrigues(R)[0], np.array(middle), K, BENDS)[0].reshape(-1, 2)
        inside = ((px > 0) & (px < np.array(SIZE) - 1)).all(1)
        drawn.append(
            BoardView(np.flatnonzero(inside), px[inside] + rng.normal(0, 0.05, (inside.sum(), 2)), 0.4, "drawn")
        )
    return drawn


def tag_centres_mm():
    """Bed tags on their page [mm]."""
    return tag_places("a4")
