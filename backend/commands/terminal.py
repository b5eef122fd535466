"""What every command shares: how it answers, shows progress, ends early, and where it writes."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer

DONE, FAILED, BAD_INPUT = 0, 1, 2
UNHEARD = 141  # how shells tell of a program whose reader went away: 128 and the number of SIGPIPE
LINE_EVERY_S = 30.0
MINUTES = 40.0  # after which a search ends unless told
SEARCHING = 0.9  # of work whose search is limited: the rest is weighing

Out = Annotated[Path | None, typer.Option(help="Folder for what the command writes.", file_okay=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print the report alone, as JSON.")]
MechanismFile = Annotated[Path, typer.Argument(help="mechanism.json: what was drawn.", exists=True, dir_okay=False)]
StudyFile = Annotated[
    Path, typer.Argument(help="study.json: a mechanism and its experiments.", exists=True, dir_okay=False)
]


class Advance(Protocol):
    """Tell how far the work is: a part of the whole, from 0 to 1, and a few words on what is being done."""

    def __call__(self, part: float, words: str = "") -> None: ...  # noqa: D102


class Failed(Exception):
    """The input was sound and the work did not succeed; the message says why and what to do."""


@contextmanager
def answering(as_json: bool) -> Iterator[Callable[[Mapping[str, Any], str], None]]:
    """Give the command a way to answer, and turn what it raises into a sentence and an exit code.

    Under --json the report alone reaches standard output: whatever scripts and engines print on the way goes
    to standard error. A reader that has read enough (`| head -1`) ends the command without a word, its work done.
    """
    stdout, heard = sys.stdout, True

    def answer(report: Mapping[str, Any], text: str) -> None:
        nonlocal heard
        try:
            print(json.dumps(report, indent=1, ensure_ascii=False) if as_json else text, file=stdout, flush=True)
        except BrokenPipeError:
            heard = False
            # What stays in the buffer would break the pipe again when Python flushes it at the end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stdout.fileno())

    try:
        with redirect_stdout(sys.stderr if as_json else stdout):
            yield answer
    except Failed as error:
        _end(error, FAILED)
    except ValueError as error:  # the rooms' own errors: sentences about the input
        _end(error, BAD_INPUT)
    except OSError as error:
        _end(_unreachable(error), BAD_INPUT)
    if not heard:
        raise typer.Exit(UNHEARD)


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
def progress(what: str) -> Iterator[Advance]:
    """A progress bar on standard error when it is a terminal; otherwise a line there every half a minute.

    Where LINKTWIN_PROGRESS names a file, that file is told instead: {"part": 0.4, "words": "..."}.
    """
    if told := os.environ.get("LINKTWIN_PROGRESS"):
        yield _telling(Path(told), what)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _now_and_then(what)
        return
    text = TextColumn("{task.description}")
    columns = (SpinnerColumn(), text, BarColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda part, words="": bar.update(task, completed=part, total=1.0, description=words or what)


def _now_and_then(what: str) -> Advance:
    """Lines for whoever reads a log: how far, how long it took, how long it may take; none of what is done sooner."""
    started = last = time.monotonic()

    def tell(part: float, words: str = "") -> None:
        nonlocal last
        if (now := time.monotonic()) - last < LINE_EVERY_S:
            return
        last = now
        took = timedelta(seconds=round(now - started))
        left = timedelta(seconds=round((now - started) * (1.0 - part) / part)) if part > 0.0 else "?"
        print(f"{100.0 * part:3.0f}%  {words or what}, {took} since it began, {left} left", file=sys.stderr, flush=True)

    return tell


def _telling(file: Path, what: str) -> Advance:
    """Keep a small file up to date, whole at every moment, at most ten times a second."""
    last = -math.inf

    def tell(part: float, words: str = "") -> None:
        nonlocal last
        if (now := time.monotonic()) - last < 0.1 and part < 1.0:
            return
        last = now
        fresh = file.with_suffix(".part")
        with suppress(OSError):  # nobody may be left to be told; the work goes on
            fresh.write_text(json.dumps({"part": part, "words": words or what}), encoding="utf-8")
            fresh.replace(file)

    tell(0.0)
    return tell


@contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
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


class Limited:
    """Work that ends at its next halt after Ctrl-C, or once its minutes are over (0: never)."""

    def __init__(self, minutes: float, advance: Advance, stopped: Callable[[], bool]):
        self.began, self.most_s = time.monotonic(), 60.0 * minutes if minutes > 0.0 else math.inf
        self.advance, self.stopped, self.late = advance, stopped, False

    def __call__(self) -> bool:
        """Whether to end now."""
        self.late = self.late or self._share() >= 1.0
        return self.late or self.stopped()

    def tell(self, part: float, words: str = "") -> None:
        """Progress, of the work or of its time, whichever is nearer to its end."""
        self.advance(max(part, SEARCHING * min(self._share(), 1.0)), words)

    def _share(self) -> float:
        return (time.monotonic() - self.began) / self.most_s


def counting(advance: Advance) -> Callable[[int, int], None]:
    """The same progress, told as so many of so many."""
    return lambda done, total: advance(done / max(total, 1))


def folder_for(out: Path | None, name: str) -> Path:
    """Where to write, made before the work starts: a place that cannot be written should not cost a long run."""
    folder = out or Path("out") / (re.sub(r"[^\w.-]+", "_", name).lstrip(".") or "unnamed")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_json(report: Mapping[str, Any], path: Path) -> None:
    """Indented, with the folder made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(report, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
