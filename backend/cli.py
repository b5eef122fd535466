"""The command line: each command parses its arguments, calls one function and says what came of it.

Rooms are imported inside the commands: `--help` and reading a drawing stay free of jax, cadquery and OpenCV.
"""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import typer

DONE, FAILED, BAD_INPUT = 0, 1, 2


class Advance(Protocol):
    """Tell how far the work is: a part of the whole, from 0 to 1, and a few words on what is being done."""

    def __call__(self, part: float, words: str = "") -> None: ...  # noqa: D102


app = typer.Typer(
    name="linktwin",
    help="Draw a linkage, film it, and learn why the real one differs.",
    epilog="Exit codes: 0 done, 1 the work failed, 2 bad arguments or bad input.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Out = Annotated[Path | None, typer.Option(help="Folder for what the command writes.", file_okay=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print the report alone, as JSON.")]
MechanismFile = Annotated[Path, typer.Argument(help="mechanism.json: what was drawn.", exists=True, dir_okay=False)]


class Failed(Exception):
    """The input was sound and the work did not succeed; the message says why and what to do."""


def main() -> None:
    """Entry point of `linktwin`: float64 and a shelf for compiled programs, then the command."""
    # Read when jax starts: nothing is imported here.  A program compiled once serves every later command on a
    # mechanism of the same layout.
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    # Threads of small decompositions wait for each other longer than they work: 250 times longer on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    shelf = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "linktwin" / "programs"
    with suppress(OSError):  # a home that cannot be written costs compile time, nothing else
        shelf.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(shelf))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")
    app()


@app.command()
def demo(out: Out = None, as_json: AsJson = False) -> None:
    """Draw, film, track and fit a four-bar, then predict a load it never saw: one page tells it all."""
    with _answering(as_json) as answer:
        from backend.report.fit_summary import fit_text

        script = Path(__file__).resolve().parents[1] / "samples" / "fourbar" / "design.py"
        with _progress("loading") as advance:
            from backend.demo.story import run_demo

            page, result = run_demo(script, out or Path("out") / "demo", advance)
        answer(
            {"page": str(page), "fit": result.report.model_dump(mode="json")},
            f"{fit_text(result.report)}\nopen      {page}",
        )


@app.command()
def export(
    script: Annotated[Path, typer.Argument(help="CadQuery script.", exists=True, dir_okay=False)],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Set a value of the script; repeatable."),
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Run a CadQuery script and write its mechanism.json and meshes."""
    chosen = _settings(settings or [])
    with _answering(as_json) as answer:
        from backend.mechanism.check import check_json, check_text
        from backend.mechanism.graph import describe
        from backend.mechanism.read import read_mechanism
        from cad_export import export_script

        folder = out or Path("out") / script.resolve().parent.name
        path = Path(export_script(script, folder, chosen))
        report = describe(read_mechanism(path))
        answer({"mechanism": str(path), **check_json(report)}, f"{check_text(report)}\nwrote     {path}")


@app.command()
def check(mechanism: MechanismFile, out: Out = None, as_json: AsJson = False) -> None:
    """Say what was drawn: loops, mobility, redundancy, and whether the loops close."""
    with _answering(as_json) as answer:
        from backend.mechanism.check import check_json, check_text
        from backend.mechanism.graph import describe
        from backend.mechanism.read import read_mechanism

        report = describe(read_mechanism(mechanism))
        if out is not None:
            _write_json(check_json(report), out / "check.json")
        answer(check_json(report), check_text(report))
    if not report.ok:
        raise typer.Exit(BAD_INPUT)


@app.command()
def simulate(
    mechanism: MechanismFile,
    duration_s: Annotated[float, typer.Option("--duration", metavar="S", min=0.0, help="How long [s].")] = 1.0,
    step_s: Annotated[float, typer.Option("--step", metavar="S", min=0.0, help="Time step [s].")] = 1e-3,
    solve: Annotated[
        Literal["compliance", "reduced"],
        typer.Option(help="All held rows give way alike, or redundant rows are let go."),
    ] = "compliance",
    threshold: Annotated[
        float | None, typer.Option(metavar="REL", help="Singular value, over the largest, below which a row repeats.")
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Let the drawing go from rest: run.h5 and a page of its motion, forces.csv and a page of its joint forces."""
    with _answering(as_json) as answer:
        from backend.mechanism.read import read_mechanism
        from backend.report.forces_page import peak_table, write_forces_page
        from backend.report.run_summary import simulation_evidence, summary_json, summary_text
        from backend.report.simulation_page import write_simulation_page

        drawn = read_mechanism(mechanism)
        folder = _folder(out, drawn.name)
        with _progress("simulating") as advance:
            from backend.simulate.joint_forces import joint_forces, strongest
            from backend.simulate.run import simulate as run_drawing
            from backend.simulate.write import write_run
            from backend.simulate.write_forces import write_forces

            run = run_drawing(drawn, duration_s, step_s, progress=_counting(advance), solve=solve, threshold=threshold)
        motion = write_run(run, folder / "run.h5")
        loads = joint_forces(drawn, run)
        forces, ranked = write_forces(run, loads, folder / "forces.csv"), strongest(loads)
        evidence = simulation_evidence(drawn, run, forces_page="forces.html")
        page = write_simulation_page(evidence, folder / "simulation.html")
        told = write_forces_page(
            evidence.mechanism, evidence.motion, ranked, folder / "forces.html",
            table=forces.name, result=run.result, solve=run.solve,
        )  # fmt: skip
        files = {"motion": str(motion), "page": str(page), "forces": str(forces), "forces_page": str(told)}
        peaks = peak_table(run.time_s, ranked)
        answer(
            {**summary_json(run), "joint_forces": peaks, "files": files},
            f"{summary_text(run)}\nwrote       {motion}, {forces}\nopen        {page}, {told}",
        )
        if not run.done:
            raise Failed(run.result)


@app.command()
def track(
    video: Annotated[Path, typer.Argument(help="The clip.", exists=True, dir_okay=False)],
    mechanism: Annotated[Path, typer.Option(help="mechanism.json: names the markers.", exists=True, dir_okay=False)],
    bed: Annotated[
        Path, typer.Option(help="JSON: marks on the bed, in metres and pixels.", exists=True, dir_okay=False)
    ],
    clicks: Annotated[
        Path | None, typer.Option(help="JSON: marker to pixel in the first frame.", exists=True, dir_okay=False)
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Measure where the markers went in a clip: tracks.csv and an annotated preview."""
    with _answering(as_json) as answer:
        from backend.mechanism.read import read_mechanism
        from backend.report.track_summary import track_text

        drawn = read_mechanism(mechanism)
        with _progress("opening the clip") as advance:
            from backend.observe.measure import track_video

            folder = out or Path("out") / video.stem
            result = track_video(video, drawn, bed, out_dir=folder, clicks=clicks, progress=_counting(advance))
        files = {"tracks": str(result.tracks_path), "preview": str(result.preview_path)}
        written = f"wrote     {result.tracks_path}\nopen      {result.preview_path}"
        answer({**result.summary, "files": files}, f"{track_text(result.summary)}\n{written}")


@app.command()
def fit(
    study: Annotated[
        Path, typer.Argument(help="study.json: a mechanism and its experiments.", exists=True, dir_okay=False)
    ],
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
    sparse: Annotated[
        bool, typer.Option("--sparse", help="One value for all of KIND:*, but for the places found to deviate.")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the fit that was cut off in --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Fit what the drawing leaves open to what was measured: fit.json and a page.

    Ctrl-C ends the search and writes what it reached. That, or a fit that was killed, goes on with --resume.
    """
    specs = [spec.strip() for given in free for spec in given.split(",") if spec.strip()]
    with _answering(as_json) as answer:
        from backend.mechanism.read import read_study
        from backend.report.fit_page import write_fit_page
        from backend.report.fit_summary import fit_evidence, fit_text

        loaded = read_study(study)
        folder = _folder(out, loaded.mechanism.name)
        with _progress("reading the study") as advance, _stoppable() as stopped:
            from backend.fit.checkpoint import FILE
            from backend.fit.fit_study import fit_study

            kept = folder / FILE
            result = fit_study(
                loaded, specs, optimiser=optimiser, loss=loss, noise=noise, starts=starts, sparse=sparse,
                checkpoint=kept, resume=resume, progress=advance, cancelled=stopped,
            )  # fmt: skip
        written = result.write(folder)
        page = write_fit_page(fit_evidence(loaded, result), folder / "fit.html")
        text = f"{fit_text(result.report)}\nwrote     {written}\nopen      {page}"
        answer(result.report.model_dump(mode="json"), text)
        if not result.report.converged:
            more = " --resume goes on from there." if kept.exists() else ""
            raise Failed(f"the fit did not converge: {result.report.message}{more}")


@app.command()
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
    with _answering(as_json) as answer:
        from backend.mechanism.read import read_fit, read_mechanism

        drawn = read_mechanism(mechanism)
        report = read_fit(fit) if fit else None
        folder = _folder(out, drawn.name)
        with _progress("gathering"):
            from backend.export.write import write_twin

            path, written = write_twin(drawn, folder, report, format, step_s)
        lines = [f"wrote     {path}", *(f"not in it {sentence}" for sentence in written.left_out)]
        answer({"file": str(path), "format": format, "left_out": written.left_out}, "\n".join(lines))


@app.command()
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
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Say whether it jams, when, where, why and by what margin: jam.json and a page.  With --samples: how likely."""
    if samples is not None or vary:
        _jam_ensemble(file, duration_s, step_s, samples, vary or [], seed, out, as_json)
        return
    with _answering(as_json) as answer:
        from backend.mechanism.read import is_study, read_mechanism, read_study
        from backend.report.jam_page import write_jam_page
        from backend.report.jam_summary import jam_evidence, jam_text

        many = is_study(file)
        study = read_study(file) if many else None
        drawn = study.mechanism if study else read_mechanism(file)
        folder = _folder(out, drawn.name)
        with _progress("letting it go") as advance:
            from backend.jam.run import jam as jam_drawing
            from backend.jam.run import jam_study

            if study:
                found = jam_study(study, duration_s, step_s, progress=_counting(advance))
            else:
                length = 1.0 if duration_s is None else duration_s
                found = {"": jam_drawing(drawn, length, step_s, progress=_counting(advance))}
        reports, said = {}, []
        for experiment, one in found.items():
            place = folder / re.sub(r"[^\w.-]+", "_", experiment).lstrip(".") if experiment else folder
            reports[experiment] = one.report.model_dump(mode="json")
            _write_json(reports[experiment], place / "jam.json")
            page = write_jam_page(jam_evidence(one), place / "jam.html")
            named = f"{experiment}: " if experiment else ""
            said.append(f"{named}{jam_text(one)}\nwrote       {place / 'jam.json'}\nopen        {page}")
        answer({"experiments": reports} if study else reports[""], "\n".join(said))


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
    with _answering(as_json) as answer:
        from backend.mechanism.read import is_study, read_mechanism
        from backend.report.ensemble_page import write_ensemble_page
        from backend.report.ensemble_summary import ensemble_text

        if is_study(file):
            raise ValueError(f"{file} is a study; samples are let go from the drawn pose: give its mechanism.json")
        if samples is None:
            raise ValueError("--vary needs to know how many samples to draw: add --samples, such as --samples 10000")
        drawn = read_mechanism(file)
        folder = _folder(out, drawn.name)
        with _progress("compiling, then letting samples go") as advance:
            from backend.jam.ensemble import ensemble

            length = 1.0 if duration_s is None else duration_s
            try:
                found = ensemble(drawn, vary, samples, length, step_s, seed=seed, progress=_counting(advance))
            except RuntimeError as error:
                raise Failed(str(error)) from error
        report = found.report.model_dump(mode="json")
        _write_json(report, folder / "jam_ensemble.json")
        table = found.write(folder / "jam_ensemble.csv")
        page = write_ensemble_page(found.report, folder / "jam_ensemble.html")
        written = f"wrote       {folder / 'jam_ensemble.json'}, {table}\nopen        {page}"
        answer(report, f"{ensemble_text(found.report)}\n{written}")


def _settings(pairs: list[str]) -> dict[str, str]:
    """`cells=23` -> {"cells": "23"}; the script's own declarations say what type each has."""
    chosen: dict[str, str] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (equals and name.isidentifier()):
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE, such as cells=23", param_hint="--set")
        chosen[name] = text
    return chosen


def _folder(out: Path | None, name: str) -> Path:
    """Where to write, made before the work starts: a place that cannot be written should not cost a long run."""
    folder = out or Path("out") / (re.sub(r"[^\w.-]+", "_", name).lstrip(".") or "unnamed")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write_json(report: Mapping[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


@contextmanager
def _answering(as_json: bool) -> Iterator[Callable[[Mapping[str, Any], str], None]]:
    """Give the command a way to answer, and turn what it raises into a sentence and an exit code.

    Under --json the report alone reaches standard output: whatever scripts and engines print on the way goes
    to standard error.
    """
    stdout = sys.stdout

    def answer(report: Mapping[str, Any], text: str) -> None:
        print(json.dumps(report, indent=1, ensure_ascii=False) if as_json else text, file=stdout)

    try:
        with redirect_stdout(sys.stderr if as_json else stdout):
            yield answer
    except Failed as error:
        _end(error, FAILED)
    except ValueError as error:  # the rooms' own errors: sentences about the input
        _end(error, BAD_INPUT)
    except OSError as error:
        _end(_unreachable(error), BAD_INPUT)


def _unreachable(error: OSError) -> str:
    """What the system would not do, as a sentence; a sentence of the rooms' own is kept."""
    if error.strerror is None:
        return str(error)
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror}; check the path, its permissions and the space left, or choose another with --out"


def _end(error: Exception | str, code: int) -> None:
    print(f"error: {error}", file=sys.stderr)
    raise typer.Exit(code) from None


@contextmanager
def _progress(what: str) -> Iterator[Advance]:
    """A progress bar on standard error when it is a terminal; otherwise silence."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    text = TextColumn("{task.description}")
    columns = (SpinnerColumn(), text, BarColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda part, words="": bar.update(task, completed=part, total=1.0, description=words or what)


@contextmanager
def _stoppable() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed: the work ends at its next halt and is written; pressed again, it ends at once."""
    pressed: list[int] = []

    def note(number: int, frame: Any) -> None:
        pressed.append(number)
        signal.signal(signal.SIGINT, before)
        print("ending early; Ctrl-C again drops everything", file=sys.stderr)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)


def _counting(advance: Advance) -> Callable[[int, int], None]:
    """The same progress, told as so many of so many."""
    return lambda done, total: advance(done / max(total, 1))
