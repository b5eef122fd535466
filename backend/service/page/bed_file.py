"""What was made before a clip is marked: a calibrated camera, or a whole bed file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from backend.observe.camera import read_camera
from backend.observe.tracking_error import TrackingError
from backend.service.page.markup import button, tag
from backend.service.page.upload import drop_zone
from backend.service.problems import Problem
from backend.service.service import Service

LARGEST_BYTES = 2**20


def bed_files(service: Service, given: dict[str, Any], changed: Callable[[], None]) -> None:
    """Take them into `given`, under "camera_file" and "bed_file", and say what is there; `changed` is told."""
    there = tag("div", aria_live="polite")

    def show() -> None:
        there.clear()
        with there:
            for key, words in (("camera_file", _camera_words), ("bed_file", _bed_words)):
                if key in given:
                    with tag("div", look="actions"):
                        tag("p", words(given[key]), style="margin: 0")
                        button("Leave it out", lambda key=key: leave(key), "quiet")
        changed()

    def leave(key: str) -> None:
        del given[key]
        show()

    async def taken(files: Mapping[str, Path]) -> None:
        for name, path in files.items():
            key, told = known(name, path)
            given[key] = told
        show()

    drop_zone(
        service,
        "Drop camera.json or a bed file here",
        "What linktwin calibrate wrote of the camera; or a file of marks or tags that linktwin track takes, which then "
        "stands in for the marks and tags above.",
        ".json",
        taken,
        primary=False,
    )
    show()


def known(name: str, path: Path) -> tuple[str, dict[str, Any]]:
    """Whether a file holds a camera ("camera_file") or a bed ("bed_file"), and what is in it; Problem for neither."""
    if path.stat().st_size > LARGEST_BYTES:
        raise Problem("too-large", f"{name} is larger than any camera or bed file; choose another.")
    try:
        told = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise Problem("invalid", f"{name} is not JSON ({error}); choose another file.") from None
    if isinstance(told, dict) and "focal_px" in told:
        try:
            read_camera(path)
        except TrackingError as error:
            raise Problem("invalid", str(error).replace(str(path), name)) from None
        return "camera_file", told
    bed = {"marks": told} if isinstance(told, list) else told
    if not isinstance(bed, dict) or not {"marks", "tags", "stick"} & bed.keys():
        raise Problem("invalid", f"{name} is neither a camera (linktwin calibrate) nor a bed file; choose another.")
    return "bed_file", bed


def _camera_words(camera: Mapping[str, Any]) -> str:
    width, height = camera["image_size_px"]
    pose = ", which knows where it stood" if camera.get("pose") else ""
    return f"A calibrated camera: focal length {camera['focal_px'][0]:.0f} px at {width} by {height}{pose}."


def _bed_words(bed: Mapping[str, Any]) -> str:
    held = [f"{len(bed[of])} {of}" for of in ("marks", "tags") if isinstance(bed.get(of), list)]
    return f"A bed file: {' and '.join(held) or 'a known length'}."
