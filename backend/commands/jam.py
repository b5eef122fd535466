"""Whether it jams, and how likely."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import AsJson, Failed, Out, answering, counting, folder_for, progress, write_json

if TYPE_CHECKING:
    from backend.client import Linktwin
    from backend.service.answers import JobAnswer


def jam(
    file: Annotated[
        Path,
        typer.Argument(metavar="MECHANISM|STUDY", help="mechanism.json or study.json.", exists=True, dir_okay=False),
    ],
    duration_s: Annotated[
        float | None, typer.Option("--duration", metavar="S", min=0.0, help="How long [s]; 1, or the experiment's own.")
    ] = None,
    step_s: Annotated[float, typer.Option("--step", metavar="S", min=0.0, help="Time step [s].")] = 1e-3,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="How likely, in so many samples of what --vary scatters.")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:ON.PARAMETER=DISTRIBUTION",
            help="normal(MEAN,SD), uniform(LOW,HIGH) or lognormal(MEDIAN,FACTOR), in SI; repeatable.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the samples.")] = 0,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Say whether it jams, when, where, why and by what margin: jam.json and a page.  With --samples: how likely."""
    if server is not None:
        _jam_there(server, key, file, duration_s, step_s, samples, vary or [], seed, out, as_json)
        return
    if samples is not None or vary:
        _jam_ensemble(file, duration_s, step_s, samples, vary or [], seed, out, as_json)
        return
    with answering(as_json) as answer:
        from backend.mechanism.read import is_study, read_mechanism, read_study
        from backend.report.jam_page import write_jam_page
        from backend.report.jam_summary import jam_evidence, jam_text
        from backend.report.linked import jam_pictures
        from backend.report.pictures import write_pictures

        many = is_study(file)
        study = read_study(file) if many else None
        drawn = study.mechanism if study else read_mechanism(file)
        folder = folder_for(out, drawn.name)
        with progress("letting it go") as advance:
            from backend.jam.run import jam as jam_drawing
            from backend.jam.run import jam_study

            if study:
                found = jam_study(study, duration_s, step_s, progress=counting(advance))
            else:
                length = 1.0 if duration_s is None else duration_s
                found = {"": jam_drawing(drawn, length, step_s, progress=counting(advance))}
        reports, said = {}, []
        for experiment, one in found.items():
            place = folder / re.sub(r"[^\w.-]+", "_", experiment).lstrip(".") if experiment else folder
            reports[experiment] = one.report.model_dump(mode="json")
            write_json(reports[experiment], place / "jam.json")
            evidence = jam_evidence(one)
            page = write_jam_page(evidence, place / "jam.html")
            write_pictures(jam_pictures(evidence), place / "pictures.json")
            named = f"{experiment}: " if experiment else ""
            said.append(f"{named}{jam_text(one.report)}\nwrote       {place / 'jam.json'}\nopen        {page}")
        answer({"experiments": reports} if study else reports[""], "\n".join(said))


def _jam_there(
    server: str,
    key: str | None,
    file: Path,
    duration_s: float | None,
    step_s: float,
    samples: int | None,
    vary: list[str],
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    with answering(as_json) as answer:
        from backend.mechanism.jam_report import JamReport
        from backend.mechanism.read import is_study, parse
        from backend.report.jam_summary import jam_text

        many = is_study(file)

        def start(there: Linktwin, id: str) -> JobAnswer:
            subject = {"study" if many else "mechanism": id}
            return there.jam(**subject, duration_s=duration_s, step_s=step_s, samples=samples, vary=vary, seed=seed)

        def text(report: dict[str, Any]) -> str:
            if samples is not None:
                from backend.mechanism.ensemble_report import EnsembleReport
                from backend.report.ensemble_summary import ensemble_text

                return ensemble_text(parse(EnsembleReport, report, server))
            told = {f"{name}: ": one for name, one in report["experiments"].items()} if many else {"": report}
            return "\n".join(name + jam_text(parse(JamReport, one, server)) for name, one in told.items())

        done = done_there(server, key, file, out, start, study=many)
        done.tell(answer, text, "jam.html" if samples is None else "jam_ensemble.html")


def _jam_ensemble(
    file: Path,
    duration_s: float | None,
    step_s: float,
    samples: int | None,
    vary: list[str],
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    with answering(as_json) as answer:
        from backend.mechanism.read import is_study, read_mechanism
        from backend.report.ensemble_page import write_ensemble_page
        from backend.report.ensemble_summary import ensemble_text

        if is_study(file):
            raise ValueError(f"{file} is a study; samples are let go from the drawn pose: give its mechanism.json")
        if samples is None:
            raise ValueError("--vary needs to know how many samples to draw: add --samples, such as --samples 10000")
        drawn = read_mechanism(file)
        folder = folder_for(out, drawn.name)
        with progress("compiling, then letting samples go") as advance:
            from backend.jam.ensemble import ensemble

            length = 1.0 if duration_s is None else duration_s
            try:
                found = ensemble(drawn, vary, samples, length, step_s, seed=seed, progress=counting(advance))
            except RuntimeError as error:
                raise Failed(str(error)) from error
        report = found.report.model_dump(mode="json")
        write_json(report, folder / "jam_ensemble.json")
        table = found.write(folder / "jam_ensemble.csv")
        page = write_ensemble_page(found.report, folder / "jam_ensemble.html")
        written = f"wrote       {folder / 'jam_ensemble.json'}, {table}\nopen        {page}"
        answer(report, f"{ensemble_text(found.report)}\n{written}")
