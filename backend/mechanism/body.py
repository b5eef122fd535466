"""A rigid body as drawn: where it stands, what it weighs, how it looks."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from backend.mechanism.part import Id, Part, Vector3
from backend.mechanism.pose import Pose

SURFACES = (".stl", ".obj", ".ply", ".glb")  # kinds of file that a mesh may be
TRIANGLE_TOLERANCE = 1e-6  # relative: a flat plate meets the inequality with equality, and mass properties are rounded


class Inertia(Part):
    """Inertia about the centre of mass, in body axes [kg m²]; products are entries (xy = -∫ x y dm)."""

    xx: float
    yy: float
    zz: float
    xy: float = 0.0
    xz: float = 0.0
    yz: float = 0.0

    def matrix(self) -> np.ndarray:
        """The symmetric (3, 3) tensor [kg m²]."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])

    def principal_moments(self) -> tuple[float, float, float]:
        """Moments about the principal axes, ascending [kg m²]."""
        # Scaled first: the squares of small parts' inertias would underflow.
        scale = max(map(abs, (self.xx, self.yy, self.zz, self.xy, self.xz, self.yz)))
        if scale == 0.0:
            return 0.0, 0.0, 0.0
        low, middle, high = np.linalg.eigvalsh(self.matrix() / scale) * scale
        return float(low), float(middle), float(high)

    def fault(self) -> str | None:
        """Why no real mass distribution has this inertia, or None when one has."""
        low, middle, high = self.principal_moments()
        moments = f"principal moments {low:.6g}, {middle:.6g}, {high:.6g} kg m²"
        if not low > 1e-12 * high:
            return (
                f"inertia is not positive definite ({moments}); a solid body has three positive moments: "
                "export again with full precision, or give the part its real thickness"
            )
        if low + middle < high * (1.0 - TRIANGLE_TOLERANCE):
            return (
                f"inertia breaks the triangle inequality ({moments}: {low:.6g} + {middle:.6g} < {high:.6g}); "
                "check that it is taken about the centre of mass, and the sign and order of the products"
            )
        return None


def _weighs(mass_kg: float) -> float:
    if mass_kg < 0.0:
        raise ValueError(f"is {mass_kg:g}; it must be above 0, of a fixed body it may be 0")
    return mass_kg


class Inertial(Part):
    """Mass properties: mass [kg], centre of mass in body axes [m], inertia about it [kg m²]."""

    mass_kg: Annotated[float, AfterValidator(_weighs), Field(json_schema_extra={"minimum": 0.0})]
    center_of_mass_m: Vector3
    inertia_kg_m2: Inertia


class Mesh(Part):
    """A file with the body's surface, in body axes; `scale_to_m` turns its numbers into metres.

    STL, OBJ, PLY or GLB, and alike for each: a GLB is neither turned from y-up nor taken for metres.
    """

    uri: Id
    scale_to_m: Annotated[float, Field(gt=0.0)]


class Body(Part):
    """A rigid body; its frame is the CAD part's frame, `pose` is X_WB as drawn."""

    id: Id
    name: str | None = None
    fixed: bool = False
    pose: Pose = Pose()
    inertial: Inertial | None = None
    meshes: Annotated[tuple[Mesh, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _can_move(self) -> Body:
        mass = self.inertial.mass_kg if self.inertial else 0.0
        if mass > 0.0 and self.inertial and (fault := self.inertial.inertia_kg_m2.fault()):
            raise ValueError(fault)
        if not self.fixed and not mass > 0.0:
            number = "no inertial" if self.inertial is None else f"mass {mass:g} kg"
            raise ValueError(f"moves but has {number}; give the part a material with a density, or declare it fixed")
        return self

    def moving_inertial(self) -> Inertial:
        """Mass properties of a body that moves; a fixed body may have none and then raises ValueError."""
        if self.inertial is None or not math.isfinite(self.inertial.mass_kg):
            raise ValueError(f'body "{self.id}" is fixed and was drawn without mass')
        return self.inertial
