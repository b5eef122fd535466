"""A bar with a grained surface that turns about a pin, filmed pixel by pixel from its own texture."""

from functools import cache

import av
import cv2
import numpy as np

from backend.mechanism.read import parse_mechanism

SIZE = (480, 360)
MM_PER_PX, FINE = 0.5, 2  # rays a pixel, each way
PIN_PX = np.array([150.0, 180.0])
POINTS_M = {"near": (0.030, 0.001), "far": (0.075, -0.002)}
LENGTH_M, HALF_M = 0.09, 0.012


def drawing(*markers):
    """The bar as drawn, level; its markers are places on its surface where nothing is stuck, all unless named."""
    level = {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
    inertia = {"xx": 1e-6, "yy": 2e-5, "zz": 2e-5}
    return parse_mechanism(
        {
            "schema_version": "1.0", "name": "bar",
            "bodies": [
                {"id": "ground", "fixed": True},
                {"id": "bar", "pose": level,
                 "inertial": {"mass_kg": 0.05, "center_of_mass_m": [0.045, 0, 0], "inertia_kg_m2": inertia}},
            ],
            "joints": [{"id": "pin", "type": "revolute", "body_a": "ground", "body_b": "bar",
                        "frame_a": level, "frame_b": level}],
            "markers": [{"id": name, "body": "bar", "position_m": [*POINTS_M[name], 0]}
                        for name in markers or POINTS_M],
        }
    )  # fmt: skip


def in_picture(xy_m):
    return PIN_PX + np.asarray(xy_m) * np.array([1, -1]) * 1e3 / MM_PER_PX


def bed():
    marks = [
        {"id": f"{k}", "x_m": x, "y_m": y, "x_px": u, "y_px": v}
        for k, (x, y) in enumerate([(-0.06, -0.08), (0.15, -0.08), (0.15, 0.08), (-0.06, 0.08)])
        for u, v in [in_picture((x, y)).tolist()]
    ]
    return {"marks": marks, "marker_height_m": 0.0}


def turned(angle, xy_m):
    """Where points drawn on the level bar are when it is turned [m]; angle (n,) -> (n, point, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.einsum("nij,pj->npi", np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2), np.asarray(xy_m))


@cache
def grain(seed, shape, size):
    """A surface of spots so many texels of 0.1 mm large, of unit contrast."""
    spots = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, shape).astype(np.float32), (0, 0), size)
    return spots / spots.std()


def picture(angle, rng, contrast=1.0, card_m=None):
    """One picture, grey; card_m: x, y, half side of a card on top."""
    h, w = SIZE[1] * FINE, SIZE[0] * FINE
    u, v = np.meshgrid((np.arange(w) + 0.5) / FINE - 0.5, (np.arange(h) + 0.5) / FINE - 0.5)
    x, y = (u - PIN_PX[0]) * MM_PER_PX * 1e-3, (PIN_PX[1] - v) * MM_PER_PX * 1e-3
    texture, table = grain(3, (800, 1600), 8), grain(4, (1600, 2600), 12)
    along, across = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y

    def look(map_, a, b):
        at = (1e4 * a + 400, 1e4 * b + map_.shape[0] / 2)
        return cv2.remap(map_, *(k.astype(np.float32) for k in at), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)

    light = 90 + 20 * look(table, x + 0.03, y)
    on_bar = (np.abs(across) < HALF_M) & (along > -0.01) & (along < LENGTH_M)
    light = np.where(on_bar, 140 + 30 * contrast * look(texture, along, across), light)
    if card_m:
        light = np.where((np.abs(x - card_m[0]) < card_m[2]) & (np.abs(y - card_m[1]) < card_m[2]), 60, light)
    seen = cv2.GaussianBlur(cv2.resize(light.astype(np.float32), SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    return np.clip(seen + rng.normal(0, 1.5, seen.shape), 0, 255).astype(np.uint8)


def film(path, angle, rate=120, card=lambda frame: None, contrast=1.0):
    """A clip, H.264, one frame for each angle."""
    rng = np.random.default_rng(8)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "16"}
        for k, a in enumerate(angle):
            grey = picture(a, rng, contrast, card(k))
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.repeat(grey[..., None], 3, 2), format="rgb24")))
        out.mux(stream.encode(None))
    return path
