"""The bed as the user describes it: printed marks, the plane they lie in, and what is known of the camera.

The bed file is JSON: either the list of marks alone, or an object with `marks` or `tags` and any of `plane`,
`lens` or `camera`, `camera_height_m`, `marker_height_m`, `readout_s`, and how well places and heights are known:
`mark_sd_m`, `marker_height_sd_m`.  Of a clip that somebody else filmed often one length is known, and no mark: `stick`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, ValidationError, model_validator

from backend.observe.camera import CAMERA, Camera, read_camera
from backend.observe.described import Described, Number
from backend.observe.lens import Lens
from backend.observe.plane import Plane
from backend.observe.tag_names import KIT, Tag, tag_named
from backend.observe.tracking_error import TrackingError

DRAWN = "drawn"  # heights are the drawing's: see drawn_heights.py


class BedMark(Described):
    """One mark: where it is on the bed [m] and in the picture [px], (0, 0) the centre of the corner pixel."""

    id: str
    x_m: Number
    y_m: Number
    x_px: Number
    y_px: Number


class BedTag(Described):
    """One printed tag: its number, its family where it is not the kit's, and where its centre is on the bed [m]."""

    id: int
    family: str = KIT
    x_m: Number
    y_m: Number

    @property
    def tag(self) -> Tag:
        """As it is looked for."""
        return tag_named(f"{self.family}:{self.id}")

    @model_validator(mode="after")
    def _is_one(self) -> BedTag:
        tag_named(f"{self.family}:{self.id}")
        return self


class Stick(Described):
    """A known length in the plane of the motion, of a camera that is square to it and stands still.

    a_px, b_px: its ends in the picture.  origin_px: where the plane's origin is seen, which may be outside the picture;
    a_px where None.  turn_deg: by which the plane's x axis is seen turned from the picture's level to the left.
    """

    a_px: tuple[Number, Number]
    b_px: tuple[Number, Number]
    length_m: Annotated[Number, Field(gt=0)]
    origin_px: tuple[Number, Number] | None = None
    turn_deg: Number = 0.0

    @model_validator(mode="after")
    def _has_length(self) -> Stick:
        if self.length_px < 1:
            raise ValueError("its ends fall on one pixel; give two points of the picture that are far apart")
        return self

    @property
    def length_px(self) -> float:
        """As it is seen [px]."""
        return float(np.hypot(*np.subtract(self.b_px, self.a_px)))

    def to_metres(self) -> Float[np.ndarray, "3 3"]:
        """The homography from pixels, whose v runs down, to the plane."""
        s, turn = self.length_m / self.length_px, np.deg2rad(self.turn_deg)
        A = s * np.array([[np.cos(turn), -np.sin(turn)], [-np.sin(turn), -np.cos(turn)]])
        H = np.eye(3)
        H[:2, :2], H[:2, 2] = A, -A @ np.array(self.a_px if self.origin_px is None else self.origin_px)
        return H


class Bed(Described):
    """Everything known about the bed.

    tags: marks that are found in the first picture by themselves.  stick: in place of both.  camera: what `linktwin
    calibrate` saved, in place of lens.  camera_height_m: camera to bed, where no lens is known.  marker_height_m: dots
    above the plane of the marks, towards the camera [m]: one for all, by marker, or DRAWN; unknown where None; those
    that a camera file found are taken where none are given.  mark_sd_m, marker_height_sd_m: how well the marks' places
    on the bed, and given heights, are known.  readout_s: from the first row of a picture to the last, of a rolling
    shutter.
    """

    marks: tuple[BedMark, ...] = ()
    tags: tuple[BedTag, ...] = ()
    stick: Stick | None = None
    plane: Plane = Plane()
    lens: Lens | None = None
    camera: Camera | None = None
    camera_height_m: Annotated[Number, Field(gt=0)] | None = None
    marker_height_m: Number | Literal["drawn"] | dict[str, Number] | None = None
    mark_sd_m: Annotated[Number, Field(ge=0)] = 2e-4
    marker_height_sd_m: Annotated[Number, Field(gt=0)] = 5e-4
    readout_s: Annotated[Number, Field(ge=0, lt=0.1)] = 0.0

    @model_validator(mode="after")
    def _one_lens(self) -> Bed:
        if self.lens and self.camera:
            raise ValueError("both lens and camera are given; keep one of them")
        return self

    @model_validator(mode="after")
    def _stick_alone(self) -> Bed:
        if self.stick and (self.marks or self.tags or self.lens or self.camera):
            raise ValueError("a stick stands in for marks, tags, lens and camera; give it without them")
        return self

    def metres(self) -> Float[np.ndarray, "mark 2"]:
        """The marks on the bed [m]."""
        return np.array([[m.x_m, m.y_m] for m in self.marks]).reshape(-1, 2)

    def pixels(self) -> Float[np.ndarray, "mark 2"]:
        """The marks in the picture [px]."""
        return np.array([[m.x_px, m.y_px] for m in self.marks]).reshape(-1, 2)

    def heights(self, markers: Sequence[str]) -> tuple[Float[np.ndarray, "marker"], list[str]]:
        """Height of each marker above the marks' plane [m], zero where unknown, and what is to be said of it.

        Raises TrackingError where a height is given for something that is no marker.
        """
        given = self.marker_height_m
        if not isinstance(given, dict):
            return np.full(len(markers), given or 0.0), []
        if unknown := sorted(set(given) - set(markers)):
            raise TrackingError(f"marker_height_m names {', '.join(unknown)}; the drawing has {', '.join(markers)}.")
        missing = [n for n in markers if n not in given]
        note = [f"No height is given for {', '.join(missing)}; taken as zero."] if missing else []
        return np.array([given.get(n, 0.0) for n in markers]), note


def read_bed(bed: Bed | str | Path | Sequence[Any] | Mapping[str, Any]) -> Bed:
    """A Bed from a file, a list of marks or an object.  Raises TrackingError for what cannot fix the plane."""
    if isinstance(bed, Bed):
        return _checked(bed)
    source = str(bed) if isinstance(bed, str | Path) else "the bed marks"
    bed, camera = _opened(bed)
    if camera and isinstance(bed, Mapping):
        bed = {**bed, "camera": read_camera(camera)}
    try:
        return _checked(Bed.model_validate(bed if isinstance(bed, Mapping) else {"marks": bed}))
    except ValidationError as error:
        found = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'bed'}: {e['msg']}" for e in error.errors()[:5])
        marks = ' Each mark is {"id": "A", "x_m": 0.1, "y_m": 0.2, "x_px": 640, "y_px": 360}.'
        of_marks = any(e["loc"][:1] in ((), ("marks",)) for e in error.errors())
        units = " Names say the unit: _m metres, _s seconds, _px pixels."
        raise TrackingError(f"{source}: {found}.{marks if of_marks else units}") from error


def spare_camera(bed: Any, out_dir: str | Path) -> None:
    """Refuse to write a clip's camera over the one that its bed file names.  Raises TrackingError."""
    camera, written = _opened(bed)[1], Path(out_dir) / CAMERA
    if camera and written.exists() and written.samefile(camera):
        raise TrackingError(
            f"{written} is the camera that the bed file names, and the clip's own, with its pose, would be written "
            "over it. Give another folder: --out."
        )


def _opened(bed: Any) -> tuple[Any, Path | None]:
    """What a bed file holds, or what is given in its place, and the camera file that it names."""
    folder = Path()
    if isinstance(bed, str | Path):
        folder = Path(bed).parent
        try:
            bed = json.loads(Path(bed).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise TrackingError(f"{bed} cannot be read as JSON: {error}. Give the file of bed marks.") from error
    named = bed.get("camera") if isinstance(bed, Mapping) else None
    return bed, folder / named if isinstance(named, str) else None


def _checked(bed: Bed) -> Bed:
    if bed.marker_height_m is None and bed.camera and bed.camera.pose:
        bed = bed.model_copy(update={"marker_height_m": bed.camera.pose.found_heights_m() or None})
    if bed.stick:
        return bed
    ids = [m.id for m in bed.marks] + [f"tag {t.tag}" for t in bed.tags]
    if len(ids) < 4:
        raise TrackingError(
            f"{len(ids)} bed marks are given ({', '.join(ids) or 'none'}); four or more fix the bed. "
            "Mark more known points, spread over the whole bed; or give a stick where one length is all that is known."
        )
    if repeated := sorted({i for i in ids if ids.count(i) > 1}):
        raise TrackingError(f"Bed mark {', '.join(repeated)} is given twice; give each mark its own id.")
    spots = np.array([[m.x_m, m.y_m] for m in (*bed.marks, *bed.tags)])
    seen = [] if bed.tags else [(bed.pixels(), "in the picture")]  # tags are still to be found
    for points, where in [(spots, "on the bed"), *seen]:
        if not spans_a_plane(points):
            raise TrackingError(
                f"The {len(ids)} bed marks ({', '.join(ids)}) lie on a line {where}, or all but one do. "
                "Add a mark off that line, so that four form a proper quadrilateral."
            )
    return bed


def spans_a_plane(points: Float[np.ndarray, "mark 2"]) -> bool:
    """Whether some four of the points have no three on a line, so that they fix a homography.

    Equivalent: mapping the points to themselves leaves one null vector only; the next singular value must
    stand clear of rounding and of clicks that are a pixel off (0.002, against 0.3 for a rectangle).
    """
    p = points - points.mean(0)
    p = p / max(float(np.sqrt((p**2).sum(1).mean() / 2)), 1e-12)
    one, none = np.ones((len(p), 1)), np.zeros((len(p), 3))
    h = np.c_[p, one]
    rows = np.concatenate([np.c_[h, none, -p[:, :1] * h], np.c_[none, h, -p[:, 1:] * h]])
    values = np.linalg.svd(rows, compute_uv=False)
    return len(values) >= 8 and bool(values[7] > 2e-3 * values[0])
