"""Mass properties from the exact boundary of solids, and their sum over a rigid body."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cadquery as cq
import numpy as np
from jaxtyping import Float
from OCP.BRep import BRep_Tool  # pyright: ignore[reportAttributeAccessIssue]

from backend.mechanism.drawing_error import DrawingError
from cad_export.placement import Placement, metres

MM = 1e-3  # m
LIGHTEST_KG_PER_M3, HEAVIEST_KG_PER_M3 = 10.0, 23_000.0  # the lightest foams; osmium is 22 590
OVERLAP = 1e-6  # share of the smaller solid: two faces that merely touch give rounding below it


@dataclass(frozen=True)
class MassProperties:
    """Mass, centre and inertia of a rigid piece, in some frame F.

    center_mm: p_FC, centre of mass in F [mm].
    inertia_kg_m2: about the centre of mass, in F's axes; products are tensor entries, xy = -∫ x y dm [kg m²].
    """

    mass_kg: float
    center_mm: Float[np.ndarray, "3"]
    inertia_kg_m2: Float[np.ndarray, "3 3"]

    def in_frame(self, X_GF: Placement) -> MassProperties:
        """The same piece seen from a frame G."""
        R = X_GF.rotation
        return MassProperties(self.mass_kg, X_GF.point(self.center_mm), R @ self.inertia_kg_m2 @ R.T)

    def json(self) -> dict[str, object]:
        """The `inertial` block of mechanism.json; nothing is rounded but products that are zero by symmetry."""
        inertia = self.inertia_kg_m2
        floor = 1e-12 * float(np.trace(inertia))
        entries = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        tensor = {name: float(inertia[at]) for name, at in entries.items()}
        return {
            "mass_kg": self.mass_kg,
            "center_of_mass_m": metres(self.center_mm),
            "inertia_kg_m2": {name: 0.0 if abs(value) < floor else value for name, value in tensor.items()},
        }


def mass_properties(shape: cq.Shape, density_kg_per_m3: float, part: str) -> MassProperties:
    """Mass properties of the solids in a shape, in the shape's own coordinates.

    Raises DrawingError naming the part when a solid is open, inside out or empty, when solids overlap, and when
    the density is not that of matter.
    """
    check_density(density_kg_per_m3, part)
    solids = checked_solids(shape, part)
    if fault := overlap_fault([(f"solid {n}", solid) for n, solid in enumerate(solids, 1)]):
        raise DrawingError(f'part "{part}": {fault}')
    return combined([_of_solid(solid, density_kg_per_m3) for solid in solids])


def _of_solid(solid: cq.Solid, density_kg_per_m3: float) -> MassProperties:
    # CadQuery's matrix of inertia is already about the centre of mass, in global axes, at density 1: mm⁵.
    inertia_mm5 = np.array(cq.Shape.matrixOfInertia(solid))
    return MassProperties(
        mass_kg=solid.Volume() * MM**3 * density_kg_per_m3,
        center_mm=np.array(cq.Shape.centerOfMass(solid).toTuple()),
        inertia_kg_m2=inertia_mm5 * MM**5 * density_kg_per_m3,
    )


def combined(pieces: Sequence[MassProperties]) -> MassProperties:
    """The pieces as one rigid body, all in the same frame (parallel axis theorem)."""
    mass = sum(piece.mass_kg for piece in pieces)
    center_mm = np.asarray(sum(piece.mass_kg * piece.center_mm for piece in pieces)) / mass
    inertia = np.zeros((3, 3))
    for piece in pieces:
        r = (piece.center_mm - center_mm) * MM
        inertia += piece.inertia_kg_m2 + piece.mass_kg * ((r @ r) * np.eye(3) - np.outer(r, r))
    return MassProperties(float(mass), center_mm, inertia)


def check_density(density_kg_per_m3: float, part: str) -> None:
    """Refuse a density that no solid has: 7.85 or 7 850 000 is steel in another unit."""
    if not LIGHTEST_KG_PER_M3 <= density_kg_per_m3 <= HEAVIEST_KG_PER_M3:
        raise DrawingError(
            f'part "{part}" has density {density_kg_per_m3:g} kg/m³, outside {LIGHTEST_KG_PER_M3:g} (foam) to '
            f"{HEAVIEST_KG_PER_M3:g} (beyond osmium); give it in kg/m³ (aluminium 2700), or state "
            'densityUnit="kg/m^3" in its cq.Material, whose numbers are g/cm^3 otherwise'
        )


def checked_solids(shape: cq.Shape, part: str) -> list[cq.Solid]:
    """The solids of a shape; DrawingError when there is none, or one without a sound closed volume."""
    solids = shape.Solids()
    volumes = [solid.Volume() for solid in solids]
    # Faces and shells outside every solid would add to the integral without enclosing anything.
    loose = len(shape.Faces()) - len({face for solid in solids for face in solid.Faces()})
    if not solids or loose:
        what = f"{loose} faces outside any solid" if solids else f"no solid (a {shape.ShapeType()} with volume 0 mm³)"
        raise DrawingError(
            f'part "{part}" holds {what}; extrude or thicken it, or close its shell with Solid.makeSolid'
        )
    for number, (solid, volume) in enumerate(zip(solids, volumes, strict=True), 1):
        if not all(BRep_Tool.IsClosed_s(shell.wrapped) for shell in solid.Shells()):
            fault = f"is open (its {len(solid.Faces())} faces leave a gap); add the missing face or sew the shell"
        elif volume < 0.0:
            fault = f"is inside out (volume {volume:g} mm³); turn it with .fix() or reverse its shell"
        elif not volume > 0.0:
            fault = f"has volume {volume:g} mm³; give it a thickness"
        elif not solid.isValid():
            fault = f"is not a valid solid (volume {volume:g} mm³); repair it with .fix() or .clean()"
        else:
            continue
        raise DrawingError(f'part "{part}": solid {number} of {len(solids)} {fault}')
    return solids


def overlap_fault(pieces: Sequence[tuple[str, cq.Shape]]) -> str | None:
    """Which two named pieces share volume, and how much; None when none do. Shared volume would weigh twice."""
    if len(pieces) < 2:
        return None
    boxes = [shape.BoundingBox() for _, shape in pieces]
    for (name, shape, box), (other_name, other, other_box) in itertools.combinations(
        ((name, shape, box) for (name, shape), box in zip(pieces, boxes, strict=True)), 2
    ):
        if not _boxes_meet(box, other_box):
            continue
        shared_mm3 = shape.intersect(other).Volume()
        if shared_mm3 > OVERLAP * min(shape.Volume(), other.Volume()):
            return (
                f"{name} and {other_name} overlap by {shared_mm3:.4g} mm³, which would weigh twice; "
                "fuse them (a.union(b), or a.fuse(b)), or cut one from the other"
            )
    return None


def _boxes_meet(a: cq.BoundBox, b: cq.BoundBox) -> bool:
    return all(
        getattr(a, f"{axis}min") < getattr(b, f"{axis}max") and getattr(b, f"{axis}min") < getattr(a, f"{axis}max")
        for axis in "xyz"
    )
