"""A mechanism in one pose, as it prints: bodies through their joints, the named joints and bodies marked."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from scipy.spatial import ConvexHull, QhullError

from backend.mechanism.mechanism import Mechanism
from backend.report.evidence import Motion
from backend.report.quantity import shown
from backend.report.skeleton import best_view, rotated, skeleton_of
from backend.report.svg import element, path

WIDTH, TALLEST, MARGIN = 1040, 520, 60
MOST_LABELS = 12


def pose_figure(mechanism: Mechanism, motion: Motion, node: int, at: tuple[str, ...], title: str) -> Markup:
    """The pose at a node, the first one faint behind it.

    mechanism: bending links already cut in two.  at: `joint:ID` and `body:ID` that are marked.
    """
    skeleton = skeleton_of(mechanism)
    placed = skeleton.placed(motion)
    view = best_view(placed)
    seen = {body: view.seen(p) for body, p in placed.items()}
    held = view.seen(skeleton.held)
    cloud = np.concatenate([*(p.reshape(-1, 2) for p in seen.values()), held, np.zeros((0, 2))])
    low, high = cloud.min(0), cloud.max(0)
    size = np.maximum(high - low, 1e-6)
    scale = min((WIDTH - 2 * MARGIN) / size[0], (TALLEST - 2 * MARGIN) / size[1])
    height = float(np.clip(size[1] * scale + 2 * MARGIN, 180, TALLEST))

    def px(p: Float[np.ndarray, "*n 2"]) -> np.ndarray:
        middle = 0.5 * (low + high)
        return np.array([WIDTH / 2, height / 2]) + (p - middle) * scale * np.array([1.0, -1.0])

    places = {place.split(":", 1)[1]: place.split(":", 1)[0] for place in at}
    drawn = [body_path(px(p[0]), "start") for p in seen.values()]
    for body, p in seen.items():
        drawn.append(body_path(px(p[node]), "body named" if places.get(body) == "body" else "body"))
    drawn += [element("circle", cx=x, cy=y, r=3.5) for p in (*(q[node] for q in seen.values()), held) for x, y in px(p)]
    labels = 0
    for joint in mechanism.joints:
        if places.get(joint.id) != "joint":
            continue
        x, y = px(view.seen(point_at(mechanism, motion, joint.body_b, np.array(joint.frame_b.position_m), node)))
        drawn.append(element("circle", cx=x, cy=y, r=13, class_="cause"))
        if labels < MOST_LABELS:
            drawn.append(element("text", joint.id, x=x + 17, y=y - 11, class_="cause"))
        labels += 1
    svg = element("svg", *drawn, viewBox=f"0 0 {WIDTH} {height:.0f}", role="img", aria_label=title)
    note = (
        f"Seen in the {view.name} at {shown(float(motion.time_s[node]), 4)} s; faint: the start. Orange: where it jams."
    )
    return element(
        "figure", element("figcaption", element("b", title)), svg, element("p", note, class_="note"), class_="pose wide"
    )


def body_path(points: Float[np.ndarray, "n 2"], look: str, **attributes: str) -> Markup:
    """A bar as a line, a plate as its outline; points [px]."""
    closed = ""
    if len(points) > 2:
        try:
            points = points[ConvexHull(points).vertices]
            closed, look = "Z", look if look == "start" else f"{look} plate"
        except QhullError:  # joints in one line
            along = points @ (points.max(0) - points.min(0))
            points = points[[along.argmin(), along.argmax()]]
    return element("path", class_=look, d=path(*points.T) + closed, **attributes)


def point_at(mechanism: Mechanism, motion: Motion, body: str, p_B: np.ndarray, node: int) -> np.ndarray:
    """A point of a body in W [m]."""
    if body in motion.position_m:
        q, x = motion.quaternion_wxyz[body][node], motion.position_m[body][node]
    else:
        drawn = next(b for b in mechanism.bodies if b.id == body).pose
        q, x = np.array(drawn.quaternion_wxyz), np.array(drawn.position_m)
    return x + rotated(np.asarray(q)[None], p_B[None])[0, 0]
