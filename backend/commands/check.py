"""What was drawn, and what a study holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.commands.terminal import BAD_INPUT, AsJson, Out, answering, write_json

if TYPE_CHECKING:
    from backend.mechanism.graph import GraphReport
    from backend.mechanism.mechanism import Mechanism

Told = tuple[bool, dict[str, Any], str]  # whether all is well, for programs, for people


def check(
    file: Annotated[
        Path,
        typer.Argument(metavar="MECHANISM|STUDY", help="mechanism.json or study.json.", exists=True, dir_okay=False),
    ],
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Say what was drawn: loops, mobility, redundancy, whether the loops close, and what a simulation would refuse.

    Of a study also what each experiment holds, and what stands out in its tables.
    """
    with answering(as_json) as answer:
        from backend.mechanism.read import is_study

        ok, report, text = _of_study(file) if is_study(file) else _of_drawing(file)
        if out is not None:
            write_json(report, out / "check.json")
        answer(report, text)
    if not ok:
        raise typer.Exit(BAD_INPUT)


def checked(drawn: Mechanism) -> GraphReport:
    """The report of a drawing, with what a simulation would refuse of it among the errors."""
    from backend.mechanism.graph import describe

    report = describe(drawn)
    if not _may_be_refused(drawn):
        return report
    from backend.simulate.refusal import refusals

    return report.with_errors(refusals(drawn))


def _may_be_refused(drawn: Mechanism) -> bool:
    """Not where bodies hang on joints and that is all: then no solver is loaded."""
    return bool(drawn.effects) or not drawn.moving_bodies()


def _of_drawing(file: Path) -> Told:
    from backend.mechanism.check import check_json, check_text
    from backend.mechanism.read import read_mechanism

    report = checked(read_mechanism(file))
    if "study" in file.stem.lower():
        told = (
            f"{file.name} holds a drawing and no experiments, though its name says a study: nothing of its tables was "
            "checked; give the study.json that names it as its mechanism"
        )
        report = report.model_copy(update={"warnings": (*report.warnings, told)})
    return report.ok, check_json(report), check_text(report)


def _of_study(file: Path) -> Told:
    from backend.mechanism.graph import describe
    from backend.mechanism.read import read_study
    from backend.mechanism.study_report import describe_study, study_json, study_text

    study, refused, warned = read_study(file), [], []
    drawn = describe(study.mechanism)
    if _may_be_refused(study.mechanism):
        from backend.simulate.refusal import study_refusals

        refused = study_refusals(study)
    if drawn.ok and not refused:
        from backend.fit.unexplained import unexplained

        refused, warned = unexplained(study)
    report = describe_study(study, drawn, refused, warned)
    return report.ok, study_json(report), study_text(report)
