"""Pointing at marks, a known length and dots in the first frame of a clip."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nicegui.element import Element


class Pointing(Element, component="pointing.js"):
    """A picture and the points to be placed in it.

    marks: id, x_mm, y_mm on the bed and x_px, y_px (None until placed). tags: id, number, x_mm, y_mm. stick, dots: id,
    x_px, y_px. told: called with the lists, the stick's length_mm and each dot's tag whenever one of them changes.
    """

    def __init__(
        self,
        picture: str,
        points: Mapping[str, Any],
        told: Callable[[dict[str, Any]], None],
    ) -> None:
        super().__init__()
        self._props["picture"] = picture
        self._props["points"] = dict(points)
        self.on("points", lambda event: told(event.args))

    def tag_dots(self, on: bool) -> None:
        """Whether the dots are printed tags, each with its number."""
        self._props["tagged"] = on
        self.update()

    def show(self, picture: str) -> None:
        """Another picture under the same points."""
        self._props["picture"] = picture
        self.update()
