"""The kit to print."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, Out, answering, folder_for


class Paper(StrEnum):
    """What the printer is loaded with."""

    A4 = "a4"
    LETTER = "letter"


def kit(
    paper: Annotated[Paper, typer.Option(help="The printer's paper.")] = Paper.A4,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Write what filming needs, to print: ringed dots, bed tags, a lens board, and how to film."""
    with answering(as_json) as answer:
        from backend.report.kit_pages import write_kit

        path = write_kit(folder_for(out, "kit") / f"kit_{paper.value}.pdf", paper.value)
        how = f"at 100%, on {paper.value.capitalize()} paper; the ruler on each page measures 100 mm"
        answer({"paper": paper.value, "files": {"kit": str(path)}}, f"wrote     {path}\nprint     {how}")
