"""A mechanism at one instant, with arrows for what its joints put on their bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from backend.mechanism.mechanism import Mechanism
from backend.report.evidence import Motion
from backend.report.quantity import shown
from backend.report.skeleton import best_view, skeleton_of
from backend.report.svg import element, joined, path

if TYPE_CHECKING:
    from backend.simulate.joint_forces import JointLoad

WIDTH, LOWEST, HIGHEST = 1040, 240, 620
MARGIN = 40
LONGEST = 100  # pixels: the arrow of the largest force
SMALLEST = 0.01  # of the largest force seen: below it an arrow is a dot and left out
MOST_LABELS = 8
TONES = {"parent": "c1", "child": "c0"}
HEAD_LENGTH, HEAD_WIDTH = 9.0, 3.5
UPWARD = np.array([1.0, -1.0])  # pixels count downwards
LETTER, LINE = 8.5, 17.0  # pixels that a label's letter and line take
CORNERS = ((10, 18), (10, -8), (-10, 18), (-10, -8))  # where a label may stand beside its joint


@dataclass(frozen=True)
class _Paper:
    """World points, seen from the side, to pixels with equal scales; as high as what is drawn needs."""

    center: Float[np.ndarray, "2"]
    pixels_per_m: float
    height: float

    @classmethod
    def around(cls, seen: Float[np.ndarray, "n 2"]) -> _Paper:
        low, high = seen.min(0), seen.max(0)
        span, border = np.maximum(high - low, 1e-9), 2 * (MARGIN + LONGEST)
        scale = float((np.array([WIDTH - border, HIGHEST - border]) / span).min())
        return cls((low + high) / 2, scale, max(LOWEST, float(span[1]) * scale + border))

    def at(self, seen: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        return np.array([WIDTH / 2, self.height / 2]) + (seen - self.center) * UPWARD * self.pixels_per_m


def force_arrows(mechanism: Mechanism, motion: Motion, loads: Sequence[JointLoad], node: int, title: str) -> Markup:
    """The mechanism at a node of its motion: one arrow per joint and body, from the joint's point along the force.

    Length is in proportion to the force as seen; a ring marks joints whose reactions are not unique.
    """
    skeleton = skeleton_of(mechanism)
    placed = skeleton.placed(motion)
    view = best_view(placed)
    now = {body: view.seen(points[node]) for body, points in placed.items()}
    points = view.seen(np.array([load.child.point_W[node] for load in loads]).reshape(-1, 3))
    paper = _Paper.around(np.concatenate([*now.values(), view.seen(skeleton.held), points]))
    forces = view.seen(np.array([load.child.force_W[node] for load in loads]).reshape(-1, 3))
    sizes = np.array([load.force_n[node] for load in loads])
    largest = float(np.linalg.norm(forces, axis=-1).max(initial=0.0)) or 1.0
    reach = LONGEST / largest
    arrows = [
        _arrow(at, at + sign * reach * force * UPWARD, TONES[side])
        for side, sign in (("parent", -1.0), ("child", 1.0))
        for at, force in zip(paper.at(points), forces, strict=True)
        if np.linalg.norm(force) > SMALLEST * largest
    ]
    through = max((float(np.sqrt(max(s**2 - f @ f, 0.0))) for s, f in zip(sizes, forces, strict=True)), default=0.0)
    note = f"Seen in the {view.name}. The longest arrow is {shown(largest)} N."
    if through > SMALLEST * largest:
        note += f" Across this plane, unseen here, joints carry up to {shown(through)} N; the numbers count it."
    if any(load.not_unique for load in loads):
        note += " Ring: not every reaction of this joint is unique; see the table."
    legend = element(
        "span",
        element("span", "on the child (body B)", class_=f"key {TONES['child']} line"),
        element("span", "on the parent (body A)", class_=f"key {TONES['parent']} line"),
        class_="legend",
    )
    drawing = element(
        "svg",
        *(element("path", class_="bone", d=path(*_ordered(paper.at(seen)).T)) for seen in now.values()),
        *(element("circle", class_="held", cx=x, cy=y, r=5.0) for x, y in paper.at(view.seen(skeleton.held))),
        *(_ring(paper.at(p)) for p, load in zip(points, loads, strict=True) if load.not_unique),
        *arrows,
        _labels(loads, sizes, paper.at(points)),
        class_="arrows",
        viewBox=f"0 0 {WIDTH} {paper.height:.0f}",
        role="img",
        aria_label=title,
    )
    caption = element("figcaption", element("b", title), legend)
    return element("figure", caption, drawing, element("p", note, class_="note"), class_="wide")


def _ordered(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """A link's points along its length, so that its line does not fold back; a plate is closed."""
    if len(points) < 3:
        return points
    _, spread, axes = np.linalg.svd(points - points.mean(0))
    if spread[1] < 1e-3 * spread[0]:
        return points[np.argsort(points @ axes[0])]
    return np.concatenate([points, points[:1]])


def _ring(at: Float[np.ndarray, "2"]) -> Markup:
    return element("circle", class_="open", cx=float(at[0]), cy=float(at[1]), r=9.0)


def _arrow(start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], tone: str) -> Markup:
    """A shaft and a head that keeps its size; a short arrow is all head."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    across = np.array([-along[1], along[0]])
    head = min(HEAD_LENGTH, length)
    neck, half = end - head * along, HEAD_WIDTH * head / HEAD_LENGTH
    tip = np.array([neck + half * across, end, neck - half * across])
    return element(
        "g",
        element("path", class_="line", d=path(*np.array([start, neck]).T)),
        element("path", class_="head", d=path(*tip.T) + "Z"),
        class_=f"arrow {tone}",
    )


def _labels(loads: Sequence[JointLoad], sizes: np.ndarray, at: Float[np.ndarray, "n 2"]) -> Markup:
    """Names and sizes of the strongest joints, each at the first corner that is free; none where all are taken."""
    taken: list[tuple[float, float, float]] = []
    texts = []
    for i in np.argsort(-sizes)[:MOST_LABELS]:
        text = f"{loads[i].joint} {shown(float(sizes[i]))} N"
        width = LETTER * len(text)
        for right, down in CORNERS:
            left, y = float(at[i][0]) + right - (width if right < 0 else 0.0), float(at[i][1]) + down
            if all(left > x1 or left + width < x0 or abs(y - other) > LINE for x0, x1, other in taken):
                taken.append((left, left + width, y))
                texts.append(element("text", text, class_="label", x=left, y=y))
                break
    return joined(*texts)
