"""One study: its mechanism, its runs, and the question why they differ from the drawing."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from backend.mechanism.kinds import effect_kinds
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import decode, parse
from backend.mechanism.study import StudyFile
from backend.service.jobs.desk import start_job
from backend.service.jobs.requests import DiagnoseRequest, FitRequest, JamRequest
from backend.service.mechanisms import parse_drawing
from backend.service.page.drawing_view import facts_beside, staged
from backend.service.page.markup import button, choice, field, link, notice, tag, tick
from backend.service.page.shell import page, tell, view
from backend.service.page.stage import StageView
from backend.service.page.timeline import Timeline
from backend.service.page.work import deletion, work_on
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.studies import STUDY
from backend.service.things import delete_thing, file_of, find_thing

FREE = (
    ("coulomb_friction:*", "dry friction at every joint"),
    ("viscous_friction:*", "friction that grows with speed, at every joint"),
    ("clearance:*", "play in every pin"),
    ("camera_scale:camera", "scale of the picture"),
    ("camera_rotation:camera", "turn of the picture"),
)


def read_stored_study(service: Service, id: str) -> tuple[StudyFile, Mechanism]:
    """A stored study's own file and drawing; whose it is must have been asked before."""
    text = service.storage.read(file_of(service, id, STUDY).key).decode("utf-8-sig")
    file = parse(StudyFile, decode(text, STUDY), STUDY)
    return file, parse_drawing(service, service.storage.read(file_of(service, id, file.mechanism).key))


@page("/studies/{id}")
def study_view(service: Service, owner: str, id: str) -> None:
    """What was measured, and the questions that can be asked of it."""
    thing = find_thing(service, owner, "study", id)
    file, mechanism = read_stored_study(service, id)
    folder = file.mechanism.rpartition("/")[0]
    asked: dict[str, Any] = {
        "tolerance": "",
        "minutes": "",
        "without": "",
        "free": ["coulomb_friction:*"],
        "more": "",
        "loss": "linear",
    }
    with view(thing.name, [("Mechanisms", "/")], now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", thing.name)
                held = sum(one.use == "held_out" for one in file.experiments)
                tag("p", f"{len(file.experiments)} measured runs, {held} kept aside to test on.", "soft")
            with tag("div", look="actions"):
                link("Download", f"/files/studies/{id}/all.zip", "act")
                button("Diagnose", lambda: start("diagnose"), "act primary")
        said = tag("div", aria_live="polite")
        with Timeline(), tag("div", look="split"):
            StageView(staged(service, mechanism, "studies", id, folder), thing.name)
            beside = tag("div", look="panel", aria_live="polite")
            with beside:
                tag("p", "Counting loops and freedoms …", "note")
        tag("h2", "Runs")
        _runs(file)
        tag("h2", "Ask more")
        with tag(
            "div",
            look="split",
            style="grid-template-columns: repeat(auto-fit, minmax(min(100%, 320px), 1fr)); margin: 0",
        ):
            with tag("div", look="panel"):
                tag("h3", "Fit what you suspect")
                tag("p", "Values of effects that the drawing leaves out, with their intervals.", "note")
                for spec, words in FREE:
                    tick(words, spec in asked["free"], lambda on, s=spec: _switch(asked["free"], s, on))
                with tag("details"):
                    tag("summary", "More")
                    field("further: KIND:ON, comma separated", "", lambda t: asked.update(more=t))
                    losses = [("linear", "trust every sample"), ("huber", "shrug off outliers (Huber)"),
                              ("student", "shrug off many outliers (Student)")]  # fmt: skip
                    choice("noise", losses, "linear", lambda t: asked.update(loss=t))
                button("Fit", lambda: start("fit"))
            with tag("div", look="panel"):
                tag("h3", "Diagnose, with limits")
                field(
                    "differences you do not mind [mm]",
                    "",
                    lambda t: asked.update(tolerance=t),
                    "number",
                    min="0",
                    step="any",
                )
                field("longest search [minutes]", "", lambda t: asked.update(minutes=t), "number", min="0", step="any")
                field("effects that cannot be, comma separated", "", lambda t: asked.update(without=t), list="kinds")
                with tag("datalist", id="kinds"):
                    for kind in effect_kinds():
                        tag("option", value=kind)
                told = "Diagnose tries every effect of the library by itself; all fields may stay empty."
                tag("p", f"{told} A search ends after 40 minutes unless told; 0 sets no end.", "note")
            with tag("div", look="panel"):
                tag("h3", "Does it jam?")
                tag("p", "Every run let go from where it was measured, under the drawn effects.", "note")
                button("Look for jams", lambda: start("jam"))

        def start(kind: str) -> None:
            try:
                job = start_job(service, owner, _request(kind, id, asked))
            except Problem as problem:
                tell(problem, said)
                return
            except ValueError as error:
                said.clear()
                with said:
                    notice((str(error),), "bad")
                return
            ui.navigate.to(f"/jobs/{job.id}")

        work_on(service, owner, "study", id, "Answers so far")
        deletion("study", "Delete it and its tables", lambda: delete_thing(service, owner, "study", id))
    ui.timer(0.05, lambda: facts_beside(service, id, file.mechanism, beside), once=True)


def _runs(file: StudyFile) -> None:
    tables = {"tracks": "markers", "joint_positions": "encoders", "joint_efforts": "force sensors", "inputs": "drives"}
    with tag("div", look="scroll"), tag("table", look="plain"):
        with tag("thead"), tag("tr"):
            for head in ("run", "use", "measured", "let go"):
                tag("th", head, scope="col")
        with tag("tbody"):
            for run in file.experiments:
                with tag("tr"):
                    tag("td", run.id, "name")
                    tag("td", "kept aside" if run.use == "held_out" else "fitted")
                    tag("td", ", ".join(words for name, words in tables.items() if getattr(run, name)) or "–")
                    at = run.release
                    tag("td", f"at {at.time_s:g} s, from rest" if at.at_rest else f"at {at.time_s:g} s, in motion")


def _switch(chosen: list[str], spec: str, on: bool) -> None:
    if on and spec not in chosen:
        chosen.append(spec)
    elif not on and spec in chosen:
        chosen.remove(spec)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _request(kind: str, id: str, asked: dict[str, Any]) -> DiagnoseRequest | FitRequest | JamRequest:
    """The job that was asked for; ValueError in a sentence."""
    if kind == "jam":
        return JamRequest.model_validate({"kind": "jam", "study": id})
    if kind == "fit":
        free = [*asked["free"], *_words(asked["more"])]
        if not free:
            raise ValueError("Nothing is left open to fit; tick at least one effect.")
        return FitRequest.model_validate({"kind": "fit", "study": id, "free": free, "loss": asked["loss"]})
    without, known = _words(asked["without"]), effect_kinds()
    if wrong := [word for word in without if word not in known]:
        raise ValueError(f"{', '.join(wrong)}: no such effect. Choose from the list, for instance coulomb_friction.")
    tolerance, minutes = (float(asked[name]) if asked[name] else None for name in ("tolerance", "minutes"))
    return DiagnoseRequest.model_validate(
        {"kind": "diagnose", "study": id, "tolerance_mm": tolerance, "without": without, "minutes": minutes}
    )
