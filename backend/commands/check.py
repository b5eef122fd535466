"""What was drawn."""

from __future__ import annotations

import typer

from backend.commands.terminal import BAD_INPUT, AsJson, MechanismFile, Out, answering, write_json


def check(mechanism: MechanismFile, out: Out = None, as_json: AsJson = False) -> None:
    """Say what was drawn: loops, mobility, redundancy, and whether the loops close."""
    with answering(as_json) as answer:
        from backend.mechanism.check import check_json, check_text
        from backend.mechanism.graph import describe
        from backend.mechanism.read import read_mechanism

        report = describe(read_mechanism(mechanism))
        if out is not None:
            write_json(check_json(report), out / "check.json")
        answer(check_json(report), check_text(report))
    if not report.ok:
        raise typer.Exit(BAD_INPUT)
