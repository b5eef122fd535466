"""What tracking costs: CPU time a frame and peak memory, on a clip of 32 dots at 1080p and 240 frames a second.

`python -m benchmarks.long_clip [SECONDS]` (10 s of film by default: two minutes on one core).  The clip is painted
here, on a textured, noisy bed; each way of reading it runs in a process of its own, whose peak is its alone (Linux).
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import av
import cv2
import numpy as np

WIDTH, HEIGHT, RATE, DOTS = 1920, 1080, 240, 32
PX_PER_M = 1e4 / 3
CORNERS = {"a": (-0.28, -0.15), "b": (0.28, -0.15), "c": (0.28, 0.15), "d": (-0.28, 0.15)}
WAYS = ("stream", "track", "track with preview")


def places_m(time_s: float) -> np.ndarray:
    """Where the dots are, (dot, 2): four rows of eight that swing 20 to 40 mm at 1 to 5 Hz."""
    k = np.arange(DOTS)
    x = -0.24 + 0.068 * (k % 8) + 0.01 * np.sin(2 * np.pi * (2 + 0.1 * k) * time_s + k)
    y = -0.1 + 0.065 * (k // 8) + 0.018 * np.sin(2 * np.pi * (1 + 0.07 * k) * time_s + 2 * k)
    return np.c_[x, y]


def pixels(p_m: np.ndarray) -> np.ndarray:
    """A camera square to the bed."""
    return np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) + PX_PER_M * p_m * [1, -1]


def disc(plane: np.ndarray, at: np.ndarray, radius: float, code: int) -> None:
    """A disc placed to 1/256 of a pixel."""
    u, v, r = (round(float(c) * 256) for c in (*at, radius))
    cv2.circle(plane, (u, v), r, code, -1, cv2.LINE_AA, 8)


def film(path: Path, frames: int) -> None:
    """Paint and encode the clip."""
    rng = np.random.default_rng(0)
    bed = cv2.GaussianBlur(rng.normal(150, 18, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 1.5)
    noise = [rng.normal(0, 2, (HEIGHT, WIDTH)).astype(np.float32) for _ in range(8)]
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=RATE, options={"preset": "ultrafast", "crf": "20"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for n in range(frames):
            luma = np.clip(bed + noise[n % 8], 0, 255).astype(np.uint8)
            cb, cr = (np.full((HEIGHT // 2, WIDTH // 2), 128, np.uint8) for _ in range(2))
            for at in pixels(places_m(n / RATE)):
                disc(luma, at, 20, 235)
                disc(luma, at, 13, 90)
                disc(cb, (at - 0.5) / 2, 6.5, 100)
                disc(cr, (at - 0.5) / 2, 6.5, 210)
            planes = np.concatenate([luma.ravel(), cb.ravel(), cr.ravel()]).reshape(HEIGHT * 3 // 2, WIDTH)
            picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            picture.pts = n
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))


def peak_mb() -> float:
    """The most memory that this process ever held."""
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(row.split()[1] for row in status if row.startswith("VmHWM"))) / 1024


def read(path: Path, way: str) -> None:
    """Read the clip one way, and print what that took."""
    from backend.mechanism.body import Body
    from backend.mechanism.marker import Marker
    from backend.mechanism.mechanism import Mechanism
    from backend.observe.measure import track_video
    from backend.observe.video import Video

    libraries, start = peak_mb(), time.process_time()
    error = ""
    if way == "stream":
        frames = sum(1 for _ in Video(path))
    else:
        ground = Body(id="ground", fixed=True, pose={"position_m": (0, 0, 0), "quaternion_wxyz": (1, 0, 0, 0)})
        dots = (Marker(id=f"j{k}", body="ground", position_m=(*p, 0.0)) for k, p in enumerate(places_m(0).tolist()))
        drawing = Mechanism(bodies=(ground,), markers=tuple(dots))
        names = ("x_m", "y_m", "x_px", "y_px")
        marks = [
            {"id": i, **dict(zip(names, (*p, *pixels(np.array(p)).tolist()), strict=True))} for i, p in CORNERS.items()
        ]
        tracks = track_video(path, drawing, marks, out_dir=path.parent, preview=way.endswith("preview")).tracks
        frames = len(tracks) // DOTS
        truth = np.stack([places_m(n / RATE) for n in range(frames)])
        away = 1e3 * np.hypot(*(tracks[["x_m", "y_m"]].to_numpy().reshape(truth.shape) - truth).transpose(2, 0, 1))
        error = f", {np.nanmedian(away):.3f} mm median, {np.nanquantile(away, 0.95):.3f} at 95%"
    cpu_ms = 1e3 * (time.process_time() - start) / frames
    held = f"peak {peak_mb():.0f} MB ({libraries:.0f} libraries)"
    print(f"{way}: {frames} frames, {cpu_ms:.1f} CPU ms a frame, {held}{error}")


def main(seconds: float) -> None:
    """Film once, read three ways."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        film(path, round(seconds * RATE))
        print(f"{seconds:g} s, {8e-6 * path.stat().st_size / seconds:.0f} Mbit/s", flush=True)
        for way in WAYS:
            subprocess.run([sys.executable, "-m", "benchmarks.long_clip", str(path), way], check=True)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        read(Path(sys.argv[1]), sys.argv[2])
    else:
        main(float(sys.argv[1]) if len(sys.argv) == 2 else 10.0)
