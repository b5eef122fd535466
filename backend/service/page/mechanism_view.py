"""One mechanism: what was drawn, and what can be asked of it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nicegui import ui

from backend.service.jobs.desk import list_jobs, start_job
from backend.service.jobs.requests import JamRequest, SimulateRequest
from backend.service.mechanisms import DRAWING, delete_mechanism, load_mechanism
from backend.service.page.drawing_view import facts_beside, parts, staged
from backend.service.page.markup import button, field, link, notice, tag
from backend.service.page.shell import page, tell, view
from backend.service.page.stage import StageView
from backend.service.page.timeline import Timeline
from backend.service.page.upload import drop_zone
from backend.service.page.work import deletion, work_on, work_table
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.things import find_thing
from backend.service.videos import store_video

FILM = "Film every run from the drawn pose, let go after a moment of stillness, and keep a run or two aside to test on."
UNMARKED = (
    "The drawing names no markers, so a tracker would not know what to follow. Add markers where the dots are glued, "
    "export again, and bring the drawing anew. Joint encoders need no markers."
)


@page("/mechanisms/{id}")
def mechanism_view(service: Service, owner: str, id: str) -> None:
    """The mechanism on stage; beside it what `check` says; below what to do with it."""
    thing = find_thing(service, owner, "mechanism", id)
    mechanism = load_mechanism(service, owner, id)
    with view(thing.name, [("Mechanisms", "/")], now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", thing.name)
                tool = mechanism.provenance.tool if mechanism.provenance else ""
                tag("p", f"Drawn in {tool}." if tool else "As it was drawn.", "soft")
            with tag("div", look="actions"):
                link("Download", f"/files/mechanisms/{id}/all.zip", "act")
                link("Measure the real one", f"/mechanisms/{id}/measure", "act primary")
        with Timeline():
            with tag("div", look="split"):
                StageView(staged(service, mechanism, "mechanisms", id), thing.name)
                beside = tag("div", look="panel", aria_live="polite", aria_busy="true")
                with beside:
                    tag("p", "Counting loops and freedoms …", "note")
            with tag(
                "div", look="split", style="grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr))"
            ):
                parts(mechanism)
                _ask(service, owner, id)
        work_on(service, owner, "mechanism", id, "Work on it")
        deletion("mechanism", "Delete it and its meshes", lambda: delete_mechanism(service, owner, id))
    ui.timer(0.05, lambda: facts_beside(service, id, DRAWING, beside), once=True)


def _ask(service: Service, owner: str, id: str) -> None:
    """Questions that need no measurement."""
    given = {"duration": "1"}
    with tag("div", look="panel"):
        tag("h3", "Ask the drawing")
        tag("p", "Let go from the drawn pose, under gravity and the effects it lists.", "note")
        with tag("div", look="fields"):
            field(
                "how long [s]",
                "1",
                lambda text: given.update(duration=text),
                "number",
                min="0.01",
                max="60",
                step="0.1",
            )
        said = tag("div", aria_live="polite")

        def start(kind: str) -> None:
            try:
                seconds = float(given["duration"])
                asked: Any = {"kind": kind, "mechanism": id, "duration_s": seconds}
                request = (JamRequest if kind == "jam" else SimulateRequest).model_validate(asked)
                job = start_job(service, owner, request)
            except Problem as problem:
                tell(problem, said)
                return
            except ValueError:
                said.clear()
                with said:
                    notice(("Give the duration in seconds, above 0 and up to 3600.",), "bad")
                    return
            ui.navigate.to(f"/jobs/{job.id}")

        with tag("div", look="actions"):
            button("Does it jam?", lambda: start("jam"))
            button("Let it move", lambda: start("simulate"))


@page("/mechanisms/{id}/measure")
def measure_view(service: Service, owner: str, id: str) -> None:
    """Bring measurements: a clip to be tracked, or tables measured elsewhere."""
    thing = find_thing(service, owner, "mechanism", id)
    mechanism = load_mechanism(service, owner, id)
    tracked = [
        job for job in list_jobs(service, owner, 100).rows if job.kind == "track" and job.request.get("mechanism") == id
    ]
    with view("Measure", [("Mechanisms", "/"), (thing.name, f"/mechanisms/{id}")], now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", f"Measure {thing.name}")
                tag("p", FILM, "soft")
            if any(job.state == "succeeded" for job in tracked):
                link("Make a study of the runs", f"/mechanisms/{id}/study", "act primary")
        if not mechanism.markers:
            notice((UNMARKED,), "warn")
        tag("h2", "A clip")

        async def film(files: Mapping[str, Path]) -> None:
            (name, path), *more = files.items()
            if more:
                raise Problem("invalid", f"{len(files)} clips came at once; bring one after the other.")
            video = await asyncio.to_thread(store_video, service, owner, path, name)
            ui.navigate.to(f"/mechanisms/{id}/clips/{video.id}")

        drop_zone(
            service,
            "Drop a clip of the real one here",
            "The camera's own file (MP4, MOV, MKV, WebM), not an edited one: its time stamps matter.",
            ".mp4,.mov,.mkv,.webm,.avi,.m4v",
            film,
            many=False,
            primary=not tracked,
        )
        if tracked:
            tag("h2", "Clips tracked so far")
            work_table(tracked)
        tag("h2", "Tables measured elsewhere")
        tag("p", "Motion capture, encoders, DeepLabCut or SLEAP tracks turned into tables by linktwin convert.", "soft")
        link("Bring tables", f"/mechanisms/{id}/study", "act")
