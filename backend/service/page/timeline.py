"""Charts on the clock of the playback, and lists whose entries light up on the stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui.element import Element

from backend.service.page.markup import drawn, tag
from backend.service.page.stage import BROWSER


class Timeline(Element, component="timeline.js", esm={"linktwin-page": str(BROWSER)}):
    """What stands inside follows the stage: charts marked with `data-run`, entries marked with `data-part`."""


def charts(linked: Sequence[Mapping[str, Any]], group: str) -> None:
    """The charts of one group of a pictures.json, in a grid."""
    with tag("div", look="charts"):
        for chart in linked:
            if chart["group"] == group:
                box = drawn(chart["svg"], "linked")
                if chart["run"]:
                    box.props["data-run"] = chart["run"]
                    box.props["data-offset"] = chart["offset_s"]


def groups(linked: Sequence[Mapping[str, Any]]) -> list[str]:
    """The groups of a pictures.json, in order."""
    return list(dict.fromkeys(chart["group"] for chart in linked))
