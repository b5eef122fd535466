"""From a CadQuery assembly to a mechanism.json: declare what moves on what, and write it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cad_export.axis import Axis, cylinder
    from cad_export.drawing import Drawing
    from cad_export.flat_bar import bar
    from cad_export.script import draw, export_script
    from cad_export.starter import begin, propose

__all__ = ["Axis", "Drawing", "bar", "begin", "cylinder", "draw", "export_script", "propose"]

_HOMES = {
    "Axis": "axis",
    "cylinder": "axis",
    "bar": "flat_bar",
    "Drawing": "drawing",
    "draw": "script",
    "export_script": "script",
    "begin": "starter",
    "propose": "starter",
}


def __getattr__(name: str) -> Any:
    # On first use: CadQuery takes seconds to import, and --help must not.
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
