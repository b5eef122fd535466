"""An ideal joint as drawn, with its limits and the fit of its pin."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from backend.mechanism.part import Id, Part
from backend.mechanism.pose import Frame

JointType = Literal["revolute", "fixed", "prismatic", "cylindrical", "spherical", "planar", "universal"]
WITHOUT_COORDINATE: frozenset[str] = frozenset({"fixed", "spherical", "universal"})  # no single freedom to call q


class Limits(Part):
    """Range of the joint position q [rad, or m for `prismatic`]; a missing side is open."""

    lower: float | None = None
    upper: float | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower {self.lower:g} is above upper {self.upper:g}; swap them")
        return self


class Fit(Part):
    """How the pin sits in its hole [m]; `source` says whether it was drawn, declared or inferred."""

    pin_diameter_m: Annotated[float, Field(gt=0.0)] | None = None
    hole_diameter_m: Annotated[float, Field(gt=0.0)] | None = None
    bearing_length_m: Annotated[float, Field(gt=0.0)] | None = None
    radial_clearance_m: float | None = None
    source: str | None = None

    @model_validator(mode="after")
    def _loose(self) -> Fit:
        remedy = "a press fit is a `fixed` joint; otherwise correct the diameters"
        if self.radial_clearance_m is not None and self.radial_clearance_m < 0.0:
            raise ValueError(f"radial_clearance_m is {self.radial_clearance_m:g} m, below zero; {remedy}")
        pin, hole = self.pin_diameter_m, self.hole_diameter_m
        if pin is not None and hole is not None and hole < pin:
            raise ValueError(f"pin {pin * 1e3:g} mm is thicker than its hole {hole * 1e3:g} mm; {remedy}")
        return self

    def clearance_m(self) -> float | None:
        """Radial clearance: as stated, else half of hole minus pin; None when neither is known [m]."""
        if self.radial_clearance_m is not None:
            return self.radial_clearance_m
        if self.pin_diameter_m is None or self.hole_diameter_m is None:
            return None
        return 0.5 * (self.hole_diameter_m - self.pin_diameter_m)


class Joint(Part):
    """A joint between two bodies, with a frame in each; its axis is the frames' z.

    q is the rotation of frame_b about z relative to frame_a [rad], or its translation along z [m] for
    `prismatic`; `fixed`, `spherical` and `universal` have none. The drawn pose is where it starts.
    A `universal` joint's cross turns about y of frame_a and about x of frame_b, which stand square.
    """

    id: Id
    type: JointType
    body_a: Id
    body_b: Id
    frame_a: Frame
    frame_b: Frame
    limits: Limits | None = None
    fit: Fit | None = None
