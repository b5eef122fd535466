"""A worker's work on one job: claim it, lay out its inputs, run it, keep what it wrote."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from pathlib import Path

from backend.service.jobs.checkpoint import Checkpoints
from backend.service.jobs.command import CHECKPOINTS, WATCHED, arguments
from backend.service.jobs.desk import REPORT
from backend.service.jobs.holding import Claim, HeldElsewhere, claim, finish, give_back, lost, note_progress
from backend.service.jobs.process import Ended, complaint, run, said
from backend.service.logs import logger
from backend.service.problems import Problem
from backend.service.records import StoredFile
from backend.service.service import Service
from backend.service.settings import Settings
from backend.service.things import stored

DONE = 0
MOST_FILES = 2000
LONGEST_PAUSE_S = 60.0  # after errors of ours
LOST = "lost"  # why a process was stopped whose job is no longer ours


def carry_out(service: Service, id: str, worker: str, fit_to_work: Callable[[], bool]) -> None:
    """Do a job, or what is left of it.

    fit_to_work: whether this worker may go on; one that others hold for dead may not.
    """
    while True:
        try:
            mine = claim(service, id, worker)
        except HeldElsewhere:  # it ends, or dies and leaves the job to us
            time.sleep(service.settings.heartbeat_s)
            continue
        # To return is to say that the job needs nobody any more: not so when it was lost to another, who may yet die.
        if mine is None:
            return
        work = partial(_in_a_folder, service, mine, worker, fit_to_work)
        if _patiently(service, mine, fit_to_work, work):
            return


def pause_s(settings: Settings, failures: int) -> float:
    """How long to wait after so many errors of ours before, longer each time [s]."""
    return min(LONGEST_PAUSE_S, settings.heartbeat_s * 2.0 ** min(failures, 10))


def _patiently(service: Service, mine: Claim, fit_to_work: Callable[[], bool], work: Callable[[], bool]) -> bool:
    """What `work` returns; after an error of ours it is begun again under the same claim, and is no attempt more.

    False where the job was lost meanwhile. Given up after as long as a job may take: a day's errors are no hiccup.
    """
    began: float | None = None
    for failures in count():
        try:
            if failures and (not fit_to_work() or lost(service, mine)):
                return False
            if began is not None and time.monotonic() - began > service.settings.job_timeout_s:
                return finish(service, mine, "failed", [], "The service failed at it again and again; ask anew.", None)
            return work()
        except Exception:  # the database or the storage is away, whatever an object store says then
            began = began or time.monotonic()
            logger().exception("the work on a job failed here, and is taken up again", job=mine.job.id)
            time.sleep(pause_s(service.settings, failures))
    return False


def _in_a_folder(service: Service, mine: Claim, worker: str, fit_to_work: Callable[[], bool]) -> bool:
    folder = service.settings.scratch / "jobs" / mine.job.id / f"{mine.attempt}-{worker}"
    for left in folder.parent.glob("*"):  # by attempts whose workers were killed
        shutil.rmtree(left, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        return _attempt(service, mine, folder, fit_to_work)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # another attempt's folder stands beside it
            folder.parent.rmdir()


def _attempt(service: Service, mine: Claim, folder: Path, fit_to_work: Callable[[], bool]) -> bool:
    """One attempt; False where the job was lost on the way."""
    inputs, out = folder / "inputs", folder / "out"
    inputs.mkdir()
    out.mkdir()
    checkpoints = Checkpoints(service, mine, out)
    try:
        resume = checkpoints.restore()
        command = [*service.settings.job_command, *arguments(service, mine.job.request, inputs, out, resume)]
    except Problem as problem:
        return finish(service, mine, "failed", [], problem.detail, None)

    # A hiccup of database or storage must not end the work; for how long it may last, fit_to_work says.
    def told(part: float, words: str) -> None:
        with _noting("progress was not told", mine):
            note_progress(service, mine, part, words)

    def stop() -> str | None:
        if not fit_to_work():
            return LOST
        with _noting("what a job keeps was not copied", mine):
            checkpoints.copy()
        with _noting("whose the job is was not told", mine):
            return LOST if lost(service, mine) else None
        return None

    ended = run(command, folder, service.settings, told, stop)
    if ended.stopped == LOST:
        return False  # whoever claimed it needs the checkpoints; those of a cancelled job are tidied up
    if resume and ended.code > 1 and "--resume" in complaint(folder):
        checkpoints.drop()  # written by another version: begin anew
        return give_back(service, mine, crashed=True)
    if ended.code < 0 and ended.stopped is None and mine.job.crashes + 1 < service.settings.most_crashes:
        return give_back(service, mine, crashed=True)
    if published := _patiently(service, mine, fit_to_work, lambda: _publish(service, mine, folder, ended)):
        checkpoints.drop()
    return published


@contextmanager
def _noting(what: str, mine: Claim) -> Iterator[None]:
    """Errors of the block are logged and passed over."""
    try:
        yield
    except Exception as error:
        logger().warning(what, job=mine.job.id, error=str(error)[:500])


def _publish(service: Service, mine: Claim, folder: Path, ended: Ended) -> bool:
    """Keep what the job wrote and say how it ended, both or neither; whether it was ours to say."""
    files = _files(service, mine, folder)
    state = "succeeded" if ended.code == DONE and ended.stopped is None else "failed"
    code = ended.code if ended.stopped is None and ended.code >= 0 else None
    if published := finish(service, mine, state, files, _message(ended, folder, mine), code):
        return published
    service.storage.let_go(file.key for file in files)
    return False


def _files(service: Service, mine: Claim, folder: Path) -> list[StoredFile]:
    out = folder / "out"
    text = said(folder).replace(f"{folder}/out/", "").replace(f"{folder}/inputs/", "")
    try:
        report = json.loads(text)
    except ValueError:
        report = None  # a command that failed early prints none
    if isinstance(report, dict):
        report.pop("files", None)  # paths on this machine; they are listed beside
        (out / REPORT).write_text(json.dumps(report, indent=1, ensure_ascii=False), encoding="utf-8")
    paths = sorted(path for path in out.rglob("*") if path.is_file() and not path.is_symlink())
    wanted = [path for path in paths if path.name not in (*CHECKPOINTS, WATCHED) and not path.name.startswith(".")]
    files: list[StoredFile] = []
    try:
        for path in wanted[:MOST_FILES]:
            files.append(stored(mine.job.id, path.relative_to(out).as_posix(), service.storage.put(path)))
    except Exception:
        service.storage.let_go(file.key for file in files)
        raise
    return files


def _message(ended: Ended, folder: Path, mine: Claim) -> str:
    if ended.stopped is not None:
        return ended.stopped
    if ended.code < 0:
        times = mine.job.crashes + 1
        return f"Its process was killed {times} times (signal {-ended.code}), perhaps for want of memory; ask for less."
    return "" if ended.code == DONE else complaint(folder) or f"The command ended with exit code {ended.code}."
