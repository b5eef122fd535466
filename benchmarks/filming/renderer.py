"""Pictures from rays: every pixel's ray meets the bed, the bars, the targets and what covers them.

Reflectances are composed for each of several moments of the shutter, each row at its own time; the moments' light is
averaged, blurred by the lens, given noise, sharpened and encoded.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from jaxtyping import Float, UInt8

from benchmarks.filming.bed import PAPER, lookup, printed, tag_cells
from benchmarks.filming.linkages import DOT_HEIGHT_M, LAYERS_M, Filmed
from benchmarks.filming.scene import RED, Cover, Scene

Array = np.ndarray
EXPOSURES = 4
LENS_BLUR_PX = 0.65
BAR_HALF_M, DOT_M, RING_M, TARGET_TAG_M = 0.005, 0.004, 0.006, 0.024
SUN = np.array([0.55, -0.4])  # a shadow's way over the bed for each metre that its bar is up
GAMMA = (255 * np.linspace(0, 1, 16384) ** (1 / 2.2)).astype(np.float32)
TICK = Fraction(1, 1_000_000)
FIRST_TARGET_TAG = 20


class Canvas:
    """One moment: what every pixel sees, painted from the bed upwards."""

    def __init__(self, scene: Scene, time_s: float, slopes: Array, place: Array, bed: Array):
        self.rows = scene.optics.row_times(time_s)[:, None]
        self.slopes, self.place, self.picture = slopes, place, bed.copy()
        self.metres_per_px = scene.optics.height_m / scene.optics.focal_px
        self.optics, self.time_s = scene.optics, time_s

    def window(self, points: Float[Array, "n 3"], reach_m: float) -> tuple[slice, slice]:
        """The part of the picture within reach of some points."""
        px = self.optics.see(points, np.full(len(points), self.time_s))
        margin = reach_m / self.metres_per_px * 1.15 + 3
        low, high = np.floor(px.min(0) - margin), np.ceil(px.max(0) + margin) + 1
        u0, u1 = (int(np.clip(c, 0, self.optics.width)) for c in (low[0], high[0]))
        v0, v1 = (int(np.clip(c, 0, self.optics.height)) for c in (low[1], high[1]))
        return slice(v0, v1), slice(u0, u1)

    def ground(self, where: tuple[slice, slice], height_m: float) -> tuple[Array, Array]:
        """Where the window's rays meet a height, x and y [m]."""
        place = self.place[where[0]] if len(self.place) > 1 else self.place
        drop = height_m - place[..., 2]
        slope = self.slopes[where]
        return place[..., 0] + slope[..., 0] * drop, place[..., 1] + slope[..., 1] * drop

    def lay(self, where: tuple[slice, slice], cover: Array, colour: Array) -> None:
        """Paint over, by coverage."""
        under = self.picture[where]
        under += cover[..., None] * (colour - under)

    def capsule(self, ends: Array, rates: Array, when: float, layer: int, shadow: bool) -> None:
        """A bar between two points that move, or its shadow."""
        height = LAYERS_M[layer]
        a, b = ends.copy(), ends.copy()
        shift = SUN * height if shadow else np.zeros(2)
        level = 0.0 if shadow else height
        a, b = (np.array([*(p[:2] + shift), level]) for p in ends)
        where = self.window(np.stack([a, b]), BAR_HALF_M + (0.003 if shadow else 0.0))
        x, y = self.ground(where, level)
        late = (self.rows[where[0]] - when).astype(np.float32)
        ax, ay = a[0] + rates[0, 0] * late, a[1] + rates[0, 1] * late
        bx, by = b[0] + rates[1, 0] * late, b[1] + rates[1, 1] * late
        away = capsule_distance(x, y, ax, ay, bx, by) - np.float32(BAR_HALF_M)
        if shadow:
            self.picture[where] *= (1 - 0.4 * np.clip(0.5 - away / 0.003, 0, 1))[..., None]
            return
        shade = (0.27, 0.36)[layer] * (1 - 0.25 * np.clip(1 + away / BAR_HALF_M, 0, 1) ** 2)
        self.lay(where, np.clip(0.5 - away / self.metres_per_px, 0, 1), shade[..., None])

    def disc(self, at: Array, rate: Array, when: float, height: float, rings: tuple) -> None:
        """Concentric discs (radius, colour), the largest first; four rays a pixel."""
        where = self.window(at[None], rings[0][0] + np.hypot(*rate[:2]) * 1e-3)
        x, y = self.ground(where, height)
        if 0 in x.shape:
            return
        late = (self.rows[where[0]] - when).astype(np.float32)
        x, y = x - at[0] - rate[0] * late, y - at[1] - rate[1] * late
        dxu, dxv = np.gradient(x, axis=1), np.gradient(x, axis=0)
        dyu, dyv = np.gradient(y, axis=1), np.gradient(y, axis=0)
        quarter = [(-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)]
        r = [np.hypot(x + dxu * i + dxv * j, y + dyu * i + dyv * j) for i, j in quarter]
        for radius, colour in rings:
            cover = sum(np.clip(0.5 - (q - radius) / (0.5 * self.metres_per_px), 0, 1) for q in r) / 4
            self.lay(where, cover, np.array(colour, np.float32))

    def tag(self, at: Array, angle: float, cells: Array) -> None:
        """A square tag that turns with its bar; 36 rays a pixel."""
        where = self.window(at[None], 0.75 * TARGET_TAG_M)
        x, y = self.ground(where, DOT_HEIGHT_M)
        c, s, n, fine = np.cos(angle), np.sin(angle), len(cells), 6
        cell = TARGET_TAG_M / n
        total, cover = 0.0, 0.0
        for i in range(fine):
            for j in range(fine):
                dx = x - at[0] + ((i + 0.5) / fine - 0.5) * self.metres_per_px
                dy = y - at[1] + ((j + 0.5) / fine - 0.5) * self.metres_per_px
                column = np.floor((c * dx + s * dy) / cell + n / 2).astype(int)
                row = np.floor(n / 2 - (c * dy - s * dx) / cell).astype(int)
                inside = (column >= 0) & (column < n) & (row >= 0) & (row < n)
                cover = cover + inside / fine**2
                total = total + inside * cells[row.clip(0, n - 1), column.clip(0, n - 1)] / fine**2
        self.picture[where] = self.picture[where] * (1 - cover)[..., None] + total[..., None]

    def cover(self, thing: Cover) -> None:
        """Something held over the bed."""
        cx, cy = thing.path(self.time_s + 0.5 * self.optics.readout_s)
        parts = np.array(thing.capsules) + np.array([cx, cy, cx, cy, 0])
        corners = np.c_[parts[:, [0, 2]].ravel(), parts[:, [1, 3]].ravel(), np.full(2 * len(parts), thing.height_m)]
        where = self.window(corners, float(parts[:, 4].max()))
        if 0 in self.picture[where].shape:
            return
        x, y = self.ground(where, thing.height_m)
        away = np.min([capsule_distance(x, y, *p[:4]) - p[4] for p in parts], axis=0)
        body = np.array(thing.colour) * (1 - 0.3 * np.clip(1 + away / 0.01, 0, 1) ** 2)[..., None]
        self.lay(where, np.clip(0.5 - away / self.metres_per_px, 0, 1), body)


def capsule_distance(x: Array, y: Array, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    """Distance [m] from a line between two ends."""
    dx, dy = bx - ax, by - ay
    along = np.clip(((x - ax) * dx + (y - ay) * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0, 1)
    return np.hypot(x - ax - along * dx, y - ay - along * dy)


class Film:
    """Draws the pictures of one clip."""

    def __init__(self, filmed: Filmed, scene: Scene):
        self.filmed, self.scene, self.rng = filmed, scene, np.random.default_rng(scene.seed)
        self.velocity = filmed.path.derivative()
        self.atlas = printed(scene)
        self.still = None if scene.optics.shake.amount else self._bed_at(0.0)
        h, w = scene.optics.height, scene.optics.width
        v, u = np.mgrid[0:h, 0:w].astype(np.float32)
        self.light = (1.05 - 0.5 * ((u / w - 0.62) ** 2 + (v / h - 0.35) ** 2))[..., None]
        self.index = {name: k for k, name in enumerate(filmed.points)}

    def _bed_at(self, time_s: float) -> tuple[Array, Array, Array]:
        slopes, place = self.scene.optics.slopes(time_s)
        on_bed = place[..., :2] - slopes * place[..., 2:]
        du, dv = np.gradient(on_bed, axis=1), np.gradient(on_bed, axis=0)
        thirds = [(i / 3, j / 3) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        bed = sum(lookup(self.atlas, on_bed + du * i + dv * j) for i, j in thirds) / 9
        return slopes, place if self.scene.optics.shake.amount else place[:1], bed

    def moment(self, time_s: float) -> Float[Array, "h w 3"]:
        """The light of one moment."""
        scene, filmed = self.scene, self.filmed
        canvas = Canvas(scene, time_s, *(self.still or self._bed_at(time_s)))
        _, seen_s = scene.optics.film(filmed.path, time_s)
        when = seen_s[: len(filmed.markers)]
        for shadow in (True, False):
            for layer in (0, 1):
                for bar, a, b in filmed.bars:
                    if bar.layer == layer:
                        pair = [self.index[a], self.index[b]]
                        t = float(seen_s[pair].mean())
                        canvas.capsule(filmed.path(t)[pair], self.velocity(t)[pair], t, layer, shadow)
        each = np.arange(len(when))
        at, rate = filmed.at(when)[each, each], self.velocity(when)[each, each]
        rings = ((DOT_M, RED),) if scene.target == "plain" else ((RING_M, (PAPER,) * 3), (DOT_M, RED))
        for k in each:
            if scene.target == "tag":
                canvas.tag(at[k], self._angle(int(k), float(when[k])), tag_cells(FIRST_TARGET_TAG + int(k)))
            else:
                canvas.disc(at[k], rate[k], float(when[k]), DOT_HEIGHT_M, rings)
        for thing in scene.covers:
            canvas.cover(thing)
        return canvas.picture * self.light * scene.gain(time_s)

    def _angle(self, k: int, time_s: float) -> float:
        """The direction of the bar that a marker's tag is stuck on."""
        name = self.filmed.markers[k]
        a, b = next((a, b) for _, a, b in self.filmed.bars if name in (a, b))
        p = self.filmed.path(time_s)
        return float(np.arctan2(*(p[self.index[b]] - p[self.index[a]])[[1, 0]]))

    def frame(self, time_s: float) -> UInt8[Array, "h w 3"]:
        """One picture, RGB."""
        scene = self.scene
        opening = scene.shutter_s * ((np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5)
        light = sum(self.moment(time_s + float(o)) for o in opening) / EXPOSURES
        light = cv2.GaussianBlur(np.asarray(light, np.float32), (0, 0), LENS_BLUR_PX)
        grain = np.sqrt(scene.read_noise**2 + scene.shot_noise * np.maximum(light, 0))
        light += grain * self.rng.standard_normal(light.shape, np.float32)
        codes = GAMMA[(np.clip(light, 0, 1) * (len(GAMMA) - 1)).astype(np.uint16)]
        if scene.sharpening:
            codes += scene.sharpening * (codes - cv2.GaussianBlur(codes, (0, 0), 1.2))
        return np.clip(codes + 0.5, 0, 255).astype(np.uint8)


def render(path: Path, filmed: Filmed, scene: Scene, frames: int) -> None:
    """Film `frames` pictures to PATH (H.264), and beside it PATH with .npz: time_s, px, seen_s, world_m."""
    film, optics = Film(filmed, scene), scene.optics
    ticks = np.round(np.arange(frames) / scene.rate / float(TICK)).astype(int)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=round(scene.rate))
        stream.width, stream.height, stream.pix_fmt = optics.width, optics.height, "yuv420p"
        stream.codec_context.time_base = TICK
        stream.options = {"preset": "veryfast", "crf": str(scene.crf)}
        for tick in ticks:
            picture = av.VideoFrame.from_ndarray(film.frame(int(tick) * float(TICK)), format="rgb24")
            picture.pts, picture.time_base = int(tick), TICK
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    times = ticks * float(TICK)
    seen = [optics.film(filmed.at, t) for t in times]
    each = np.arange(len(filmed.markers))
    world = np.stack([filmed.at(when)[each, each] for _, when in seen])
    np.savez(
        path.with_suffix(".npz"), time_s=times, px=[p for p, _ in seen], seen_s=[w for _, w in seen], world_m=world
    )
