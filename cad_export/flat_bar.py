"""The part most linkages are made of: a flat bar with pins and holes."""

from __future__ import annotations

from typing import Literal

import cadquery as cq

from backend.mechanism.drawing_error import DrawingError

Feature = Literal["hole", "pin", "pin_down", "plain"]


def bar(
    *stations: tuple[float, Feature],
    width_mm: float = 16.0,
    thickness_mm: float = 5.0,
    pin_diameter_mm: float = 8.0,
    hole_diameter_mm: float = 8.1,
    pin_length_mm: float = 5.5,
) -> cq.Workplane:
    """A bar along x with round ends, its underside on z = 0.

    stations: (x_mm, feature) from one end to the other; "pin" rises from the top, "pin_down" hangs below, "hole"
    goes through. Pins are long enough to pass a 0.5 mm gap and a second bar of equal thickness.

    >>> crank = bar((0, "hole"), (40, "pin"))
    """
    xs = [x for x, _ in stations]
    length = xs[-1] - xs[0] if len(xs) > 1 else 0.0
    if not length > 0.0 or sorted(xs) != xs:
        raise DrawingError(f"bar with stations at {xs} mm; give two or more, from the lowest x to the highest")
    body = cq.Workplane("XY").slot2D(length + width_mm, width_mm).extrude(thickness_mm)
    body = body.translate((0.5 * (xs[0] + xs[-1]), 0.0, 0.0))
    for x, feature in stations:
        match feature:
            case "hole":
                drill = cq.Workplane("XY").center(x, 0.0).circle(0.5 * hole_diameter_mm).extrude(thickness_mm)
                body = body.cut(drill)
            case "pin" | "pin_down":
                top = thickness_mm if feature == "pin" else -pin_length_mm
                pin = cq.Workplane("XY", origin=(x, 0.0, top)).circle(0.5 * pin_diameter_mm).extrude(pin_length_mm)
                body = body.union(pin)
            case "plain":
                pass
            case _:
                raise DrawingError(f'bar feature "{feature}" at {x:g} mm; write hole, pin, pin_down or plain')
    return body
