"""What was pointed out and typed for a clip that was tracked before, so that it need not be done again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from backend.observe.carried import UNTAGGED

OWN = {
    "plane",
    "marks",
    "tags",
    "stick",
    "marker_height_m",
    "camera_height_m",
    "lens",
    "camera",
}  # what the view asks for


def marked_before(
    request: Mapping[str, Any], given: Mapping[str, Any], planes: Mapping[str, Sequence[Any]]
) -> dict[str, Any]:
    """The view's answers with those of a `track` request in their places; a bed that says more stays a bed file."""
    bed = request["bed"] if isinstance(request["bed"], dict) else {"marks": request["bed"]}
    points = dict(given["points"])
    made: dict[str, Any] = {**given, "points": points, "keep": request.get("keep_truncated", False)}
    by_marker = isinstance(bed.get("marker_height_m"), dict | str)  # more than the view asks for
    if bed.keys() - OWN or by_marker or any("family" in tag for tag in bed.get("tags") or ()):
        made["bed_file"] = {key: value for key, value in bed.items() if key != "camera"}
    if marks := bed.get("marks"):
        points["marks"] = [{**_places(mark), "x_px": mark["x_px"], "y_px": mark["y_px"]} for mark in marks]
    if tags := bed.get("tags"):
        points["tags"] = [{**_places(tag), "id": f"tag {tag['id']}", "number": tag["id"]} for tag in tags]
    if stick := bed.get("stick"):
        ends = (stick["a_px"], stick["b_px"], stick.get("origin_px"))
        points["stick"] = [_at(end, px) for end, px in zip(points["stick"], ends, strict=True)]
        points["length_mm"] = round(1e3 * stick["length_m"], 9)
    clicks, targets = request.get("clicks") or {}, request.get("targets") or {}
    way, _, reach = str(next(iter(targets.values()), "")).partition(":")  # of all markers alike, but for their tags
    tags_on = {} if way in UNTAGGED else {name: str(target) for name, target in targets.items()}
    points["dots"] = [{**_at(dot, clicks.get(dot["id"])), "tag": tags_on.get(dot["id"])} for dot in points["dots"]]
    if tags_on:
        made["way"] = "tag"
    elif targets:
        made["way"] = way
        made |= {"reach": reach} if reach else {}
    plane = bed.get("plane") or {}
    axes = [list(plane.get(axis, ())) for axis in ("x_axis", "y_axis")]
    made["plane"] = next((key for key, (_, *own) in planes.items() if [*map(list, own)] == axes), given["plane"])
    typed = {
        "from": request.get("from_s") or None, "to": request.get("to_s"), "rate": request.get("filmed_per_s"),
        "focal": (bed.get("lens") or {}).get("focal_px"),
    }  # fmt: skip
    for key, metres in (("height", bed.get("marker_height_m")), ("camera", bed.get("camera_height_m"))):
        typed[key] = 1e3 * metres if isinstance(metres, int | float) else None
    made |= {key: f"{value:.12g}" for key, value in typed.items() if isinstance(value, int | float)}
    if isinstance(bed.get("camera"), dict):
        made["camera_file"] = bed["camera"]
    return made


def _places(known: Mapping[str, Any]) -> dict[str, Any]:
    return {"id": known["id"], **{f"{along}_mm": round(1e3 * known[f"{along}_m"], 9) for along in "xy"}}


def _at(point: Mapping[str, Any], px: Sequence[float] | None) -> dict[str, Any]:
    return {**point, "x_px": px[0] if px else None, "y_px": px[1] if px else None}
