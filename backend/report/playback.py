"""A motion that plays in the page: sent once as rounded numbers, drawn by the browser."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from markupsafe import Markup

from backend.mechanism.mechanism import Mechanism
from backend.model.flexible import split
from backend.report.evidence import Motion, Overlay
from backend.report.skeleton import View, best_view, skeleton_of
from backend.report.svg import element

FRAMES = 240
SEEN_WITHIN = 0.6  # of a frame: a marker seen further off in time is not drawn


def playback(mechanism: Mechanism, overlay: Overlay, title: str, simulated: str = "fitted twin") -> Markup:
    """A canvas with the simulated motion (named so in the legend), the drawn one behind it, and the markers seen."""
    skeleton = skeleton_of(split(mechanism))
    placed = skeleton.placed(overlay.after)
    view = best_view(placed)
    times = _frames(overlay.after.time_s)
    seen = {id: view.seen(np.asarray(p)) for id, p in overlay.seen_m.items()}
    data: dict[str, Any] = {
        "time_s": [round(float(t), 4) for t in times],
        "held": _mm(view.seen(skeleton.held)),
        "after": _bodies(placed, overlay.after, times, view),
        "before": _bodies(skeleton.placed(overlay.before), overlay.before, times, view) if overlay.before else [],
        "seen": [_at_frames(overlay.seen_time_s, p, times) for p in seen.values()],
    }
    stored = Markup(json.dumps(data, separators=(",", ":")).replace("</", "<\\/"))
    keys = [(simulated, "key after line")]
    keys += [("as drawn", "key before line")] if overlay.before else []
    keys += [("seen", "key measured points")] if seen else []
    legend = element("span", *(element("span", name, class_=look) for name, look in keys), class_="legend")
    controls = element(
        "div",
        element("button", "Play", type="button"),
        Markup(f'<input type="range" min="0" max="{len(times) - 1}" value="0" aria-label="time">'),
        element("output", "0.000 s"),
        class_="controls",
    )
    return element(
        "figure",
        element("figcaption", element("b", title), legend),
        element("canvas", width=1040, height=560, aria_label=f"{title}, played back"),
        controls,
        element("p", f"Seen in the {view.name}; played at the speed at which it takes four seconds.", class_="note"),
        element("script", stored, type="application/json"),
        class_="playback wide",
    )


def _frames(time_s: np.ndarray) -> np.ndarray:
    return np.linspace(time_s[0], time_s[-1], min(FRAMES, len(time_s)))


def _bodies(
    placed: dict[str, np.ndarray], motion: Motion, times: np.ndarray, view: View
) -> list[list[list[list[float]]]]:
    """Per body, per frame: its points [mm]."""
    nearest = np.clip(np.searchsorted(motion.time_s, times), 0, len(motion.time_s) - 1)
    return [[_mm(frame) for frame in view.seen(p[nearest])] for p in placed.values()]


def _at_frames(time_s: np.ndarray, p: np.ndarray, times: np.ndarray) -> list[list[float] | None]:
    """The marker seen nearest to each frame, null where none was [mm]."""
    if not len(time_s):
        return [None] * len(times)
    apart = (times[-1] - times[0]) / max(1, len(times) - 1)
    after = np.clip(np.searchsorted(time_s, times), 1, max(1, len(time_s) - 1)).clip(max=len(time_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(time_s[after] - times) < np.abs(time_s[before] - times), after, before)
    good = (np.abs(time_s[nearest] - times) <= SEEN_WITHIN * max(apart, 1e-3)) & np.isfinite(p[nearest]).all(axis=-1)
    return [_mm(p[i][None])[0] if ok else None for i, ok in zip(nearest, good, strict=True)]


def _mm(points: np.ndarray) -> list[list[float]]:
    return np.round(1e3 * points, 1).tolist()
