"""Clips that people store."""

from __future__ import annotations

from pathlib import Path

from backend.service.intake.content import video_suffix
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.service import Service
from backend.service.things import keep_thing


def store_video(
    service: Service, owner: str, file: Path, name: str | None = None, repeat_key: str | None = None
) -> Thing:
    """Check and keep a clip that lies on this machine; what it is, its content says, not its name.  Raises Problem."""
    size = file.stat().st_size
    if size > service.settings.largest_video:
        raise Problem("too-large", f"The video has {size} bytes, above the limit of {service.settings.largest_video}.")
    suffix = video_suffix(file)
    files = {f"video{suffix}": file}
    return keep_thing(service, owner, "video", name or f"video{suffix}", files, {"bytes": size}, repeat_key)
