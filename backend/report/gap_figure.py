"""Where the gap lies, as a picture: the mechanism at its release, every part as orange as it is suspect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from backend.mechanism.gap_names import place_name
from backend.mechanism.mechanism import Mechanism
from backend.model.flexible import split
from backend.report.evidence import Motion
from backend.report.gap_words import percent
from backend.report.pose_figure import body_path, point_at
from backend.report.skeleton import best_view, skeleton_of
from backend.report.svg import element

WIDTH, SHORTEST, TALLEST, MARGIN = 520, 200, 440, 44
TELLING = 0.05  # probability from which a place is named in the picture
MOST_LABELS = 5
LETTER, LINE = 7.4, 16.0  # px


def gap_figure(mechanism: Mechanism, pose: Motion, probability: Mapping[str, float]) -> Markup:
    """Bodies, joints and markers at one instant. probability: place (`joint:ID`, ...) -> that the gap lies there."""
    drawn = split(mechanism)
    skeleton = skeleton_of(drawn)
    placed = skeleton.placed(pose)
    view = best_view(placed)
    seen = {body: view.seen(p[0]) for body, p in placed.items()}
    joints = {j.id: view.seen(point_at(drawn, pose, j.body_b, np.array(j.frame_b.position_m), 0)) for j in drawn.joints}
    markers = {m.id: view.seen(point_at(drawn, pose, m.body, np.array(m.position_m), 0)) for m in drawn.markers}
    cloud = np.concatenate(
        [*seen.values(), view.seen(skeleton.held), *(p[None] for p in (*joints.values(), *markers.values()))]
    )
    low, size = cloud.min(0), np.maximum(np.ptp(cloud, axis=0), 1e-6)
    scale = min((WIDTH - 2 * MARGIN) / size[0], (TALLEST - 2 * MARGIN) / size[1])
    height = float(np.clip(size[1] * scale + 2 * MARGIN, SHORTEST, TALLEST))

    def px(p: Float[np.ndarray, "*n 2"]) -> np.ndarray:
        return np.array([WIDTH / 2, height / 2]) + (p - low - 0.5 * size) * scale * np.array([1.0, -1.0])

    def suspect(place: str) -> float | None:
        p = probability.get(place, 0.0)
        return p if p >= 0.01 else None

    parts: list[Markup] = []
    for body, p in seen.items():
        parts.append(body_path(px(p), "body"))
        if strength := suspect(f"body:{body}"):
            parts.append(body_path(px(p), "body suspect", style=f"stroke-opacity:{strength:.2f}"))
    for id, p in joints.items():
        parts += _spot(px(p), "joint", suspect(f"joint:{id}"))
    for id, p in markers.items():
        parts += _spot(px(p), "marker", suspect(f"marker:{id}"))
    at = {f"body:{b}": p.mean(0) for b, p in seen.items()}
    at |= {f"joint:{j}": p for j, p in joints.items()} | {f"marker:{m}": p for m, p in markers.items()}
    named = [place for place in probability if place in at and probability[place] >= TELLING][:MOST_LABELS]
    parts += _labels([(px(at[place]), f"{place_name(place)}: {percent(probability[place])}") for place in named])
    outside = [p for p in ("camera", "world") if probability.get(p, 0.0) >= TELLING]
    for k, place in enumerate(outside):
        words = f"outside the mechanism, {place_name(place)}: {percent(probability[place])}"
        parts.append(element("text", words, x=6, y=height - 8 - LINE * (len(outside) - 1 - k), class_="cause"))
    title = "Where in the mechanism" if probability else "As it was let go"
    svg = element("svg", *parts, viewBox=f"0 0 {WIDTH} {height:.0f}", role="img", aria_label=title)
    legend = element("span", *_legend(bool(markers), bool(probability)), class_="legend")
    when = f"At the release of the first fitted experiment, seen in the {view.name}."
    note = f"{when} The stronger the orange, the more probable." if probability else when
    caption = element("figcaption", element("b", title), legend)
    return element("figure", caption, svg, element("p", note, class_="note"), class_="pose gap")


def _spot(at: np.ndarray, look: str, strength: float | None) -> Iterator[Markup]:
    """A joint as a circle, a marker as a square; a suspect one in orange, with a ring that is seen from afar."""
    x, y = (float(v) for v in at)
    full = None if strength is None else f"{strength:.2f}"
    if look == "joint":
        yield element("circle", cx=x, cy=y, r=4.5)
        if full:
            yield element("circle", cx=x, cy=y, r=4.5, class_="suspect", style=f"fill-opacity:{full}")
    else:
        yield element("rect", x=x - 3.5, y=y - 3.5, width=7, height=7, class_="marker")
        if full:
            yield element(
                "rect", x=x - 3.5, y=y - 3.5, width=7, height=7, class_="suspect", style=f"fill-opacity:{full}"
            )
    if full:
        yield element("circle", cx=x, cy=y, r=11, class_="ring", style=f"stroke-opacity:{full}")


def _labels(told: list[tuple[np.ndarray, str]]) -> Iterator[Markup]:
    """Beside their places, on the side where there is room; one below the other where they would overlap."""
    taken: list[tuple[float, float, float]] = []
    for (x, y), text in sorted(told, key=lambda label: label[0][1]):
        left, width = x > 0.6 * WIDTH, LETTER * len(text)
        start = float(x - 14 - width if left else x + 14)
        line = float(y - 9)
        for begin, end, other in taken:
            if start < end and begin < start + width and line < other + LINE:
                line = other + LINE
        taken.append((start, start + width, line))
        yield element(
            "text",
            text,
            x=start + (width if left else 0),
            y=line,
            text_anchor="end" if left else "start",
            class_="cause",
        )


def _legend(markers: bool, suspects: bool) -> Iterator[Markup]:
    yield element("span", "joint", class_="key spot joint")
    if markers:
        yield element("span", "marker", class_="key spot marker")
    if suspects:
        yield element("span", "where the gap may lie", class_="key spot suspect")
