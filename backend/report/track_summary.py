"""What was seen in a clip, in a screenful."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backend.report.quantity import shown


def track_text(summary: Mapping[str, Any]) -> str:
    """Frames, scale, and per marker how often and how surely it was seen; then every warning."""
    lines = [
        f"{summary['video']}: {summary['frames']} frames, {shown(summary['frames_per_s'])} per second, "
        f"{shown(1e3 * summary['metres_per_px'])} mm per pixel",
    ]
    return "\n".join(lines + _markers(summary))


def converted_text(summary: Mapping[str, Any]) -> str:
    """What a file of tracks held, and per marker how often and how surely it was seen; then every warning."""
    rate = "" if summary["frames_per_s"] is None else f", {shown(summary['frames_per_s'])} per second"
    return "\n".join(
        [f"{summary['source']} ({summary['format']}): {summary['frames']} frames{rate}", *_markers(summary)]
    )


def _markers(summary: Mapping[str, Any]) -> list[str]:
    lines = []
    for name, marker in summary["markers"].items():
        counts = ", ".join(f"{count} {status}" for status, count in marker["status"].items())
        sd = "" if marker["sigma_m"] is None else f"; sd {shown(1e3 * marker['sigma_m'], 2)} mm"
        lines.append(f"  {name:<12} {counts}{sd}")
    return lines + [f"warning: {sentence}" for sentence in summary["warnings"]]
