"""A crank-rocker: ground 100, crank 40, coupler 90, rocker 70 mm."""

import math
from pathlib import Path

import cadquery as cq

from cad_export import Drawing, bar, cylinder

UPRIGHT = cq.Location((0, 0, 0), (1, 0, 0), 90)  # the drawing plane xy becomes the world's xz
GROUND, CRANK, COUPLER, ROCKER = 100.0, 40.0, 90.0, 70.0


def design(crank_deg: float = 65.0) -> Drawing:
    """crank_deg: of the crank from the ground link, as drawn."""
    crank_rad = math.radians(crank_deg)
    bx, by = CRANK * math.cos(crank_rad), CRANK * math.sin(crank_rad)
    diagonal = math.hypot(GROUND - bx, -by)
    at_b = math.acos((COUPLER**2 + diagonal**2 - ROCKER**2) / (2 * COUPLER * diagonal))
    coupler_rad = math.atan2(-by, GROUND - bx) + at_b
    cx, cy = bx + COUPLER * math.cos(coupler_rad), by + COUPLER * math.sin(coupler_rad)
    rocker_deg = math.degrees(math.atan2(cy, cx - GROUND))

    frame = bar((0, "pin"), (GROUND, "pin"))
    crank = bar((0, "hole"), (CRANK, "pin"))
    rocker = bar((0, "hole"), (ROCKER, "pin"))
    coupler = bar((0, "hole"), (COUPLER, "hole"))

    assembly = cq.Assembly(name="fourbar", loc=UPRIGHT)
    assembly.add(frame, name="frame")
    assembly.add(crank, name="crank", loc=cq.Location((0, 0, 5.5), (0, 0, 1), crank_deg))
    assembly.add(coupler, name="coupler", loc=cq.Location((bx, by, 11), (0, 0, 1), math.degrees(coupler_rad)))
    assembly.add(rocker, name="rocker", loc=cq.Location((GROUND, 0, 5.5), (0, 0, 1), rocker_deg))

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium
    for joint, carrier, x_pin, carried, x_hole in (
        ("A", "frame", 0, "crank", 0),
        ("B", "crank", CRANK, "coupler", 0),
        ("C", "rocker", ROCKER, "coupler", COUPLER),
        ("D", "frame", GROUND, "rocker", 0),
    ):
        pin = cylinder(drawing.parts[carrier].shape, (x_pin, 0, 0), diameter_mm=8.0)
        hole = cylinder(drawing.parts[carried].shape, (x_hole, 0, 0), diameter_mm=8.1)
        drawing.revolute(joint, carrier, carried, axis=pin, axis_b=hole)
    drawing.marker("crank_middle", "crank", (0.5 * CRANK, 0, 5))
    drawing.marker("B", "crank", (CRANK, 0, 10.5))
    drawing.marker("coupler_middle", "coupler", (0.5 * COUPLER, 0, 5))
    drawing.marker("coupler_end", "coupler", (COUPLER - 10, 0, 5))
    drawing.marker("rocker_middle", "rocker", (0.5 * ROCKER, 0, 5))
    drawing.marker("C", "rocker", (ROCKER, 0, 10.5))
    return drawing


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
