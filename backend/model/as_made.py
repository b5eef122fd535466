"""A mechanism as it was made: the drawing, its springs and its markers after every error of what was drawn."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Array, Float

from backend.effects.gravity import Gravity
from backend.effects.shapes import AbstractDrawnError, AbstractMarkerError, AbstractSpringError
from backend.frames import quaternion
from backend.model.drawing import Drawing
from backend.model.incidence import with_row
from backend.model.model import Model
from backend.model.placed import Placed
from backend.model.topology import Topology


def amended(model: Model) -> Model:
    """The model in which every spring is as it really is, and no error of one is left."""
    effects = list(model.effects)
    for placed in model.of(AbstractSpringError):
        for error, (batch, row) in zip(placed.each(), placed.places, strict=True):
            real = error.amend(jax.tree.map(lambda leaf, r=row: leaf[r], effects[batch].effect))
            leaves = jax.tree.map(lambda all_, one, r=row: with_row(all_, r, one), effects[batch].effect, real)
            effects[batch] = dataclasses.replace(effects[batch], effect=leaves)
    kept = tuple(p for p in effects if not isinstance(p.effect, AbstractSpringError))
    return dataclasses.replace(model, effects=kept)


def marker_points(model: Model) -> Float[Array, "markers 3"]:
    """Where markers really sit, in the axes of their bodies."""
    points, R_WB = model.marker_points, quaternion.rotation(model.drawn_poses[:, 3:])
    axis_B = model.view_axis @ R_WB[np.array(model.marker_bodies, dtype=int)]
    for placed in model.of(AbstractMarkerError):
        points = placed.in_turn(points, lambda p, e, m: with_row(p, m, e.moved(p[m], axis_B[m])))
    return points


def redraw(model: Model) -> Drawing:
    """The drawing after every error of what was drawn."""
    drawing = model.drawing
    for placed in model.of(AbstractDrawnError):
        drawing = placed.in_turn(drawing, lambda now, error, place: error.redraw(now, place))
    return drawing


def weight(drawing: Drawing, topology: Topology) -> list[Placed]:
    """Gravity on every real body."""
    real = [i for i, body in enumerate(topology.body_ids) if body is not None]
    effect = Gravity(gravity_m_per_s2=drawing.gravity[None])
    places = tuple((i, topology.slots) for i in real)
    return [Placed(effect, ("gravity",), (0,) * len(real), places)]
