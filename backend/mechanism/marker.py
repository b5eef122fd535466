"""A point that a camera can follow."""

from __future__ import annotations

from backend.mechanism.part import Id, Part, Vector3


class Marker(Part):
    """A point drawn on a body; `position_m` is p_BM, in body axes [m]."""

    id: Id
    body: Id
    position_m: Vector3
