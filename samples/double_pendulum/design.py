"""Two bars, one hung from the other."""

from pathlib import Path

import cadquery as cq

from cad_export import Drawing, bar, cylinder

UPRIGHT = cq.Location((0, 0, 0), (1, 0, 0), 90)  # the drawing plane xy becomes the world's xz


def design(
    upper_mm: float = 200.0, lower_mm: float = 150.0, upper_deg: float = 60.0, lower_deg: float = 20.0
) -> Drawing:
    """upper_mm, lower_mm: between pins.  upper_deg, lower_deg: of each bar from hanging straight down, as drawn."""
    plate = cq.Workplane("XY").box(60, 60, 10, centered=(True, True, False)).translate((0, 0, -10))
    frame = plate.union(cq.Workplane("XY").circle(4).extrude(5.5))
    upper = bar((0, "hole"), (upper_mm, "pin"))
    lower = bar((0, "hole"), (lower_mm, "plain"))

    place_upper = cq.Location((0, 0, 0.5), (0, 0, 1), upper_deg - 90)
    assembly = cq.Assembly(name="double_pendulum", loc=UPRIGHT)
    assembly.add(frame, name="frame")
    assembly.add(upper, name="upper", loc=place_upper)
    knee = place_upper * cq.Location((upper_mm, 0, 5.5), (0, 0, 1), lower_deg - upper_deg)
    assembly.add(lower, name="lower", loc=knee)

    drawing = Drawing(assembly)
    drawing.ground("frame")
    drawing.material(density_kg_per_m3=2700)  # aluminium
    drawing.revolute(
        "shoulder",
        "frame",
        "upper",
        axis=cylinder(frame, (0, 0, 0)),
        axis_b=cylinder(upper, (0, 0, 0), diameter_mm=8.1),
        drawn_at_deg=upper_deg,
    )
    drawing.revolute(
        "knee",
        "upper",
        "lower",
        axis=cylinder(upper, (upper_mm, 0, 0), diameter_mm=8.0),
        axis_b=cylinder(lower, (0, 0, 0), diameter_mm=8.1),
        drawn_at_deg=lower_deg - upper_deg,
    )
    drawing.marker("upper_middle", "upper", (0.5 * upper_mm, 0, 5))
    drawing.marker("knee", "upper", (upper_mm, 0, 10.5))
    drawing.marker("lower_middle", "lower", (0.5 * lower_mm, 0, 5))
    drawing.marker("tip", "lower", (lower_mm, 0, 5))
    return drawing


if __name__ == "__main__":
    print(design().write(Path(__file__).parent))
