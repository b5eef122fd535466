"""The twin for other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from backend.commands.terminal import AsJson, MechanismFile, Out, answering, folder_for, progress


def twin(
    mechanism: MechanismFile,
    fit: Annotated[
        Path | None, typer.Option(help="fit.json: fitted values in place of drawn ones.", exists=True, dir_okay=False)
    ] = None,
    format: Annotated[
        Literal["mjcf", "urdf"], typer.Option(help="MJCF (MuJoCo), or URDF where it is a tree.")
    ] = "mjcf",
    step_s: Annotated[
        float | None, typer.Option("--step", metavar="S", help="MuJoCo's time step [s]; chosen if not given.")
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Hand the fitted twin to another simulator: one file, and a list of what it cannot hold."""
    with answering(as_json) as answer:
        from backend.mechanism.read import read_fit, read_mechanism

        drawn = read_mechanism(mechanism)
        report = read_fit(fit) if fit else None
        folder = folder_for(out, drawn.name)
        with progress("gathering"):
            from backend.export.write import write_twin

            path, written = write_twin(drawn, folder, report, format, step_s)
        lines = [f"wrote     {path}", *(f"not in it {sentence}" for sentence in written.left_out)]
        answer({"file": str(path), "format": format, "left_out": written.left_out}, "\n".join(lines))
