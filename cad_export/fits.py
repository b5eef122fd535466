"""How a pin sits in its hole, read from the two cylindrical faces of a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backend.mechanism.drawing_error import DrawingError
from cad_export.axis import Axis


@dataclass(frozen=True)
class Fit:
    """Diameters, bearing length and play [mm]; None where the face was not drawn."""

    pin_diameter_mm: float | None = None
    hole_diameter_mm: float | None = None
    bearing_length_mm: float | None = None

    @property
    def radial_clearance_mm(self) -> float | None:
        """Half of hole minus pin."""
        if self.pin_diameter_mm is None or self.hole_diameter_mm is None:
            return None
        return 0.5 * (self.hole_diameter_mm - self.pin_diameter_mm)

    def json(self) -> dict[str, object]:
        """The `fit` block of mechanism.json."""
        lengths = {
            "pin_diameter_m": self.pin_diameter_mm,
            "hole_diameter_m": self.hole_diameter_mm,
            "bearing_length_m": self.bearing_length_mm,
            "radial_clearance_m": self.radial_clearance_mm,
        }
        # To the picometre: 0.5 * (8.1 - 8.0) is 0.04999999999999982.
        known = {name: round(value * 1e-3, 12) for name, value in lengths.items() if value is not None}
        return {**known, "source": "drawn"}


def fit_between(id: str, a: Axis, b: Axis | None) -> Fit | None:
    """The fit of two axes in one frame; None when neither comes from a cylinder, or both from the same kind.

    Raises DrawingError when the pin is thicker than its hole. The bearing length is negative where the pin does
    not reach into the hole.
    """
    drawn = {axis.cylinder.sense: axis for axis in (a, b) if axis is not None and axis.cylinder is not None}
    pin, hole = drawn.get("pin"), drawn.get("hole")
    both_alike = b is not None and a.cylinder and b.cylinder and a.cylinder.sense == b.cylinder.sense
    if both_alike or not drawn:
        return None  # two plates on a pin that is not drawn: neither face says how thick the pin is
    if pin is None or hole is None:
        (axis,) = drawn.values()
        low, high = axis.span_mm or (0.0, 0.0)
        diameter = axis.cylinder.diameter_mm if axis.cylinder else None
        return Fit(diameter if axis is pin else None, diameter if axis is hole else None, high - low)
    if pin.cylinder is None or hole.cylinder is None:
        return None
    pin_mm, hole_mm = pin.cylinder.diameter_mm, hole.cylinder.diameter_mm
    if pin_mm > hole_mm:
        raise DrawingError(
            f'joint "{id}": pin {pin_mm:g} mm is thicker than its hole {hole_mm:g} mm by {pin_mm - hole_mm:.4g} mm; '
            "a press fit is a fixed joint, otherwise widen the hole"
        )
    return Fit(pin_mm, hole_mm, overlap(pin, hole))


def check_bearing(id: str, fit: Fit) -> None:
    """Refuse a pin that does not reach into its hole."""
    if fit.bearing_length_mm is not None and not fit.bearing_length_mm > 0.0:
        raise DrawingError(
            f'joint "{id}": the pin ends {-fit.bearing_length_mm:.4g} mm short of its hole along the axis; '
            "lengthen the pin, or move the parts together"
        )


def overlap(a: Axis, b: Axis) -> float:
    """Length that both cover along a; negative when they are apart [mm]."""
    low_a, high_a = a.span_mm or (0.0, 0.0)
    shift = float(np.dot(np.asarray(b.point_mm) - np.asarray(a.point_mm), a.direction))
    forward = float(np.sign(np.dot(a.direction, b.direction)))
    low_b, high_b = sorted(shift + forward * end for end in (b.span_mm or (0.0, 0.0)))
    return min(high_a, high_b) - max(low_a, low_b)
