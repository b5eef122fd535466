"""Values that the drawing leaves open."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import AsJson, Failed, Out, StudyFile, answering, folder_for, progress, stoppable


def fit(
    study: StudyFile,
    free: Annotated[
        list[str],
        typer.Option(metavar="KIND:ON[.PARAMETER]", help="What to fit; repeatable or comma separated; * is every one."),
    ],
    optimiser: Annotated[
        Literal["lm", "lbfgsb"], typer.Option(help="Levenberg-Marquardt, or L-BFGS-B to compare.")
    ] = "lm",
    loss: Annotated[
        Literal["linear", "soft_l1", "huber", "student"], typer.Option(help="All but linear shrug off outliers.")
    ] = "linear",
    noise: Annotated[
        Literal["white", "ar1"], typer.Option(help="ar1 where neighbouring samples share their error.")
    ] = "white",
    starts: Annotated[
        int, typer.Option(metavar="N", min=0, help="Further searches from scattered values; the likeliest end wins.")
    ] = 0,
    step_s: Annotated[
        float | None, typer.Option("--step", metavar="S", help="Time step [s]; chosen if not given.")
    ] = None,
    sparse: Annotated[
        bool, typer.Option("--sparse", help="One value for all of KIND:*, but for the places found to deviate.")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the fit that was cut off in --out.")] = False,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Fit what the drawing leaves open to what was measured: fit.json and a page.

    Ctrl-C ends the search and writes what it reached. That, or a fit that was killed, goes on with --resume.
    """
    specs = [spec.strip() for given in free for spec in given.split(",") if spec.strip()]
    with answering(as_json) as answer:
        if server is not None:
            from backend.mechanism.fit_report import FitReport
            from backend.mechanism.read import parse
            from backend.report.fit_summary import fit_text

            done = done_there(
                server, key, study, out,
                lambda there, id: there.fit(
                    id, free=specs, optimiser=optimiser, loss=loss, noise=noise, starts=starts, sparse=sparse,
                    step_s=step_s,
                ),
                resume=resume,
            )  # fmt: skip
            done.tell(answer, lambda report: fit_text(parse(FitReport, report, server)), "fit.html")
            return
        from backend.mechanism.read import read_study
        from backend.report.fit_page import write_fit_page
        from backend.report.fit_summary import fit_evidence, fit_text
        from backend.report.linked import fit_pictures
        from backend.report.pictures import write_pictures

        loaded = read_study(study)
        folder = folder_for(out, loaded.mechanism.name)
        with progress("reading the study") as advance, stoppable() as stopped:
            from backend.fit.checkpoint import FILE
            from backend.fit.fit_study import fit_study

            kept = folder / FILE
            result = fit_study(
                loaded, specs, optimiser=optimiser, loss=loss, noise=noise, starts=starts, sparse=sparse, step_s=step_s,
                checkpoint=kept, resume=resume, progress=advance, cancelled=stopped,
            )  # fmt: skip
        written = result.write(folder)
        evidence = fit_evidence(loaded, result)
        page = write_fit_page(evidence, folder / "fit.html")
        write_pictures(fit_pictures(evidence), folder / "pictures.json")
        text = f"{fit_text(result.report)}\nwrote     {written}\nopen      {page}"
        answer(result.report.model_dump(mode="json"), text)
        if not result.report.converged:
            more = " --resume goes on from there." if kept.exists() else ""
            raise Failed(f"the fit did not converge: {result.report.message}{more}")
