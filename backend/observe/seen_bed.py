"""The bed as a clip's first picture shows it: its tags found, its saved camera made to fit the picture."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from backend.observe.bed import Bed, BedMark, read_bed
from backend.observe.tags import find_tags, of_other_family
from backend.observe.tracking_error import TrackingError


def bed_in_picture(bed: Bed, luma: UInt8[np.ndarray, "h w"]) -> tuple[Bed, list[str]]:
    """The bed with marks in place of tags and a lens in place of a saved camera, and what to warn of.

    Raises TrackingError where too few tags are seen, or the camera was calibrated for other pictures.
    """
    warnings: list[str] = []
    changes = {}
    if bed.camera:
        height_px, width_px = luma.shape
        changes["lens"], warnings = bed.camera.lens_for(width_px, height_px)
        changes["camera"] = None
    if bed.tags:
        marks, missing = _find(bed, luma)
        changes |= {"marks": (*bed.marks, *marks), "tags": ()}
        if missing:
            warnings.append(f"Bed tag {', '.join(missing)} was not found in the first picture; the others are used.")
    return (read_bed(bed.model_copy(update=changes)) if changes else bed), warnings


def _find(bed: Bed, luma: UInt8[np.ndarray, "h w"]) -> tuple[list[BedMark], list[str]]:
    """The tags that are seen, as marks, and the numbers of those that are not."""
    listed = [t.tag for t in bed.tags]
    seen = {tag: laid.centre_px.tolist() for tag, laid in find_tags(luma, listed).items()}
    marks = [
        BedMark(id=f"tag {t.tag}", x_m=t.x_m, y_m=t.y_m, x_px=seen[t.tag][0], y_px=seen[t.tag][1])
        for t in bed.tags
        if t.tag in seen
    ]
    missing = [str(t.tag) for t in bed.tags if t.tag not in seen]
    if len(bed.marks) + len(marks) < 4:
        others = sorted(set(seen) - {t.tag for t in bed.tags})
        unlisted = (
            f" Tags {', '.join(map(str, others))} are seen and not listed in the bed file: is it another bed's?"
            if others
            else ""
        )
        mirrored = find_tags(np.ascontiguousarray(luma[:, ::-1]), listed)
        if len(mirrored) > len(seen):
            raise TrackingError(
                "The picture is mirrored, as by a camera that faces the person: the bed tags are read in its mirror "
                "image. Film with the camera at the back, or send the clip without the mirror effect."
            )
        raise TrackingError(
            f"{len(marks)} of the {len(bed.tags)} bed tags are found in the first picture (missing: "
            f"{', '.join(missing)}); four marks or tags fix the bed.{unlisted} Keep the tags' white margins, "
            "sharp and free of reflections, at least 25 pixels wide, uncovered when the clip starts."
            + of_other_family(luma, listed)
        )
    return marks, missing
