"""A crank that drives a block along a rail."""

import math
from pathlib import Path

import cadquery as cq

from cad_export import Axis, Drawing, bar, cylinder

UPRIGHT = cq.Location((0, 0, 0), (1, 0, 0), 90)  # the drawing plane xy becomes the world's xz
Z_PIN = 13.5  # middle of the layer that the rod lies in, where the block's pin is borne


def design(crank_mm: float = 40.0, rod_mm: float = 120.0, crank_deg: float = 60.0) -> Drawing:
    """crank_mm, rod_mm: between pins, crank < rod.  crank_deg: of the crank from the rail, as drawn."""
    bx, by = crank_mm * math.cos(math.radians(crank_deg)), crank_mm * math.sin(math.radians(crank_deg))
    rod_rad = -math.asin(by / rod_mm)
    x_block = bx + rod_mm * math.cos(rod_rad)

    near, far = rod_mm - crank_mm - 20, rod_mm + crank_mm + 20  # the block's reach and half its length
    rail = cq.Workplane("XY").box(far - near, 14, 5, centered=(False, True, False)).translate((near, 0, 0))
    frame = bar((0, "pin"), (near, "plain")).union(rail)
    crank = bar((0, "hole"), (crank_mm, "pin"))
    rod = bar((0, "hole"), (rod_mm, "hole"))
    saddle = cq.Workplane("XY").box(30, 24, 9.5, centered=(True, True, False)).translate((0, 0, 1))
    groove = cq.Workplane("XY").box(30, 14.2, 4.5, centered=(True, True, False)).translate((0, 0, 1))
    pin = cq.Workplane("XY", origin=(0, 0, 10.5)).circle(4).extrude(5.5)
    block = saddle.cut(groove).union(pin)

    assembly = cq.Assembly(name="slider_crank", loc=UPRIGHT)
    assembly.add(frame, name="frame")
    assembly.add(crank, name="crank", loc=cq.Location((0, 0, 5.5), (0, 0, 1), crank_deg))
    assembly.add(rod, name="rod", loc=cq.Location((bx, by, 11), (0, 0, 1), math.degrees(rod_rad)))
    assembly.add(block, name="block", loc=cq.Location((x_block, 0, 0)))

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium
    drawing.revolute("A", "frame", "crank", cylinder(frame, (0, 0, 0), 8.0), cylinder(crank, (0, 0, 0), 8.1))
    drawing.revolute("B", "crank", "rod", cylinder(crank, (crank_mm, 0, 0), 8.0), cylinder(rod, (0, 0, 0), 8.1))
    drawing.revolute("C", "block", "rod", cylinder(block, (0, 0, 0), 8.0), cylinder(rod, (rod_mm, 0, 0), 8.1))
    # q is the way from the crank's pin to the block's.
    drawing.prismatic("rail", "frame", "block", Axis((0, 0, Z_PIN), (1, 0, 0)), Axis((0, 0, Z_PIN), (1, 0, 0)))
    drawing.marker("crank_middle", "crank", (0.5 * crank_mm, 0, 5))
    drawing.marker("B", "crank", (crank_mm, 0, 10.5))
    drawing.marker("rod_middle", "rod", (0.5 * rod_mm, 0, 5))
    drawing.marker("rod_end", "rod", (rod_mm - 10, 0, 5))
    drawing.marker("C", "block", (0, 0, 16))
    drawing.marker("block_edge", "block", (10, 8, 10.5))
    return drawing


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
