"""Who holds a job: claimed by one worker at a time, under a number that only grows, so that a late one cannot speak."""

from __future__ import annotations

import time
from dataclasses import dataclass

from sqlmodel import Session, col, select, update

from backend.service.records import Job, StoredFile, Worker
from backend.service.service import Service
from backend.service.states import FINISHED
from backend.service.things import locked_account


@dataclass(frozen=True)
class Claim:
    """The right to work on a job and to say how it ended, while nobody claims it after."""

    job: Job
    attempt: int


class HeldElsewhere(Exception):
    """A worker that is alive holds the job."""


def claim(service: Service, id: str, worker: str) -> Claim | None:
    """Take a job; None where nothing is left to do.  Raises HeldElsewhere."""
    with service.database.writing() as session:
        job = _locked(session, id)
        if job is None or job.state in FINISHED:
            return None
        held = job.state == "running" and job.worker not in (None, worker)
        if held and job.worker in alive(service, session):
            raise HeldElsewhere
        if job.attempt >= service.settings.most_attempts:
            _finish(job, "failed", message=f"Given up after {job.attempt} attempts whose workers all died.")
            session.add(job)
            return None
        job.attempt += 1
        job.state, job.worker, job.started = "running", worker, job.started or time.time()
        session.add(job)
    return Claim(job, job.attempt)


def note_progress(service: Service, claim: Claim, part: float, words: str) -> None:
    """Tell how far the work is."""
    with service.database.writing() as session:
        session.execute(update(Job).where(*_still(claim)).values(part=part, words=words))


def lost(service: Service, claim: Claim) -> bool:
    """Whether the job was cancelled, or claimed by another."""
    with service.database.reading() as session:
        return session.exec(select(Job.id).where(*_still(claim))).first() is None


def finish(
    service: Service, claim: Claim, state: str, files: list[StoredFile], message: str, exit_code: int | None
) -> bool:
    """Say how the job ended and keep what it wrote; False where the claim was lost: then nothing is changed."""
    with service.database.writing() as session:
        job = _locked(session, claim.job.id)
        if job is None or job.state != "running" or job.attempt != claim.attempt:
            return False
        _finish(job, state, message=message, exit_code=exit_code)
        job.bytes = sum(file.bytes for file in files)
        # Results are kept even where they overfill: the next upload or job is what is refused.
        account = locked_account(session, job.owner)
        account.stored_bytes += job.bytes
        session.add_all([job, account, *files])
    return True


def give_back(service: Service, claim: Claim, crashed: bool) -> bool:
    """Let the job be handed over again, from its last checkpoint; False where the claim was lost."""
    with service.database.writing() as session:
        job = _locked(session, claim.job.id)
        if job is None or job.state != "running" or job.attempt != claim.attempt:
            return False
        job.state, job.worker, job.handed_over, job.handovers = "queued", None, None, job.handovers + 1
        job.crashes += crashed
        session.add(job)
    return True


def alive(service: Service, session: Session) -> set[str]:
    """Ids of the workers that are neither ended nor silent."""
    silent = time.time() - service.settings.dead_after_s
    return set(session.exec(select(Worker.id).where(col(Worker.ended).is_(None), Worker.beat > silent)))


def _finish(job: Job, state: str, message: str, exit_code: int | None = None) -> None:
    job.state, job.finished, job.message, job.exit_code = state, time.time(), message[:8000], exit_code
    job.part = 1.0 if state == "succeeded" else job.part


def _locked(session: Session, id: str) -> Job | None:
    return session.exec(select(Job).where(Job.id == id).with_for_update()).first()


def _still(claim: Claim) -> tuple:
    return Job.id == claim.job.id, Job.attempt == claim.attempt, Job.state == "running"
