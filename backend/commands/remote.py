"""The same command, done by a service: what it works on goes there, and what it writes comes back."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.commands.terminal import BAD_INPUT, Advance, Failed, folder_for, progress

if TYPE_CHECKING:
    from backend.client import Linktwin
    from backend.service.answers import JobAnswer, ProgressAnswer

Server = Annotated[
    str | None, typer.Option(metavar="URL", help="Have a linktwin service do it; what it writes lands in --out.")
]
Key = Annotated[
    str | None, typer.Option(metavar="KEY", envvar="LINKTWIN_KEY", help="API key of the service, where it wants one.")
]
REPORT = "report.json"  # what --json prints
SENDING = 0.1  # of the bar


@dataclass(frozen=True)
class DoneThere:
    """A job that has ended on a service, and what it wrote.  report: None where it failed before there was one."""

    job: JobAnswer
    report: dict[str, Any] | None
    folder: Path
    written: list[Path]
    page: str

    def tell(self, answer: Callable[[Mapping[str, Any], str], None], text: Callable[[Any], str], opens: str) -> None:
        """Answer as the command here does, and fail as it does.

        text: of the report.  opens: name of the pages that it wrote.
        """
        if self.report is not None:
            lines = [text(self.report), f"wrote     {self.folder}"]
            lines += [f"open      {path}" for path in self.written if path.name == opens]
            answer(self.report, "\n".join([*lines, f"kept      {self.page}"]))
        if self.job.state == "cancelled":
            raise Failed(f"the job was cancelled on the service: {self.page}")
        if self.job.state == "failed":
            raise (ValueError if self.job.exit_code == BAD_INPUT else Failed)(self.job.message)


@contextmanager
def asking(server: str, key: str | None) -> Iterator[Linktwin]:
    """A client of the service; what it refuses is bad input, what it cannot do has failed."""
    from backend.client import Linktwin, ServiceProblem

    try:
        with Linktwin(server, key) as there:
            yield there
    except ServiceProblem as problem:
        hint = " Give it in LINKTWIN_KEY, or as --key." if problem.status in (401, 403) else ""
        ours = problem.status is not None and 400 <= problem.status < 500 and problem.status != 429
        raise (ValueError if ours else Failed)(f"{problem}{hint}") from None


def done_there(
    server: str,
    key: str | None,
    file: Path,
    out: Path | None,
    start: Callable[..., JobAnswer],
    study: bool = True,
    resume: bool = False,
    clip: Path | None = None,
) -> DoneThere:
    """Send a study with all it names, or a mechanism, and a clip where there is one; start a job, bring what it wrote.

    start: given the client and the ids of what was stored.  Ctrl-C cancels the job.
    """
    from backend.client import ServiceProblem
    from backend.mechanism.read import read_mechanism, read_study_file

    if resume:
        raise ValueError("--resume goes on with what lies in --out; a service resumes its own jobs: leave one out")
    drawn = read_mechanism(file.parent / read_study_file(file).mechanism if study else file)
    folder = folder_for(out, drawn.name)
    with asking(server, key) as there, progress("sending") as advance, _interrupts() as interrupt:
        sending = partial(_sent, advance)
        things = [(there.store_study if study else there.store_mechanism)(file, sent=sending)]
        if clip is not None:
            things.append(there.store_clip(clip, sent=sending))
        interrupt.held = True
        job = start(there, *(thing.id for thing in things))
        try:
            interrupt.let_go()
            job = there.wait(job, _told(advance, interrupt))
            written = there.download(job, folder, without=[REPORT])
            reported = any(found.path == REPORT for found in there.files(job))
            report = there.result(job).report if reported else None
        except KeyboardInterrupt:
            raise Failed(f"stopped; the job is {there.cancel(job).state}: {there.page(job)}") from None
        except ServiceProblem as problem:
            if problem.passing:
                problem.detail += f" The job goes on, and is kept: {there.page(job)}"
            raise
        return DoneThere(job, report, folder, written, there.page(job))


def _sent(advance: Advance, part: float) -> None:
    advance(SENDING * part, "sending")


def _told(advance: Advance, interrupt: Interrupt) -> Callable[[ProgressAnswer], None]:
    def told(how_far: ProgressAnswer) -> None:
        interrupt.heed()
        advance(SENDING + (1.0 - SENDING) * how_far.part, how_far.words or how_far.state)

    return told


class Interrupt:
    """Ctrl-C, kept until it is heeded: raised while a job is being started it would leave that running unknown, and
    Python drops what is raised in a destructor.  held: only noted, once.
    """

    def __init__(self):
        self.held = self.pressed = False

    def press(self, number: int, frame: Any) -> None:
        """As a handler of the signal."""
        again, self.pressed = self.pressed, True
        if again or not self.held:
            raise KeyboardInterrupt

    def let_go(self) -> None:
        """From now on it is raised at once, and now where it was held."""
        self.held = False
        self.heed()

    def heed(self) -> None:
        """Raise it where it was pressed and came to nothing."""
        if self.pressed:
            raise KeyboardInterrupt


@contextmanager
def _interrupts() -> Iterator[Interrupt]:
    interrupt = Interrupt()
    before = signal.signal(signal.SIGINT, interrupt.press)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)
