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
    for name, marker in summary["markers"].items():
        counts = ", ".join(f"{count} {status}" for status, count in marker["status"].items())
        sd = "" if marker["sigma_m"] is None else f"; sd {shown(1e3 * marker['sigma_m'], 2)} mm"
        lines.append(f"  {name:<12} {counts}{sd}")
    lines += [f"warning: {sentence}" for sentence in summary["warnings"]]
    return "\n".join(lines)
