"""Film a motion: a clip with ringed dots, bars, a printed bed, blur and noise, and the truth beside it.

The picture is made from geometry alone and shares nothing with the tracker that will read it. Everything
that moves is drawn inside small regions; the bed is drawn once. Light adds up in linear units, exposures
are averaged over the shutter, and only then is the picture encoded (gamma 2.2, BT.601, limited range).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from jaxtyping import Float, UInt8

from backend.blind.camera import Bed, Camera

Array = np.ndarray
TICK = Fraction(1, 1_000_000)  # the clip's clock: times are kept to half a microsecond
BLUR_PX = 0.7  # standard deviation of the lens blur
BAR_LEVEL = 0.18
RED = (0.60, 0.03, 0.03)


@dataclass(frozen=True)
class Occluder:
    """A grey card held over the bed from start_s to end_s: `corners_m` (4, 2) in bed coordinates [m]."""

    corners_m: tuple[tuple[float, float], ...]
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Look:
    """What the dots and the sensor look like.  Colours are linear RGB, noise is in 8-bit luma codes."""

    dot_radius_m: float = 0.004
    ring_radius_m: float = 0.006
    dot_colour_rgb: tuple[float, float, float] = RED
    bar_width_m: float = 0.010
    shutter_s: float = 1e-3
    exposures: int = 4
    noise_codes: float = 2.0
    light_falloff: float = 0.25
    crf: int = 18
    seed: int = 0


def edge(signed_px: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Coverage inside a straight edge, blurred by the lens: 1 inside, 0 outside."""
    t = np.clip(0.5 - signed_px / (4.4 * BLUR_PX), 0, 1)  # smoothstep with the blur's standard deviation
    return t * t * (3 - 2 * t)


def encode(rgb: Float[Array, "*s 3"]) -> Float[Array, "*s 3"]:
    """Y, Cb, Cr codes (BT.601, limited range) of linear light."""
    gamma = np.clip(rgb, 0, 1) ** (1 / 2.2)
    matrix = np.array([[65.481, -37.797, 112.0], [128.553, -74.203, -93.786], [24.966, 112.0, -18.214]])
    return gamma @ matrix.astype(gamma.dtype) + np.array([16, 128, 128], gamma.dtype)


def grey_codes(level: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """Luma codes of neutral linear light."""
    return 16 + 219 * np.clip(level, 0, 1) ** (1 / 2.2)


class Film:
    """The unmoving part of a scene, and the drawing of one frame over it."""

    def __init__(self, camera: Camera, bed: Bed, look: Look):
        self.camera, self.bed, self.look = camera, bed, look
        self.slopes = camera.slopes()
        self.place = camera.position_m
        self.metres_per_px = camera.height_m / camera.focal_px
        self.rng = np.random.default_rng(look.seed)
        h, w = camera.height_px, camera.width_px
        v, u = np.mgrid[0:h, 0:w]
        off = ((u / w - 0.58) ** 2 + (v / h - 0.42) ** 2).astype(np.float32)
        self.light = 1 - look.light_falloff * off / 0.5
        self.bar_codes = grey_codes(BAR_LEVEL * self.light).astype(np.uint8)
        self.luma, self.cb, self.cr = self._draw_bed()
        grain = self.rng.normal(0, look.noise_codes, (h + 64, w + 64))
        self.grain = np.round(grain).astype(np.int16)
        chroma = self.rng.normal(0, look.noise_codes / 2, (h // 2 + 64, w // 2 + 64))
        self.chroma_grain = np.round(chroma).astype(np.int16)

    def _draw_bed(self) -> list[UInt8[Array, "h w"]]:
        h, w = self.light.shape
        xy = self.place[:2] - self.slopes * self.place[2]
        x, y = xy[..., 0], xy[..., 1]
        texture = cv2.GaussianBlur(self.rng.normal(0, 1, (h, w)).astype(np.float32), (0, 0), 3)
        level = 0.55 * (1 + 0.25 * texture)
        for c in (x, y):  # a printed grid, 20 mm apart
            away = np.abs((c + 0.01) % 0.02 - 0.01) - 0.0002
            level *= 1 - 0.25 * edge(away / self.metres_per_px)
        for mx, my in self.bed.marks_m.values():
            r = np.hypot(x - mx, y - my)
            for radius, tone in ((0.006, 0.03), (0.002, 0.8)):
                a = edge((r - radius) / self.metres_per_px)
                level = level * (1 - a) + tone * a
        rgb = np.repeat((level * self.light)[..., None], 3, -1)
        for s in self.bed.stickers:
            r = np.hypot(x - s.x_m, y - s.y_m)
            for radius, tone in ((1.5 * s.radius_m, (0.85,) * 3), (s.radius_m, s.colour_rgb)):
                a = edge((r - radius) / self.metres_per_px)[..., None]
                rgb = rgb * (1 - a) + np.array(tone, np.float32) * self.light[..., None] * a
        codes = encode(rgb.astype(np.float32))
        half = cv2.resize(codes[..., 1:], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        return [np.round(p).clip(0, 255).astype(np.uint8) for p in (codes[..., 0], half[..., 0], half[..., 1])]

    def frame(
        self,
        exposures: Float[Array, "exposure marker 3"],
        links: Sequence[tuple[int, int]],
        cards: Sequence[Occluder],
    ) -> UInt8[Array, "rows w"]:
        """One I420 picture (planes stacked) of the markers' bed positions [m] during one shutter opening."""
        luma, cb, cr = self.luma.copy(), self.cb.copy(), self.cr.copy()
        if links:
            self._draw_bars(luma, cb, cr, exposures, links)
        self._draw_dots(luma, cb, cr, exposures)
        for card in cards:
            at = np.c_[np.asarray(card.corners_m, float), np.full(len(card.corners_m), 0.05)]
            polygon = self.camera.project(at)
            for plane, scale, code in ((luma, 1, 90), (cb, 2, 128), (cr, 2, 128)):
                cv2.fillPoly(plane, [np.round(polygon / scale).astype(np.int32)], code, cv2.LINE_AA)
        for plane, grain in ((luma, self.grain), (cb, self.chroma_grain), (cr, self.chroma_grain)):
            i, j = self.rng.integers(0, 64, 2)
            h, w = plane.shape
            cv2.add(plane, grain[i : i + h, j : j + w], dst=plane, dtype=cv2.CV_8U)
        h, w = luma.shape
        return np.concatenate([luma.reshape(h, w), cb.reshape(h // 4, w), cr.reshape(h // 4, w)])

    def _draw_bars(self, luma: Array, cb: Array, cr: Array, exposures: Array, links: Sequence) -> None:
        h, w = luma.shape
        ends = self.camera.project(exposures)
        margin = self.look.bar_width_m / self.metres_per_px + 4
        used = ends[:, sorted({m for link in links for m in link})].reshape(-1, 2)
        u0, v0 = (np.clip(used.min(0) - margin, 0, [w - 2, h - 2]).astype(int) // 2) * 2
        u1, v1 = (np.clip(used.max(0) + margin, 2, [w, h]).astype(int) // 2) * 2
        if u1 <= u0 or v1 <= v0:
            return
        cover = np.zeros((v1 - v0, u1 - u0), np.uint8)
        half = self.look.bar_width_m / self.metres_per_px / 2
        share = 255 // len(ends)
        for moment in ends:
            mask = np.zeros_like(cover)
            for a, b in links:
                along = moment[b] - moment[a]
                across = half * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
                corners = np.array([moment[a] + across, moment[b] + across, moment[b] - across, moment[a] - across])
                fixed_point = np.round((corners - [u0, v0]) * 16).astype(np.int32)
                cv2.fillConvexPoly(mask, fixed_point, share, cv2.LINE_AA, 4)
            cover += mask
        alpha = cover.astype(np.float32) / (share * len(ends))
        sl = (slice(v0, v1), slice(u0, u1))
        luma[sl] = luma[sl] + alpha * (self.bar_codes[sl].astype(np.float32) - luma[sl])
        small = cv2.resize(alpha, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        sl = (slice(v0 // 2, v1 // 2), slice(u0 // 2, u1 // 2))
        for plane in (cb, cr):
            plane[sl] = plane[sl] + small * (128 - plane[sl].astype(np.float32))

    def _draw_dots(self, luma: Array, cb: Array, cr: Array, exposures: Array) -> None:
        look, (h, w) = self.look, luma.shape
        seen = self.camera.project(exposures)
        middle, spread = seen.mean(0), np.ptp(seen, axis=0).max()
        size = int(2 * np.ceil((look.ring_radius_m / self.metres_per_px * 1.3 + 4 + spread / 2) / 2))
        corner = (np.round(middle).astype(int) - size) // 2 * 2
        k = np.arange(2 * size + 2)
        inside = ((corner >= 0) & (corner + len(k) <= [w, h])).all(1)
        for m in np.flatnonzero(inside):
            (u0, v0), n = corner[m], len(k)
            sl = (slice(v0, v0 + n), slice(u0, u0 + n))
            p = exposures[:, m]
            drop = (p[:, 2] - self.place[2])[:, None, None]
            dx = self.place[0] - p[:, 0, None, None] + self.slopes[sl][..., 0] * drop
            dy = self.place[1] - p[:, 1, None, None] + self.slopes[sl][..., 1] * drop
            r = np.hypot(dx, dy)
            px = self.metres_per_px * (1 - p[0, 2] / self.camera.height_m)
            ring = edge((r - look.ring_radius_m) / px).mean(0)[..., None]
            dot = edge((r - look.dot_radius_m) / px).mean(0)[..., None]
            light = self.light[sl][..., None]
            under = (np.clip(luma[sl].astype(np.float32) - 16, 0, 219) / 219)[..., None] ** 2.2
            rgb = under * (1 - ring) + light * (0.85 * (ring - dot) + np.array(look.dot_colour_rgb) * dot)
            codes = encode(np.broadcast_to(rgb, (n, n, 3)))
            touched = ring[..., 0] > 0
            luma[sl][touched] = np.round(codes[..., 0][touched]).clip(0, 255)
            half = codes[..., 1:].reshape(n // 2, 2, n // 2, 2, 2).mean((1, 3))
            touched = touched[::2, ::2]
            sl = (slice(v0 // 2, (v0 + n) // 2), slice(u0 // 2, (u0 + n) // 2))
            for plane, channel in ((cb, 0), (cr, 1)):
                plane[sl][touched] = np.round(half[..., channel][touched])


def render_clip(
    path: str | Path,
    times_s: Float[Array, "time"],
    markers_m: dict[str, Float[Array, "time 3"]],
    links: Sequence[tuple[str, str]],
    camera: Camera,
    bed: Bed,
    look: Look | None = None,
    occluders: Sequence[Occluder] = (),
    progress: Callable[[int, int], None] | None = None,
) -> dict:
    """Film markers moving on bars; write PATH (H.264) and PATH with suffixes .bed.json and .truth.json.

    The bed file holds what a person with a ruler knows: marks, plane, and the dots' height above it.

    times_s: the middle of each frame's exposure, strictly increasing [s]; need not be evenly spaced.
    markers_m: marker id -> world positions (time, 3) [m].  links: bars drawn between two markers.
    Returns the truth: bed marks (metres and pixels), markers_px (id -> (time, 2)), times as written.
    """
    look, path, ids = look or Look(), Path(path), list(markers_m)
    times = np.asarray(times_s, float)
    if len(times) < 2 or np.any(np.diff(times) <= 0):
        raise ValueError(f"a clip needs two or more strictly increasing times, got {len(times)}")
    ticks = np.round((times - times[0]) / float(TICK)).astype(int)
    world = np.stack([np.asarray(markers_m[m], float) for m in ids], 1)
    if world.shape != (len(times), len(ids), 3):
        raise ValueError(f"markers have shape {world.shape}, expected {(len(times), len(ids), 3)}")
    p = bed.from_world(world)
    velocity = np.gradient(p, times, axis=0)
    opening = look.shutter_s * ((np.arange(look.exposures) + 0.5) / look.exposures - 0.5)
    bars = [(ids.index(a), ids.index(b)) for a, b in links]
    film = Film(camera, bed, look)
    with av.open(str(path), "w") as out:
        rate = Fraction(round(1e3 * (len(times) - 1) / (times[-1] - times[0])), 1000)
        stream = out.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = camera.width_px, camera.height_px, "yuv420p"
        stream.codec_context.time_base = TICK
        stream.options = {"preset": "superfast", "crf": str(look.crf)}
        for t in range(len(times)):
            cards = [c for c in occluders if c.start_s <= times[t] < c.end_s]
            moments = p[t] + velocity[t] * opening[:, None, None]
            picture = av.VideoFrame.from_ndarray(film.frame(moments, bars, cards), format="yuv420p")
            picture.pts, picture.time_base = int(ticks[t]), TICK
            out.mux(stream.encode(picture))
            if progress:
                progress(t + 1, len(times))
        out.mux(stream.encode(None))
    truth = describe(
        camera, bed, look, ticks * float(TICK), dict(zip(ids, camera.project(p).swapaxes(0, 1), strict=True))
    )
    path.with_suffix(".truth.json").write_text(json.dumps(truth))
    height = dict(zip(ids, p[..., 2].mean(0).round(6).tolist(), strict=True))
    sheet = {"marks": truth["bed_marks"], "plane": truth["plane"], "marker_height_m": height}
    path.with_suffix(".bed.json").write_text(json.dumps(sheet, indent=1))
    return truth


def describe(camera: Camera, bed: Bed, look: Look, times_s: Array, markers_px: dict[str, Array]) -> dict:
    """The truth as plain JSON data: marks, plane, camera, look, times [s] and marker pixels."""
    marks = []
    for name, (x, y) in bed.marks_m.items():
        u, v = camera.project(np.array([x, y, 0.0]))
        marks.append({"id": name, "x_m": x, "y_m": y, "x_px": float(u), "y_px": float(v)})
    plane = {"origin_m": list(bed.origin_m), "x_axis": list(bed.x_axis), "y_axis": list(bed.y_axis)}
    return {
        "bed_marks": marks,
        "plane": plane,
        "camera": asdict(camera),
        "look": asdict(look),
        "times_s": times_s.tolist(),
        "markers_px": {name: px.tolist() for name, px in markers_px.items()},
    }
