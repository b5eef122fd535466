"""Whether it jams, and how likely."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import AsJson, Failed, Out, answering, counting, folder_for, progress, write_json

Answer = Callable[[Mapping[str, Any], str], None]


@dataclass(frozen=True)
class Asked:
    """What is asked of a mechanism, wherever it is done; the names are those of a service's request."""

    duration_s: float | None
    step_s: float
    samples: int | None
    vary: tuple[str, ...]
    seed: int

    @property
    def from_pose_s(self) -> float:
        """How long from the drawn pose, where no experiment says it."""
        return 1.0 if self.duration_s is None else self.duration_s


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
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the samples that were cut off in --out.")
    ] = False,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Say whether it jams, when, where, why and by what margin: jam.json and a page.  With --samples: how likely."""
    asked = Asked(duration_s, step_s, samples, tuple(vary or ()), seed)
    with answering(as_json) as answer:
        if server is not None:
            _there(asked, file, out, answer, server, key, resume)
        elif samples is not None or vary:
            _ensemble(asked, file, out, answer, resume)
        else:
            if resume:
                raise ValueError("--resume goes on with samples; one motion begins anew: leave it out")
            _once(asked, file, out, answer)


def _once(asked: Asked, file: Path, out: Path | None, answer: Answer) -> None:
    """One drawing from its pose, or every experiment of a study from its own start."""
    from backend.mechanism.jam_report import run_folder
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
            found = jam_study(study, asked.duration_s, asked.step_s, progress=counting(advance))
        else:
            found = {"": jam_drawing(drawn, asked.from_pose_s, asked.step_s, progress=counting(advance))}
    reports, said = {}, []
    for experiment, one in found.items():
        place = folder / run_folder(experiment) if experiment else folder
        reports[experiment] = one.report.model_dump(mode="json")
        write_json(reports[experiment], place / "jam.json")
        evidence = jam_evidence(one)
        page = write_jam_page(evidence, place / "jam.html")
        write_pictures(jam_pictures(evidence), place / "pictures.json")
        named = f"{experiment}: " if experiment else ""
        said.append(f"{named}{jam_text(one.report)}\nwrote       {place / 'jam.json'}\nopen        {page}")
    if study:
        write_json({"experiments": reports}, folder / "jam.json")
    answer({"experiments": reports} if study else reports[""], "\n".join(said))


def _ensemble(asked: Asked, file: Path, out: Path | None, answer: Answer, resume: bool) -> None:
    """Many samples of one drawing."""
    from backend.mechanism.read import is_study, read_mechanism
    from backend.report.ensemble_page import write_ensemble_page
    from backend.report.ensemble_summary import ensemble_text

    if is_study(file):
        raise ValueError(f"{file} is a study; samples are let go from the drawn pose: give its mechanism.json")
    if asked.samples is None:
        raise ValueError("--vary needs to know how many samples to draw: add --samples, such as --samples 10000")
    drawn = read_mechanism(file)
    folder = folder_for(out, drawn.name)
    with progress("compiling, then letting samples go") as advance:
        from backend.jam.ensemble import ensemble
        from backend.jam.kept import FILE

        try:
            found = ensemble(
                drawn, asked.vary, asked.samples, asked.from_pose_s, asked.step_s, seed=asked.seed,
                checkpoint=folder / FILE, resume=resume, progress=counting(advance),
            )  # fmt: skip
        except RuntimeError as error:
            raise Failed(str(error)) from error
    report = found.report.model_dump(mode="json")
    write_json(report, folder / "jam_ensemble.json")
    table = found.write(folder / "jam_ensemble.csv")
    page = write_ensemble_page(found.report, folder / "jam_ensemble.html")
    (folder / FILE).unlink(missing_ok=True)  # not before: who is killed while it writes resumes, too
    written = f"wrote       {folder / 'jam_ensemble.json'}, {table}\nopen        {page}"
    answer(report, f"{ensemble_text(found.report)}\n{written}")


def _there(
    asked: Asked, file: Path, out: Path | None, answer: Answer, server: str, key: str | None, resume: bool
) -> None:
    """Either of the two, done by a service."""
    from backend.mechanism.ensemble_report import EnsembleReport
    from backend.mechanism.jam_report import JamReport
    from backend.mechanism.read import is_study, parse
    from backend.report.ensemble_summary import ensemble_text
    from backend.report.jam_summary import jam_text

    many = is_study(file)

    def text(report: dict[str, Any]) -> str:
        if asked.samples is not None:
            return ensemble_text(parse(EnsembleReport, report, server))
        told = {f"{name}: ": one for name, one in report["experiments"].items()} if many else {"": report}
        return "\n".join(name + jam_text(parse(JamReport, one, server)) for name, one in told.items())

    done = done_there(
        server, key, file, out,
        lambda there, id: there.jam(**{"study" if many else "mechanism": id}, **asdict(asked)), study=many,
        resume=resume,
    )  # fmt: skip
    done.tell(answer, text, "jam.html" if asked.samples is None else "jam_ensemble.html")
