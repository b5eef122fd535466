"""A mesh of any kind as STL."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, answering

MOST_MEMORY_BYTES = 4 * 2**30  # a few kilobytes may claim more than any machine has


def surface(
    mesh: Annotated[Path, typer.Argument(help="An STL, OBJ, PLY or GLB.", exists=True, dir_okay=False)],
    out: Annotated[Path, typer.Option(help="The STL to write.", dir_okay=False)] = Path("surface.stl"),
    as_json: AsJson = False,
) -> None:
    """Write a mesh as binary STL, its numbers as they are: the kind of file that the page draws."""
    with answering(as_json) as answer:
        from backend.mechanism.surface import facets, write_stl

        with suppress(ImportError):  # there is none on Windows
            import resource

            resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
        corners = facets(mesh)
        write_stl(out, corners)
        low, high = corners.min((0, 1)).tolist(), corners.max((0, 1)).tolist()
        size = " x ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
        report = {"facets": len(corners), "low": low, "high": high, "surface": str(out)}
        answer(report, f"{len(corners)} facets, {size}\nwrote     {out}")
