"""One job: how far it is and how to end it; then what came of it, to read, play, download and pass on."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

from nicegui import ui

from backend.mechanism.jam_report import run_folder
from backend.service.jobs.command import WATCHED
from backend.service.jobs.desk import cancel_job, delete_job, find_job, progress_of
from backend.service.page import results
from backend.service.page.access import share_token, shared_job
from backend.service.page.drawing_view import staged
from backend.service.page.late import ROOT
from backend.service.page.markup import button, empty, link, notice, tag
from backend.service.page.shell import page, tell, view
from backend.service.page.subject import subject_of
from backend.service.page.timeline import Timeline
from backend.service.page.work import ago, asked_of, lasted
from backend.service.problems import Problem
from backend.service.records import Job, Thing
from backend.service.service import Service
from backend.service.states import FINISHED
from backend.service.things import CHECKPOINT, file_of, files_of

EVERY_S = 0.5
SHOW_LINK = """() => setTimeout(() => {
  const link = document.getElementById("share-link");
  link.value = location.origin + link.dataset.path; link.select();
}, 150)"""
COPY_LINK = """(event) => {
  const link = document.getElementById("share-link");
  link.select();
  const copied = navigator.clipboard ? navigator.clipboard.writeText(link.value) : document.execCommand("copy");
  Promise.resolve(copied).then(() => { event.target.textContent = "Copied"; });
}"""
PROMISE = {
    "track": "Every dot is followed through the clip; a few minutes for a long one.",
    "fit": "The motion is simulated again and again until it fits what was measured.",
    "diagnose": "Every effect of the library is tried, one by one and in pairs: minutes for a small mechanism.",
    "jam": "The mechanism is let go, and asked at every step what could hold it.",
    "simulate": "The mechanism is let go.",
}


@page("/jobs/{id}")
def job_view(service: Service, owner: str, id: str) -> None:
    """Progress while it runs, the result after."""
    job = find_job(service, owner, id)
    name, address = _subject(service, job)
    with view(asked_of(job.kind, name), [("Work", "/work"), (name, address)], now="/work"):
        if job.state in FINISHED:
            _finished(service, job, name)
        else:
            _running(service, owner, job, name)


@page("/shared/{id}/{token}", open_to_all=True)
def shared_view(service: Service, owner: str, id: str, token: str) -> None:
    """The same result for whoever was sent the link: to read and to download, not to change."""
    job = shared_job(service, id, token)
    name, _ = _subject(service, job)
    with view(asked_of(job.kind, name)):
        if job.state in FINISHED:
            _finished(service, job, name, f"{id}/{token}")
        else:
            tag("h1", name, style="margin-top: 26px")
            empty("This is still being worked on", "Open the link again in a while.")


def _subject(service: Service, job: Job) -> tuple[str, str]:
    """Name and address of what the job is about."""
    for field, room in (("study", "studies"), ("mechanism", "mechanisms")):
        if id := job.request.get(field):
            with service.database.reading() as session:
                thing = session.get(Thing, id)
            return (thing.name if thing else "a deleted one"), f"/{room}/{id}"
    return "nothing", "/"


def _running(service: Service, owner: str, job: Job, name: str) -> None:
    with tag("div", look="headline"):
        with tag("div"):
            tag("h1", asked_of(job.kind, name))
            tag("p", PROMISE[job.kind], "soft")
        with tag("div", look="actions"):
            stop = button("Cancel", lambda: end(), "act danger")
    said = tag("div", aria_live="polite")
    with tag("div", look="panel", style="max-width: 720px"):
        words = tag("h3", "Waiting for a worker …", "words", role="status")
        gauge = tag(
            "div", look="gauge busy", role="progressbar", aria_valuemin="0", aria_valuemax="100", aria_label="Progress"
        )
        with gauge:
            bar = tag("i")
        times = tag("p", "Asked " + ago(job.created), "note")
    picture = tag("img", look="watched", alt="The dots as they are followed now")
    picture.set_visibility(False)
    tag("p", "You can close this page: the work goes on, and stands under Work.", "note")

    async def look() -> None:
        now = await asyncio.to_thread(find_job, service, owner, job.id)
        if now.state in FINISHED:
            clock.cancel()
            ui.navigate.reload()
            return
        told = progress_of(now)
        if now.state == "running":
            words.set_text(told.words[:1].upper() + told.words[1:] or "Starting")  # type: ignore[attr-defined]
            known = told.part > 0.005
            gauge.classes(replace="gauge" if known else "gauge busy")
            gauge.props["aria-valuenow"] = round(100 * told.part)
            bar.style(f"width: {100 * told.part:.1f}%")
            left = f", about {lasted(told.remaining_s)} left" if told.remaining_s is not None else ""
            if (seen := await asyncio.to_thread(_watched, service, job.id)) is not None:
                picture.props(f'src="{ROOT}/watching/{job.id}.jpg?{seen}"')  # another address for another picture
                picture.set_visibility(True)
            times.set_text(f"{100 * told.part:.0f}%, {lasted(told.elapsed_s)} so far{left}")  # type: ignore[attr-defined]

    def end() -> None:
        stop.props("disabled")
        try:
            cancel_job(service, owner, job.id)
        except Problem as problem:
            tell(problem, said)

    clock = ui.timer(EVERY_S, look)


def _watched(service: Service, id: str) -> str | None:
    """Which picture of the work lies there now; none for work that shows none."""
    return next((file.sha256[:16] for file in files_of(service, CHECKPOINT + id) if file.path == WATCHED), None)


def _finished(service: Service, job: Job, name: str, shared: str = "") -> None:
    there = {file.path for file in files_of(service, job.id)}
    base = f"{ROOT}/shared-files/{shared}/" if shared else f"{ROOT}/files/jobs/{job.id}/"
    with tag("div", look="headline"):
        with tag("div"):
            tag("h1", asked_of(job.kind, name))
            took = lasted(job.finished - job.started) if job.finished and job.started else ""
            tag("p", f"Asked {ago(job.created)}" + (f", took {took}." if took else "."), "soft")
        with tag("div", look="actions"):
            if there:
                link("Download everything", base + "all.zip", "act")
            if not shared and there:
                _share(service, job)
            if job.kind == "track" and job.state == "succeeded" and not shared:
                link("Make a study of the runs", f"/mechanisms/{job.request['mechanism']}/study", "act primary")
            if job.kind == "simulate" and not shared:
                link("Measure the real one", f"/mechanisms/{job.request['mechanism']}/measure", "act primary")
    if job.state == "cancelled":
        with empty("Cancelled", "Nothing was kept of it. Ask again whenever you like."):
            link("Back", _subject(service, job)[1], "act primary")
        return
    if job.state == "failed":
        notice((job.message or "It ended without a word; ask again.",), "bad", "It did not succeed")
        if not shared:
            if job.kind == "track":
                clip = f"/mechanisms/{job.request['mechanism']}/clips/{job.request['video']}?again={job.id}"
                link("Mark the clip again", clip, "act primary")
            else:
                link("Back", _subject(service, job)[1], "act primary")
    _show(service, job, there, base, shared)
    results.file_list(service, job, base)
    if not shared:
        _forget(service, job)


def _show(service: Service, job: Job, there: set[str], base: str, shared: str) -> None:
    if job.kind == "track":
        if "tracks.csv" in there:
            results.tracking(service, job, base, None if shared else f"{ROOT}/files/videos/{job.request['video']}/")
        return
    pictures = sorted(path for path in there if path.rpartition("/")[2] == "pictures.json")
    if "report.json" not in there:
        return
    report = json.loads(service.storage.read(file_of(service, job.id, "report.json").key))
    if not pictures:
        results.written_page(there, base)
        return
    drawn = _stage(service, job, shared)

    def put(path: str, of: Any) -> None:
        told = json.loads(service.storage.read(file_of(service, job.id, path).key))
        results.VIEWS[job.kind](of, told, drawn, base + path)

    with Timeline():
        if "experiments" not in report:
            put(pictures[0], report)
            return
        of_run = {name: f"{run_folder(name)}/pictures.json" for name in report["experiments"]}
        every = {name: one for name, one in report["experiments"].items() if of_run[name] in there}
        first = next((name for name, one in every.items() if one.get("jammed")), next(iter(every), None))
        for name, one in every.items():
            _run(name, one["jammed"], name == first, lambda path=of_run[name], one=one: put(path, one))


def _run(name: str, jammed: bool, opened: bool, put: Callable[[], None]) -> None:
    """One run of several, whose pictures are there while it is open: a browser draws sixteen stages at most."""
    with tag("details", look="run", open=True if opened else None) as fold:
        with tag("summary"):
            tag("b", name)
            tag("span", "jams" if jammed else "moves", f"status {'failed' if jammed else 'done'}")
        inside = tag("div")

    def show(is_open: bool) -> None:
        inside.clear()
        if is_open:
            with inside:
                put()

    show(opened)
    fold.on("toggle", lambda event: show(event.args), js_handler="(e) => emit(e.target.open)")


def _stage(service: Service, job: Job, shared: str) -> Any:
    """The drawing that the job was about; None where it was deleted since."""
    try:
        about = subject_of(service, job)
        return staged(service, about.mechanism, about.room, about.id, about.folder, shared)
    except Problem:
        return None


def _share(service: Service, job: Job) -> None:
    box = tag("div", look="share")
    box.set_visibility(False)

    def show() -> None:
        box.set_visibility(True)
        press.set_visibility(False)

    press = button("Share", show)
    with box:
        tag(
            "input", look="in", readonly=True, aria_label="Link to this result", id="share-link",
            data_path=f"{ROOT}/shared/{job.id}/{share_token(service, job.id)}",
            title="Whoever has the link can read and download this result, and nothing else",
        )  # fmt: skip
        copy = button("Copy link")
    press.on("click", js_handler=SHOW_LINK)
    copy.on("click", js_handler=COPY_LINK)


def _forget(service: Service, job: Job) -> None:
    with tag("details", style="margin-top: 28px"):
        tag("summary", "Delete this result")
        said = tag("div")

        def gone() -> None:
            try:
                delete_job(service, job.owner, job.id)
            except Problem as problem:
                tell(problem, said)
                return
            ui.navigate.to("/work")

        button("Delete it and its files", gone, "act danger")
