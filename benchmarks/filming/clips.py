"""The clips of the table, rendered once and kept; and photos of the kit's board by the same camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.spatial.transform import Rotation

from backend.report.kit_pages import kit_pages
from benchmarks.filming.linkages import Filmed, filmed
from benchmarks.filming.optics import Optics, Shake
from benchmarks.filming.renderer import render
from benchmarks.filming.scene import BED_TAGS, Scene, Sticker, card, hand, nail

FOLDER = Path("out") / "rendered_clips"
PX_PER_MM = 6
REACH = hand(-0.02, -0.33, 0.12, 0.42)
BLUE, GREEN = (0.02, 0.05, 0.5), (0.02, 0.22, 0.06)


@dataclass(frozen=True)
class Clip:
    """A mechanism in a scene for so many frames."""

    name: str
    linkage: str
    scene: Scene
    frames: int
    cells: int = 10

    @cached_property
    def filmed(self) -> Filmed:
        """The motion that is filmed."""
        duration_s = self.frames / self.scene.rate
        kept = FOLDER / f"motion_{self.linkage.replace(' ', '_')}_{self.cells}_{1e3 * duration_s:.0f}ms.npz"
        return filmed(self.linkage, duration_s, self.cells, kept if FOLDER.is_dir() else None)

    def path(self, folder: Path = FOLDER) -> Path:
        """Where the clip is, or will be."""
        return folder / f"{self.name.replace(' ', '_')}_{self.scene.target}.mp4"

    def made(self, folder: Path = FOLDER) -> Path:
        """The clip, rendered where it is not there yet."""
        path = self.path(folder)
        if not path.with_suffix(".npz").exists():
            folder.mkdir(parents=True, exist_ok=True)
            render(path, self.filmed, self.scene, self.frames)
        return path

    def plain(self) -> Clip:
        """The same with bare dots in place of ringed ones."""
        return replace(self, scene=replace(self.scene, target="plain"))


STICKERS = (
    *(Sticker(p) for p in ((0.02, 0.075), (-0.15, -0.065), (0.24, 0.055))),
    *(Sticker(p, ringed=False) for p in ((-0.05, 0.085), (0.12, -0.07))),
    *(Sticker(p, colour) for p, colour in (((0.1, 0.08), BLUE), ((-0.2, 0.07), GREEN))),
)
CLIPS = (
    Clip("scissor", "scissor", Scene(seed=1), 160),
    Clip("long shutter", "four-bar", Scene(shutter_s=3e-3, seed=2), 160),
    Clip("warm light drifts", "scissor", Scene(cast=(1.15, 0.85, 0.5), drift=-0.6, flicker=0.05, seed=3), 160),
    Clip("60 a second", "scissor", Scene(rate=60.0, shutter_s=2e-3, seed=4), 50),
    Clip("300 mm card", "scissor", Scene(covers=(card(0.3, 0.47, -1.2),), seed=5), 190),
    Clip("hand", "scissor", Scene(covers=(REACH, nail(REACH)), seed=6), 180),
    Clip("stickers", "scissor", Scene(stickers=STICKERS, seed=7), 160),
    Clip("noise and crf 30", "scissor", Scene(read_noise=0.006, shot_noise=1e-3, crf=30, seed=8), 160),
    Clip("shaken", "double pendulum", Scene(optics=Optics(shake=Shake(1.0)), seed=9), 120),
    Clip("tags", "double pendulum", Scene(target="tag", seed=10), 160),
)


def bed(clip: Clip) -> dict:
    """What a person with a ruler writes into the bed file of any of these clips."""
    tags = [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in BED_TAGS.items()]
    exact = {"mark_sd_m": 0.0, "marker_height_sd_m": 1e-6}  # as rendered: nothing was printed or measured
    return {"tags": tags, "marker_height_m": 0.012, "readout_s": clip.scene.optics.readout_s, **exact}


def board_photos(folder: Path = FOLDER, optics: Optics | None = None, count: int = 24) -> list[Path]:
    """Photos of the kit's board, leaning this way and that all over the picture."""
    optics = optics or Optics()
    paths = [folder / f"board_{k:02d}.png" for k in range(count)]
    if all(p.exists() for p in paths):
        return paths
    folder.mkdir(parents=True, exist_ok=True)
    figure = kit_pages("a4")["board"]
    figure.set_dpi(25.4 * PX_PER_MM)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    page = cv2.cvtColor(np.asarray(canvas.buffer_rgba())[..., :3], cv2.COLOR_RGB2GRAY).astype(np.float32)
    page = cv2.GaussianBlur(page, (0, 0), 1.5)
    middle = np.array([page.shape[1], page.shape[0]]) / PX_PER_MM / 2
    ray = np.concatenate([optics.rays, np.ones_like(optics.rays[..., :1])], -1)
    rng = np.random.default_rng(77)
    for k, path in enumerate(paths):
        away = np.array([(-0.22, 0.0, 0.22)[k % 3], (-0.1, 0.1)[k // 3 % 2], 1.0]) * rng.uniform(380, 560)
        lean = np.deg2rad(rng.uniform(20, 40)) * np.array([np.cos(k * 2.4), np.sin(k * 2.4), 0])
        turn = (Rotation.from_rotvec(lean) * Rotation.from_euler("z", rng.uniform(0, 360), degrees=True)).as_matrix()
        t = away - turn @ [*middle, 0]
        depth = (turn[:, 2] @ t) / (ray @ turn[:, 2])
        at = ((ray * depth[..., None] - t) @ turn)[..., :2] * PX_PER_MM - 0.5
        seen = cv2.remap(page, *np.moveaxis(at.astype(np.float32), -1, 0), cv2.INTER_LINEAR, borderValue=(80.0,))
        seen = 18 + 0.78 * cv2.GaussianBlur(seen, (0, 0), 0.65) + rng.normal(0, 1.8, seen.shape)
        cv2.imwrite(str(path), np.clip(seen, 0, 255).astype(np.uint8))
    return paths
