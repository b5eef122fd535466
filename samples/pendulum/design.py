"""A bar with a round bob, hung from a plate by one pin."""

from pathlib import Path

import cadquery as cq

from cad_export import Drawing, bar, cylinder

UPRIGHT = cq.Location((0, 0, 0), (1, 0, 0), 90)  # the drawing plane xy becomes the world's xz


def design(length_mm: float = 200.0, angle_deg: float = 30.0) -> Drawing:
    """length_mm: pin to middle of the bob.  angle_deg: from hanging straight down, as drawn."""
    plate = cq.Workplane("XY").box(60, 60, 10, centered=(True, True, False)).translate((0, 0, -10))
    frame = plate.union(cq.Workplane("XY").circle(4).extrude(5.5))
    bob = cq.Workplane("XY").center(length_mm, 0).circle(20).extrude(5)
    link = bar((0, "hole"), (length_mm, "plain")).union(bob)

    assembly = cq.Assembly(name="pendulum", loc=UPRIGHT)
    assembly.add(frame, name="frame")
    assembly.add(link, name="link", loc=cq.Location((0, 0, 0.5), (0, 0, 1), angle_deg - 90))

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium
    drawing.revolute(
        "pivot",
        "frame",
        "link",
        axis=cylinder(frame, (0, 0, 0)),
        axis_b=cylinder(link, (0, 0, 0), diameter_mm=8.1),
        drawn_at_deg=angle_deg,
    )
    drawing.marker("middle", "link", (0.5 * length_mm, 0, 5))
    drawing.marker("bob", "link", (length_mm, 0, 5))
    return drawing


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
