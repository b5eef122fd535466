"""One clip: marks on the bed and, where it is doubtful, dots are pointed out in its first frame; then it is tracked."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from backend.service.jobs.desk import start_job
from backend.service.jobs.requests import TrackRequest
from backend.service.mechanisms import load_mechanism
from backend.service.page.late import ROOT
from backend.service.page.markup import button, choice, enable, field, notice, tag, tick
from backend.service.page.pointing import Pointing
from backend.service.page.shell import page, tell, view
from backend.service.page.stage import plane_of_motion
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.things import find_thing

LEAST = 4  # marks fix a plane
PLANES = {
    "xy": ("lying flat: bed x is world x, bed y is world y", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "xz": ("upright: bed x is world x, bed y is world z", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "yz": ("upright: bed x is world y, bed y is world z", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}


@page("/mechanisms/{id}/clips/{video}")
def clip_view(service: Service, owner: str, id: str, video: str) -> None:
    """Point at the marks, say where they are, start the tracker."""
    thing, clip = find_thing(service, owner, "mechanism", id), find_thing(service, owner, "video", video)
    mechanism = load_mechanism(service, owner, id)
    corners = ((0.0, 0.0), (200.0, 0.0), (200.0, 100.0), (0.0, 100.0))
    marks = [
        {"id": name, "x_mm": x, "y_mm": y, "x_px": None, "y_px": None}
        for name, (x, y) in zip("ABCD", corners, strict=True)
    ]
    dots = [{"id": marker.id, "x_px": None, "y_px": None} for marker in mechanism.markers]
    given: dict[str, Any] = {"points": {"marks": marks, "dots": dots}, "plane": _plane(mechanism), "tags": False}
    trail = [("Mechanisms", "/"), (thing.name, f"/mechanisms/{id}"), ("Measure", f"/mechanisms/{id}/measure")]
    with view(clip.name, trail, now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", f"Where things are in {clip.name}")
                tag(
                    "p",
                    "Its first frame. Click on four known points of the bed; the tracker finds the dots by itself.",
                    "soft",
                )
            with tag("div", look="actions"):
                go = button("Track the dots", lambda: start(), "act primary", disabled=True)
        said = tag("div", aria_live="polite")

        def told(points: dict[str, Any]) -> None:
            given["points"] = points
            ready = sum(_placed(mark) for mark in points["marks"]) >= LEAST
            enable(go, ready)

        Pointing(f"{ROOT}/frames/{video}.png", marks, dots, told)
        tag("h2", "The plane of the marks")
        with tag("div", look="fields"):
            options = [(key, words) for key, (words, _, _) in PLANES.items()]
            choice("how it lies", options, given["plane"], lambda key: given.update(plane=key))
            field("camera above the bed [mm], if known", "", lambda t: given.update(camera=t), "number", min="1")
            field("dots above the marks [mm], if known", "", lambda t: given.update(height=t), "number", step="any")
            field("focal length [px], if calibrated", "", lambda t: given.update(focal=t), "number", min="1")
        tick("The clip ends too early: measure what can be read", False, lambda on: given.update(keep=on))
        tag(
            "p",
            "Without a focal length the picture is taken for flat: good where the dots lie in the plane of the marks "
            "and the camera looks square at it.",
            "note",
        )

        def start() -> None:
            try:
                job = start_job(service, owner, _request(id, video, given))
            except Problem as problem:
                tell(problem, said)
                return
            except ValueError as error:
                said.clear()
                with said:
                    notice((str(error).splitlines()[0],), "bad")
                return
            ui.navigate.to(f"/jobs/{job.id}")


def _placed(point: dict[str, Any]) -> bool:
    return point.get("x_px") is not None


def _plane(mechanism: Any) -> str:
    normal = plane_of_motion(mechanism)
    if normal is None or abs(normal[2]) > 0.7:
        return "xy"
    return "xz" if abs(normal[1]) > 0.7 else "yz"


def _request(mechanism: str, video: str, given: dict[str, Any]) -> TrackRequest:
    """The job that was asked for; ValueError for numbers that are none."""
    points = given["points"]
    marks = [mark for mark in points["marks"] if _placed(mark)]
    if bad := [mark["id"] for mark in marks if not all(isinstance(mark[k], int | float) for k in ("x_mm", "y_mm"))]:
        raise ValueError(f"Type where {', '.join(bad)} lies on the bed, in mm.")
    _, x_axis, y_axis = PLANES[given["plane"]]
    bed: dict[str, Any] = {
        "marks": [
            {"id": m["id"], "x_m": 1e-3 * m["x_mm"], "y_m": 1e-3 * m["y_mm"], "x_px": m["x_px"], "y_px": m["y_px"]}
            for m in marks
        ],
        "plane": {"x_axis": x_axis, "y_axis": y_axis},
    }
    if height := given.get("height"):
        bed["marker_height_m"] = 1e-3 * float(height)
    if focal := given.get("focal"):
        bed["lens"] = {"focal_px": float(focal)}
    elif camera := given.get("camera"):
        bed["camera_height_m"] = 1e-3 * float(camera)
    clicks = {dot["id"]: (dot["x_px"], dot["y_px"]) for dot in points["dots"] if _placed(dot)}
    asked: dict[str, Any] = {"kind": "track", "video": video, "mechanism": mechanism, "bed": bed}
    asked["keep_truncated"] = bool(given.get("keep"))
    if clicks:
        asked["clicks"] = clicks
    return TrackRequest.model_validate(asked)
