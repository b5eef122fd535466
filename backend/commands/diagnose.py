"""Why the real one differs from the drawing."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import (
    MINUTES,
    AsJson,
    Failed,
    Limited,
    Out,
    StudyFile,
    answering,
    folder_for,
    progress,
    stoppable,
)

ENDED = "The search was ended early: an explanation that was not tried may fit better. --resume goes on from there."
LATE = (
    "The search was ended after {:g} minutes: an explanation that was not tried may fit better. "
    "Go on with --resume, as long again, or begin with more --minutes (0 sets no end)."
)


def diagnose(
    study: StudyFile,
    tolerance_mm: Annotated[
        float | None,
        typer.Option("--tolerance", metavar="MM", min=0.0, help="What may remain unexplained [mm; mrad for encoders]."),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="KIND", help="Leave this effect out of the library; repeatable.")
    ] = None,
    minutes: Annotated[
        float, typer.Option(metavar="M", min=0.0, help="End the search after so long, weigh what it found; 0: never.")
    ] = MINUTES,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the search that was cut off in --out.")] = False,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Say why the real one differs: is there a gap, where, which effect, how far does it shrink: gap.json and a page.

    Ctrl-C ends the search early, as its time does; the explanations found by then are weighed and written. That, or a
    search that was killed, goes on with --resume.
    """
    kinds = [kind.strip() for given in without or [] for kind in given.split(",") if kind.strip()]
    with answering(as_json) as answer:
        from backend.mechanism.effect import kind_named
        from backend.mechanism.gap_report import GapReport
        from backend.mechanism.read import parse, read_study
        from backend.mechanism.study_findings import study_findings
        from backend.report.gap_page import write_gap_page
        from backend.report.gap_summary import gap_evidence, gap_text
        from backend.report.linked import gap_pictures
        from backend.report.pictures import write_pictures

        for kind in kinds:
            kind_named(kind)
        if server is not None:
            done = done_there(
                server, key, study, out,
                lambda there, id: there.diagnose(id, tolerance_mm=tolerance_mm, without=kinds, minutes=minutes),
                resume=resume,
            )  # fmt: skip
            done.tell(answer, lambda report: gap_text(parse(GapReport, report, server)), "gap.html")
            return
        loaded = read_study(study)
        folder = folder_for(out, loaded.mechanism.name)
        with progress("reading the study") as advance, stoppable() as stopped:
            from backend.diagnose.kept import FILE, Kept
            from backend.diagnose.run import diagnose_study

            kept = Kept.of(folder / FILE, loaded, frozenset(kinds), resume=resume)
            tolerance_m = None if tolerance_mm is None else 1e-3 * tolerance_mm
            search = Limited(minutes, advance, stopped)
            found = diagnose_study(
                loaded, tolerance_m=tolerance_m, without=frozenset(kinds), progress=search.tell, cancelled=search,
                kept=kept,
            )  # fmt: skip
        ended = [ENDED] if stopped() else [LATE.format(minutes)] if search.late else []
        warnings = [*ended, *study_findings(loaded), *found.report.warnings]
        found = replace(found, report=found.report.model_copy(update={"warnings": warnings}))
        written = folder / "gap.json"
        written.write_text(found.report.model_dump_json(indent=1) + "\n", encoding="utf-8")
        evidence = gap_evidence(loaded, found)
        page = write_gap_page(evidence, folder / "gap.html")
        write_pictures(gap_pictures(evidence), folder / "pictures.json")
        text = f"{gap_text(found.report)}\nwrote     {written}\nopen      {page}"
        answer(found.report.model_dump(mode="json"), text)
        if stopped():
            raise Failed(ENDED)
        if not search.late:
            kept.remove()
