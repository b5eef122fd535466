"""One clip: what is known is pointed out in its first frame (marks, tags, a length, doubtful dots); then tracked."""

from __future__ import annotations

from typing import Any

from nicegui import ui
from pydantic import ValidationError

from backend.service.jobs.desk import find_job, start_job
from backend.service.jobs.requests import TrackRequest
from backend.service.mechanisms import load_mechanism
from backend.service.page.bed_file import bed_files
from backend.service.page.late import ROOT
from backend.service.page.marked_before import marked_before
from backend.service.page.markup import button, choice, enable, field, notice, tag, tick
from backend.service.page.pointing import Pointing
from backend.service.page.shell import page, tell, view
from backend.service.page.stage import plane_of_motion
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.things import find_thing

LEAST = 4  # marks fix a plane
WAYS = {
    "": "coloured dots on white rings",
    "dark": "dots without a colour",
    "patch": "coloured areas of any shape",
    "texture": "nothing: follow the surface itself",
    "tag": "printed tags",
}
STICK = ("one end", "other end", "origin")  # of the known length, and of the plane's coordinates
PLANES = {
    "xy": ("lying flat: bed x is world x, bed y is world y", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "xz": ("upright: bed x is world x, bed y is world z", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "yz": ("upright: bed x is world y, bed y is world z", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}


@page("/mechanisms/{id}/clips/{video}")
def clip_view(service: Service, owner: str, id: str, video: str, again: str = "") -> None:
    """Point at the marks, say where they are, start the tracker. again: a job whose answers stand there already."""
    thing, clip = find_thing(service, owner, "mechanism", id), find_thing(service, owner, "video", video)
    mechanism = load_mechanism(service, owner, id)
    corners = ((0.0, 0.0), (200.0, 0.0), (200.0, 100.0), (0.0, 100.0))
    marks = [
        {"id": name, "x_mm": x, "y_mm": y, "x_px": None, "y_px": None}
        for name, (x, y) in zip("ABCD", corners, strict=True)
    ]
    tags = [{"id": f"tag {n}", "number": n, "x_mm": None, "y_mm": None} for n in range(LEAST)]
    dots = [{"id": marker.id, "x_px": None, "y_px": None, "tag": None} for marker in mechanism.markers]
    stick = [{"id": name, "x_px": None, "y_px": None} for name in STICK]
    given: dict[str, Any] = {
        "points": {"marks": marks, "tags": tags, "stick": stick, "dots": dots}, "plane": _plane(mechanism), "way": "",
        "markers": [marker.id for marker in mechanism.markers],
    }  # fmt: skip
    if again and (job := find_job(service, owner, again)).kind == "track":
        given = marked_before(job.request, given, PLANES)
    points = given["points"]
    trail = [("Mechanisms", "/"), (thing.name, f"/mechanisms/{id}"), ("Measure", f"/mechanisms/{id}/measure")]
    with view(clip.name, trail, now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", f"Where things are in {clip.name}")
                tag(
                    "p",
                    "The first frame to follow. Click on four known points of the bed, or on the ends of one known "
                    "length, or say where printed tags lie; the tracker finds tags and dots by itself.",
                    "soft",
                )
            with tag("div", look="actions"):
                go = button("Track the dots", lambda: start(), "act primary", disabled=True)
        said = tag("div", aria_live="polite")

        def told(points: dict[str, Any]) -> None:
            given["points"] = points
            judge()

        def judge() -> None:
            enable(go, "bed_file" in given or ready(given["points"]))

        def follow(way: str) -> None:
            given["way"] = way
            pointing.tag_dots(way == "tag")

        def begin(text: str) -> None:
            given["from"] = text
            pointing.show(_frame(video, text))

        def number(label: str, key: str, left_alone: str = "", **limits: str) -> None:
            value = given.get(key, left_alone)
            field(label, value, lambda text: given.update({key: text}), "number", **{"step": "any", **limits})

        pointing = Pointing(_frame(video, given.get("from", "")), points, told)
        pointing.tag_dots(given["way"] == "tag")
        tag("h2", "What is followed")
        with tag("div", look="fields"):
            choice("what shows a marker", list(WAYS.items()), given["way"], follow)
            number("of a surface: pixels round about", "reach", "10", min="5", step="1")
            begins = given.get("from", "")
            field("from [s], as a player shows it", begins, begin, "number", "change", min="0", step="any")
            number("to [s]", "to", min="0")
            number("filmed at [frames/s], if slow motion", "rate", min="1")
        tag(
            "p",
            "Coloured areas need a click on one of them, a surface a click where each marker is and the drawing does "
            "not show it, tags their numbers (3 of the kit's, aruco_4x4_50:3 of another family): all under Dots. Begin "
            "where everything is in view; the clicks belong to the frame shown.",
            "note",
        )
        tag("h2", "The plane of the marks")
        with tag("div", look="fields"):
            options = [(key, words) for key, (words, _, _) in PLANES.items()]
            choice("how it lies", options, given["plane"], lambda key: given.update(plane=key))
            number("camera above the bed [mm], if known", "camera", min="1")
            number("dots above the marks [mm], if known", "height")
            number("focal length [px], if calibrated", "focal", min="1")
        keep = given.get("keep", False)
        tick("The clip ends too early: measure what can be read", keep, lambda on: given.update(keep=on))
        tag(
            "p",
            "Without a focal length the picture is taken for flat: good where the dots lie in the plane of the marks "
            "and the camera looks square at it. With one known length alone that must be so, and the picture level.",
            "note",
        )
        tag("h2", "Calibrated before")
        bed_files(service, given, judge)

        def start() -> None:
            try:
                job = start_job(service, owner, asked_for(id, video, given))
            except Problem as problem:
                tell(problem, said)
                return
            except ValueError as error:
                said.clear()
                with said:
                    notice(sentences(error), "bad")
                return
            ui.navigate.to(f"/jobs/{job.id}")


def sentences(error: ValueError) -> list[str]:
    """What is wrong with what was asked for."""
    if isinstance(error, ValidationError):
        return [fault["msg"].removeprefix("Value error, ") for fault in error.errors()]
    return [str(error)]


def _placed(point: dict[str, Any]) -> bool:
    return all(isinstance(point.get(along), int | float) for along in ("x_px", "y_px"))


def _typed(point: dict[str, Any]) -> bool:
    return all(isinstance(point.get(along), int | float) for along in ("x_mm", "y_mm"))


def ready(points: dict[str, Any]) -> bool:
    """Whether enough is known of where things are: marks and tags, or both ends of a length."""
    known = sum(_placed(mark) for mark in points["marks"]) + sum(_typed(tag) for tag in points["tags"])
    return known >= LEAST or all(_placed(end) for end in points["stick"][:2])


def _frame(video: str, from_s: str) -> str:
    """Where the first picture of a part of a clip is."""
    return f"{ROOT}/frames/{video}.png" + (f"?from_s={_number(from_s)}" if from_s else "")


def _number(text: str) -> float:
    try:
        return max(0.0, float(text))
    except ValueError:
        return 0.0


def _plane(mechanism: Any) -> str:
    normal = plane_of_motion(mechanism)
    if normal is None or abs(normal[2]) > 0.7:
        return "xy"
    return "xz" if abs(normal[1]) > 0.7 else "yz"


def asked_for(mechanism: str, video: str, given: dict[str, Any]) -> TrackRequest:
    """The job that was asked for; ValueError for numbers that are none."""
    points = given["points"]
    _, x_axis, y_axis = PLANES[given["plane"]]
    known = given["bed_file"] if "bed_file" in given else _scale(points)
    bed: dict[str, Any] = {"plane": {"x_axis": x_axis, "y_axis": y_axis}, **known}
    if "camera_file" in given:
        bed["camera"] = given["camera_file"]
    elif isinstance(name := bed.get("camera"), str):
        raise ValueError(f"The bed file names the camera {name}; bring that file too.")
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
    if given["way"] == "tag":
        if bare := [dot["id"] for dot in points["dots"] if not dot.get("tag")]:
            raise ValueError(f"Type under Dots which tag is on {', '.join(bare)}.")
        asked["targets"] = {dot["id"]: dot["tag"] for dot in points["dots"]}
    elif way := given["way"]:
        word = f"texture:{given['reach']}" if way == "texture" and given.get("reach") else way
        asked["targets"] = dict.fromkeys(given["markers"], word)
    for field_of, key in (("from_s", "from"), ("to_s", "to"), ("filmed_per_s", "rate")):
        if text := given.get(key):
            asked[field_of] = float(text)
    return TrackRequest.model_validate(asked)


def _scale(points: dict[str, Any]) -> dict[str, Any]:
    """Marks and tags, or where there are too few of them the stick: what the bed file says of known places."""
    marks = [mark for mark in points["marks"] if _placed(mark)]
    tags = [tag for tag in points["tags"] if _typed(tag)]
    if len(marks) + len(tags) < LEAST:
        length = points.get("length_mm")
        if not isinstance(length, int | float):
            raise ValueError("Type how long the known length is, in mm; or click on four marks.")
        a, b, origin = ((point["x_px"], point["y_px"]) if _placed(point) else None for point in points["stick"])
        return {"stick": {"a_px": a, "b_px": b, "length_m": 1e-3 * length, "origin_px": origin}}
    if bad := [mark["id"] for mark in marks if not _typed(mark)]:
        raise ValueError(f"Type where {', '.join(bad)} lies on the bed, in mm.")
    return {
        "marks": [
            {"id": m["id"], "x_m": 1e-3 * m["x_mm"], "y_m": 1e-3 * m["y_mm"], "x_px": m["x_px"], "y_px": m["y_px"]}
            for m in marks
        ],
        "tags": [{"id": t["number"], "x_m": 1e-3 * t["x_mm"], "y_m": 1e-3 * t["y_mm"]} for t in tags],
    }
