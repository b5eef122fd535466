"""A calibrated lens, in a few lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backend.report.quantity import shown


def camera_text(camera: Mapping[str, Any]) -> str:
    """Focal length, centre and distortion with their standard deviations, misfit, views; pose; then every note."""
    sd = camera["sd"]
    width, height = camera["image_size_px"]
    lines = [
        f"{camera['views']} views of {width} x {height} pixels, misfit {shown(camera['reprojection_rms_px'], 2)} px",
        f"  focal px   {_pair(camera['focal_px'], sd['focal_px'])}",
        f"  centre px  {_pair(camera['centre_px'], sd['centre_px'])}",
    ]
    for name in ("k1", "k2", "p1", "p2", "k3"):
        spread = f"sd {shown(sd[name], 2)}" if sd[name] else "held at zero: the views do not show it"
        lines.append(f"  {name:<10} {shown(camera[name], 4)}, {spread}")
    if pose := camera.get("pose"):
        lines += _stands(pose)
    lines += [f"note: {sentence}" for sentence in camera["notes"]]
    return "\n".join(lines)


def _stands(pose: Mapping[str, Any]) -> list[str]:
    """Where the camera stood and how high the dots are, in millimetres."""
    sd = [1e3 * max(row[i], 0.0) ** 0.5 for i, row in enumerate(pose["covariance"])][12:]
    places = ", ".join(f"{1e3 * x:.1f}" for x in pose["position_m"])
    lines = [f"  stands mm  {places}, sd {', '.join(shown(s, 2) for s in sd[:3])}"]
    heights = [
        f"{name} {1e3 * h:.2f} ({shown(s, 2)})"
        for (name, h), s in zip(pose["marker_height_m"].items(), sd[3:], strict=True)
    ]
    return [*lines, f"  dots mm    above the bed (sd): {', '.join(heights)}"] if heights else lines


def _pair(values: Any, spreads: Any) -> str:
    return f"{values[0]:.1f}, {values[1]:.1f}, sd {shown(spreads[0], 2)}, {shown(spreads[1], 2)}"
