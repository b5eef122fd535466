"""The command line: each command parses its arguments, calls one function and says what came of it.

Rooms are imported inside the commands: `--help` and reading a drawing stay free of jax, cadquery and OpenCV.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

DONE, FAILED, BAD_INPUT = 0, 1, 2

Advance = Callable[[float, str], None]
"""Tell how far the work is: a fraction of the whole in [0, 1], and a few words on what is being done."""

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
MechanismFile = Annotated[
    Path, typer.Argument(help="mechanism.json: what was drawn.", exists=True, dir_okay=False)
]


class Failed(Exception):
    """The input was sound and the work did not succeed; the message says why and what to do."""


def main() -> None:
    """Entry point of `linktwin`: float64, then the command."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")  # read when jax starts: nothing is imported here
    app()


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


def _settings(pairs: list[str]) -> dict[str, Any]:
    """`cells=23` -> {"cells": 23}; numbers, true and false become values, all else stays text."""
    chosen: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (equals and name.isidentifier()):
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE, such as cells=23", param_hint="--set")
        try:
            chosen[name] = json.loads(text)
        except json.JSONDecodeError:
            chosen[name] = text
    return chosen


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
    except (ValueError, FileNotFoundError) as error:  # the rooms' own errors: sentences about the input
        _end(error, BAD_INPUT)


def _end(error: Exception, code: int) -> None:
    print(f"error: {error}", file=sys.stderr)
    raise typer.Exit(code) from None


@contextmanager
def _progress(what: str) -> Iterator[Advance]:
    """A progress bar on standard error when it is a terminal; otherwise silence."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f}%"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction, doing="": bar.update(
            task, completed=fraction, description=f"{what}: {doing}" if doing else what
        )
