"""Bennett's four skew bars: a closed spatial loop that moves although counting says it cannot."""

import math
from pathlib import Path

import cadquery as cq

from cad_export import Drawing, cylinder

UPRIGHT = cq.Location((0, 0, 0), (1, 0, 0), 90)
PIN, HOLE = 8.0, 8.1


def design(
    long_mm: float = 200.0, short_mm: float = 120.0, twist_deg: float = 70.0, turn_deg: float = 110.0
) -> Drawing:
    """long_mm, short_mm: between the axes of opposite bars.  twist_deg: of the long bars' end axes.

    turn_deg: of the first joint, as drawn. The short bars' twist follows from Bennett's condition
    long / sin(twist) = short / sin(short twist).
    """
    a, b, alpha = long_mm, short_mm, math.radians(twist_deg)
    beta = math.asin(b * math.sin(alpha) / a)
    # tan(θ₁/2) tan(θ₂/2) = sin((β + α)/2) / sin((β - α)/2); opposite joints turn oppositely (Bennett 1903).
    theta = math.radians(turn_deg)
    ratio = math.sin(0.5 * (beta + alpha)) / math.sin(0.5 * (beta - alpha))
    turns = [theta, 2 * math.atan(ratio / math.tan(0.5 * theta)), -theta]
    turns.append(-turns[1])
    lengths, twists = (a, b, a, b), tuple(map(math.degrees, (alpha, beta, alpha, beta)))
    names = ("frame", "left", "coupler", "right")

    # Bar k stands at its first axis (z) with its second axis at x = length, tilted by its twist about x.
    assembly = cq.Assembly(name="bennett", loc=UPRIGHT)
    shapes = {length: _link(length, twist) for length, twist in zip(lengths, twists, strict=True)}
    place = cq.Location()
    for k, name in enumerate(names):
        assembly.add(shapes[lengths[k]], name=name, loc=place)
        far_axis = cq.Location((lengths[k], 0, 0), (1, 0, 0), twists[k])
        place = place * far_axis * cq.Location((0, 0, 0), (0, 0, 1), math.degrees(turns[(k + 1) % 4]))

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium
    for k, joint in enumerate(("B", "C", "D", "A")):
        pin = cylinder(shapes[lengths[k]], (lengths[k], 0, 0), PIN)
        hole = cylinder(shapes[lengths[(k + 1) % 4]], (0, 0, 0), HOLE)
        drawing.revolute(joint, names[k], names[(k + 1) % 4], axis=pin, axis_b=hole)
    for k in (1, 2, 3):
        drawing.marker(f"{names[k]}_start", names[k], (20, 0, 4))
        drawing.marker(f"{names[k]}_middle", names[k], (0.5 * lengths[k], 0, 4))
    return drawing


def _link(length: float, twist: float) -> cq.Workplane:
    """A round bar with a bored hub at its first axis and a fork with a pin at its second."""
    hub = cq.Workplane("XY", origin=(0, 0, -5)).circle(8).extrude(10)
    rod = cq.Workplane("YZ", origin=(6, 0, 0)).circle(5).extrude(length - 32)
    bore = cq.Workplane("XY", origin=(0, 0, -5)).circle(0.5 * HOLE).extrude(10)
    bridge = cq.Workplane("XY").box(8, 16, 21).translate((-24, 0, 0))
    cheeks = (
        cq.Workplane("XY")
        .box(20, 16, 5)
        .translate((-2, 0, 8))
        .union(cq.Workplane("XY").box(28, 16, 5).translate((-6, 0, -8)))
    )
    pin = cq.Workplane("XY", origin=(0, 0, -10.5)).circle(0.5 * PIN).extrude(21)
    fork = bridge.union(cheeks).union(pin).rotate((0, 0, 0), (1, 0, 0), twist).translate((length, 0, 0))
    return hub.union(rod).cut(bore).union(fork)


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
