"""From a CadQuery script or a STEP file to a drawing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from backend.commands.check import checked
from backend.commands.remote import Key, asking
from backend.commands.terminal import BAD_INPUT, AsJson, Out, answering, progress


def export(
    script: Annotated[
        Path, typer.Argument(help="CadQuery script, or a STEP file to begin one with.", exists=True, dir_okay=False)
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Set a value of the script; repeatable."),
    ] = None,
    proposing: Annotated[
        bool, typer.Option("--propose", help="Write no mechanism, but what joints its pins and holes suggest.")
    ] = False,
    upload: Annotated[
        str | None, typer.Option(metavar="URL", help="Hand it to a linktwin service too, and say where it is shown.")
    ] = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Run a CadQuery script and write its mechanism.json and meshes; of a STEP file, a script and a picture.

    A drawing with errors is written too, and the command ends with 2.
    """
    chosen = _settings(settings or [])
    if proposing and upload is not None:
        raise typer.BadParameter(
            "what is proposed is no mechanism yet; give --upload without it", param_hint="--propose"
        )
    if script.suffix.lower() in (".step", ".stp"):
        _begin(script, out or Path("out") / script.stem, bool(chosen) or upload is not None, as_json)
        return
    with answering(as_json) as answer:
        from backend.mechanism.check import check_json, check_text
        from backend.mechanism.read import read_mechanism
        from cad_export import export_script

        folder = out or Path("out") / script.resolve().parent.name
        if proposing:
            from cad_export import draw, propose

            begun = propose(draw(script, chosen), folder)
            answer(begun.json(), begun.text())
            return
        path = Path(export_script(script, folder, chosen))
        report = checked(read_mechanism(path))
        told, text = {"mechanism": str(path), **check_json(report)}, f"{check_text(report)}\nwrote     {path}"
        if upload is not None:
            with asking(upload, key) as there, progress("sending") as advance:
                told["page"] = there.page(there.store_mechanism(path, sent=lambda part: advance(part)))
            text += f"\nopen      {told['page']}"
        answer(told, text)
        if not report.ok:
            raise typer.Exit(BAD_INPUT)


def _begin(step: Path, folder: Path, more: bool, as_json: bool) -> None:
    """A script to correct, and a picture of the joints in it."""
    if more:
        raise typer.BadParameter(
            "a STEP file becomes a script first; give --set and --upload with that", param_hint="--set"
        )
    with answering(as_json) as answer:
        from cad_export import begin

        begun = begin(step, folder)
        answer(begun.json(), begun.text())


def _settings(pairs: list[str]) -> dict[str, str]:
    """`cells=23` -> {"cells": "23"}; the script's own declarations say what type each has."""
    chosen: dict[str, str] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (equals and name.isidentifier()):
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE, such as cells=23", param_hint="--set")
        chosen[name] = text
    return chosen
