"""Work asked for: what runs, what is done, what failed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from nicegui import ui
from sqlmodel import col, select

from backend.service.jobs.desk import list_jobs
from backend.service.page.markup import button, empty, link, tag
from backend.service.page.shell import page, tell, view
from backend.service.problems import Problem
from backend.service.records import Job, Thing
from backend.service.service import Service

NAMES = {
    "simulate": "Motion", "jam": "Does it jam?", "fit": "Fit", "diagnose": "Diagnosis", "track": "Tracking",
}  # fmt: skip
SAID = {"jam": "Does {} jam?"}  # of what is asked; else the kind's name of it
STATES = {
    "queued": ("queued", "waiting"),
    "running": ("running", "running"),
    "succeeded": ("done", "done"),
    "failed": ("failed", "failed"),
    "cancelled": ("", "cancelled"),
}


@page("/work")
def work_view(service: Service, owner: str) -> None:
    """All work of this owner, newest first."""
    jobs = list_jobs(service, owner, 100).rows
    with view("Work", now="/work"):
        tag("h1", "Work", style="margin-top: 26px")
        if jobs:
            work_table(jobs, subjects(service, jobs))
            return
        with empty(
            "Nothing was asked yet", "Open a mechanism and ask whether it jams, or open a study and diagnose it."
        ):
            link("To the mechanisms", "/", "act primary")


def asked_of(kind: str, name: str) -> str:
    """What a job asks of what."""
    return SAID.get(kind, f"{NAMES[kind]} of {{}}").format(name)


def subjects(service: Service, jobs: Sequence[Job]) -> dict[str, str]:
    """Names, by the jobs' ids, of the studies and mechanisms that they are about."""
    about = {job.id: job.request.get("study") or job.request.get("mechanism") for job in jobs}
    with service.database.reading() as session:
        found = session.exec(select(Thing).where(col(Thing.id).in_({*about.values()} - {None})))
        names = {thing.id: thing.name for thing in found}
    return {job: names.get(id or "", "a deleted one") for job, id in about.items()}


def work_table(jobs: Sequence[Job], of: Mapping[str, str] | None = None) -> None:
    """One line a job; of: what it is about, where that is not said already."""
    with tag("div", look="scroll"), tag("table", look="plain"):
        with tag("thead"), tag("tr"):
            for head in ("what", *(["of"] if of else []), "how it stands", "asked", "took"):
                tag("th", head, scope="col")
        with tag("tbody"):
            for job in jobs:
                with tag("tr"):
                    with tag("td", look="name"):
                        link(NAMES.get(job.kind, job.kind), f"/jobs/{job.id}")
                    if of:
                        tag("td", of[job.id])
                    look, words = STATES[job.state]
                    with tag("td"):
                        part = f" {100 * job.part:.0f}%" if job.state == "running" else ""
                        tag("span", words + part, f"status {look}")
                    tag("td", ago(job.created))
                    tag("td", lasted(job.finished - job.started) if job.finished and job.started else "–")


def ago(when: float) -> str:
    """How long since a moment."""
    s = max(0.0, time.time() - when)
    return "just now" if s < 60 else f"{lasted(s)} ago"


def lasted(s: float) -> str:
    """A span of time as one says it."""
    if s < 90:
        return f"{s:.0f} s"
    if s < 5400:
        return f"{s / 60:.0f} min"
    return f"{s / 3600:.1f} h" if s < 48 * 3600 else f"{s / 86400:.0f} days"


def work_on(service: Service, owner: str, kind: str, id: str, heading: str) -> None:
    """The work asked of one stored thing, where there is any."""
    jobs = [job for job in list_jobs(service, owner, 100).rows if job.request.get(kind) == id]
    if jobs:
        tag("h2", heading)
        work_table(jobs)


def deletion(what: str, words: str, delete: Callable[[], None]) -> None:
    """A folded-away button that deletes one stored thing, and says why where that is refused."""
    with tag("details", style="margin-top: 28px"):
        tag("summary", f"Delete this {what}")
        said = tag("div")

        def gone() -> None:
            try:
                delete()
            except Problem as problem:
                tell(problem, said)
                return
            ui.navigate.to("/")

        button(words, gone, "act danger")
