"""A picture of proposed joints: the parts' edges seen along most of the axes, the joints numbered, and a list."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from html import escape

import cadquery as cq
import numpy as np
from jaxtyping import Float

from cad_export.assembly import CadPart
from cad_export.proposal import Proposal

WIDTH, LINE, EDGE = 960.0, 22.0, 24.0  # of the page, a line of the list, the margin [px]
TALLEST = 640.0  # of the drawing [px]
POINTS = 24  # along an edge that is not straight
HUES = 8
STYLE = """
svg{background:#fff;color:#1d2433;font:14px system-ui,sans-serif} text{fill:currentColor}
.part{fill:none;stroke-width:1} .name{font-size:12px} .faint{opacity:.7}
.open{fill:none;stroke:#c2410c;stroke-width:2.5} .declared{fill:none;stroke:#15803d;stroke-width:2.5}
.number{font-weight:700}
.number,.name{paint-order:stroke;stroke:#fff;stroke-width:3px}
@media (prefers-color-scheme:dark){svg{background:#14181f;color:#e5e9f0} .number,.name{stroke:#14181f}
.open{stroke:#fb923c} .declared{stroke:#4ade80}}
"""


def proposal_svg(parts: Mapping[str, CadPart], proposed: Sequence[Proposal], title: str) -> str:
    """One SVG page: open proposals orange, those that a declared joint stands in the place of green."""
    R_VW = _view(parts, proposed).T
    edges = {path: [R_VW @ line for line in lines] for path, lines in _edges(parts).items()}
    every = np.hstack([line[:2] for lines in edges.values() for line in lines])
    low, high = every.min(axis=1), every.max(axis=1)
    size = np.maximum(high - low, 1e-9)
    scale = min((WIDTH - 2 * EDGE) / size[0], TALLEST / size[1])
    tall, top = scale * size[1], 2 * EDGE + LINE

    def place(p: Float[np.ndarray, "..."]) -> np.ndarray:
        return np.array([EDGE + scale * (p[0] - low[0]), top + scale * (high[1] - p[1])])

    drawn = [f'<text x="{EDGE:g}" y="{EDGE + 8:g}" font-size="18" font-weight="600">{escape(title)}</text>']
    hue = {path: f"hsl({round(360 * (number % HUES) / HUES + 210) % 360} 55% 50%)" for number, path in enumerate(edges)}
    for path, lines in edges.items():
        trace = " ".join("M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in place(line).T) for line in lines)
        drawn.append(f'<path class="part" stroke="{hue[path]}" d="{trace}"><title>{escape(path)}</title></path>')
    for path, lines in edges.items():
        longest = max(lines, key=lambda line: np.linalg.norm(line[:2, -1] - line[:2, 0]))
        x, y = place(0.65 * longest[:, 0] + 0.35 * longest[:, -1])  # off the middle, where links cross
        drawn.append(f'<text class="name" x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{escape(path)}</text>')
    below = top + tall + EDGE + LINE
    for number, one in enumerate(proposed, start=1):
        x, y = place(R_VW @ parts[one.part_a].X_WP.point(np.asarray(one.axis_a.point_mm)))
        radius = max(6.0, 0.5 * scale * (one.fit.pin_diameter_mm or 0.0))
        kind, said = "declared" if one.declared else "open", escape(one.sentence())
        drawn.append(
            f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"><title>{said}</title></circle>'
        )
        drawn.append(f'<text class="number" x="{x + radius + 2:.1f}" y="{y - radius:.1f}">{number}</text>')
        drawn.append(f'<text x="{EDGE:g}" y="{below + LINE * number:.1f}">{number}  {said}</text>')
    if not proposed:
        drawn.append(
            f'<text x="{EDGE:g}" y="{below + LINE:.1f}">No pin of one part stands in a hole of another as placed; '
            "declare the joints, or place the parts so that they meet.</text>"
        )
    drawn.append(
        f'<text class="faint" x="{EDGE:g}" y="{below:.1f}">orange: proposed, to be confirmed; '
        "green: declared, which wins</text>"
    )
    whole = below + LINE * max(1, len(proposed)) + EDGE
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {whole:.0f}" role="img">'
        f"<title>{escape(title)}</title><style>{STYLE}</style>\n" + "\n".join(drawn) + "\n</svg>\n"
    )


def _view(parts: Mapping[str, CadPart], proposed: Sequence[Proposal]) -> Float[np.ndarray, "3 3"]:
    """R_WV: z along the axis that most joints share, y as near to the world's z, or y, as that allows."""
    along = [tuple(np.round(parts[one.part_a].X_WP.direction(np.asarray(one.axis_a.direction)), 3)) for one in proposed]
    axis = np.array(Counter(along).most_common(1)[0][0] if along else (0.0, 0.0, 1.0))
    axis = axis / np.linalg.norm(axis)
    up = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(up, axis)
    return np.column_stack([x / np.linalg.norm(x), np.cross(axis, x / np.linalg.norm(x)), axis])


def _edges(parts: Mapping[str, CadPart]) -> dict[str, list[Float[np.ndarray, "3 n"]]]:
    """Points along the edges of each part, in the world; occurrences of one solid are traced once."""
    traced: dict[Hashable, list[np.ndarray]] = {}
    for part in parts.values():
        if part.solid_key not in traced:
            traced[part.solid_key] = [_along(edge) for edge in part.shape.Edges()]
    return {
        path: [part.X_WP.rotation @ line + part.X_WP.position_mm[:, None] for line in traced[part.solid_key]]
        for path, part in parts.items()
    }


def _along(edge: cq.Edge) -> Float[np.ndarray, "3 n"]:
    count = 2 if edge.geomType() == "LINE" else POINTS
    points = edge.positions(np.linspace(0.0, 1.0, count))  # pyright: ignore[reportAttributeAccessIssue]
    return np.array([[point.x, point.y, point.z] for point in points], float).T
