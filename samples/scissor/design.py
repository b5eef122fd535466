"""A scissor of any number of cells, lying flat, opened by a spring across each end."""

import math
from pathlib import Path

import cadquery as cq

from cad_export import Axis, Drawing, bar, cylinder

PIN = 8.0
LAYER = 5.5  # thickness of a bar and the gap above it


def design(
    cells: int = 10,
    bar_mm: float = 200.0,
    angle_deg: float = 60.0,
    spring_n_per_m: float = 100.0,
    free_length_share: float = 0.7,
    spring_cells: int = 0,
    hole_mm: float = 8.1,
) -> Drawing:
    """bar_mm: between a bar's outer pins.  angle_deg: of the bars from the long axis, as drawn.

    spring_n_per_m: of the spring across each end, 0 for none.  free_length_share: its free length over the drawn
    distance of the pins it joins; below 1 it pulls the ends together, and the scissor grows longer.  spring_cells: how
    many cells, from the first, have a spring across their near end; 0 for a spring across either end of the scissor.
    """
    if cells < 1:
        raise ValueError(f"{cells} cells; a scissor has one or more")
    if not 0 <= spring_cells <= cells:
        raise ValueError(f"springs in {spring_cells} of {cells} cells; give 0 to {cells}")
    half = 0.5 * bar_mm
    c, s = half * math.cos(math.radians(angle_deg)), half * math.sin(math.radians(angle_deg))

    # Rising bars lie below, falling bars above them; every pin is borne in a hole of the other layer.
    rising = bar((0, "hole"), (half, "pin"), (bar_mm, "pin"), hole_diameter_mm=hole_mm)
    falling = bar((0, "hole"), (half, "hole"), (bar_mm, "pin_down"), hole_diameter_mm=hole_mm)
    frame, slider = _frame(s, half), _slider()

    assembly = cq.Assembly(name="scissor")
    assembly.add(frame, name="frame")
    assembly.add(slider, name="slider", loc=cq.Location((0, s, 0)))
    for i in range(cells):
        x = 2 * c * i
        assembly.add(rising, name=f"A{i}", loc=cq.Location((x, -s, 0), (0, 0, 1), angle_deg))
        assembly.add(falling, name=f"B{i}", loc=cq.Location((x, s, LAYER), (0, 0, 1), -angle_deg))

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium

    middle_pin, end_pin = cylinder(rising, (half, 0, 0), PIN), cylinder(rising, (bar_mm, 0, 0), PIN)
    low_pin = cylinder(falling, (bar_mm, 0, 0), PIN)
    low_hole = cylinder(rising, (0, 0, 0), hole_mm)
    top_hole, middle_hole = cylinder(falling, (0, 0, 0), hole_mm), cylinder(falling, (half, 0, 0), hole_mm)
    drawing.revolute("start_low", "frame", "A0", cylinder(frame, (0, -s, 0), PIN), low_hole)
    drawing.revolute("start_top", "slider", "B0", cylinder(slider, (0, 0, 0), PIN), top_hole)
    along_groove = (0, 1, 0)
    drawing.prismatic("guide", "frame", "slider", Axis((0, -s, 0), along_groove), Axis((0, 0, 0), along_groove))
    for i in range(cells):
        drawing.revolute(f"mid{i}", f"A{i}", f"B{i}", middle_pin, middle_hole)
        if i < cells - 1:
            drawing.revolute(f"top{i}", f"A{i}", f"B{i + 1}", end_pin, top_hole)
            drawing.revolute(f"low{i}", f"B{i}", f"A{i + 1}", low_pin, low_hole)

    last = cells - 1
    springs = [("start_spring", "A0", "B0", 0.0), ("end_spring", f"B{last}", f"A{last}", bar_mm)]
    if spring_cells:
        springs = [(f"spring{i}", f"A{i}", f"B{i}", 0.0) for i in range(spring_cells)]
    if spring_n_per_m:
        for id, a, b, x in springs:
            drawing.extension_spring(
                id,
                a,
                b,
                anchor_a_mm=(x, 0, LAYER if a[0] == "A" else 0),  # both anchors in one plane, between the layers
                anchor_b_mm=(x, 0, LAYER if b[0] == "A" else 0),
                stiffness_n_per_m=spring_n_per_m,
                free_length_mm=free_length_share * 2 * s,
            )
    _mark(drawing, cells, bar_mm)
    return drawing


def _frame(s: float, half: float) -> cq.Workplane:
    """A plate under the first cell, with a pin for A0 and a groove along y for the slider's key."""
    plate = cq.Workplane("XY").box(60, 2 * half + 60, 10, centered=(True, True, False)).translate((0, 0, -10.5))
    groove = cq.Workplane("XY").box(8.2, 2 * half + 60, 5, centered=(True, True, False)).translate((0, 0, -5.5))
    pin = cq.Workplane("XY", origin=(0, -s, -5.5)).circle(0.5 * PIN).extrude(10.5)
    seat = cq.Workplane("XY", origin=(0, -s, -5.5)).circle(8).extrude(5)
    return plate.cut(groove).union(seat).union(pin)


def _slider() -> cq.Workplane:
    """A block with a key below and, above, a pin that reaches the upper layer."""
    block = cq.Workplane("XY").box(20, 20, 5, centered=(True, True, False))
    key = cq.Workplane("XY").box(8, 20, 5, centered=(True, True, False)).translate((0, 0, -5))
    pin = cq.Workplane("XY", origin=(0, 0, 5)).circle(0.5 * PIN).extrude(5.5)
    return block.union(key).union(pin)


def _mark(drawing: Drawing, cells: int, bar_mm: float) -> None:
    """A dot at every pin and at the free ends, seen from above."""
    top = 5.0 + LAYER  # of a rising bar's pin; the falling bars' upper face is 5 above their own origin
    drawing.marker("start_low", "A0", (0, 0, 5))
    drawing.marker("start_top", "B0", (0, 0, 5))
    for i in range(cells):
        end = i == cells - 1
        drawing.marker(f"mid{i}", f"A{i}", (0.5 * bar_mm, 0, top))
        drawing.marker("end_top" if end else f"top{i}", f"A{i}", (bar_mm, 0, top))
        drawing.marker("end_low" if end else f"low{i}", f"B{i}", (bar_mm, 0, 5))


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
