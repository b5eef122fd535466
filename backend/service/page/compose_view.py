"""Runs become a study: which are fitted, which are kept aside to test on, when each was let go."""

from __future__ import annotations

import asyncio
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from nicegui import ui

from backend.service.jobs.desk import list_jobs
from backend.service.mechanisms import DRAWING
from backend.service.page.markup import button, empty, enable, notice, tag
from backend.service.page.running import brought
from backend.service.page.runs import Run, kind_of, released
from backend.service.page.shell import page, tell, view
from backend.service.page.upload import drop_zone
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.service import Service
from backend.service.studies import STUDY, store_study
from backend.service.things import files_of, find_thing


@page("/mechanisms/{id}/study")
async def compose_view(service: Service, owner: str, id: str) -> None:
    """Tracked clips stand there already; tables can be added."""
    thing = find_thing(service, owner, "mechanism", id)
    folder = tempfile.TemporaryDirectory(dir=service.settings.scratch)
    ui.context.client.on_delete(folder.cleanup)
    runs = await asyncio.to_thread(_tracked, service, owner, id, Path(folder.name))
    trail = [("Mechanisms", "/"), (thing.name, f"/mechanisms/{id}"), ("Measure", f"/mechanisms/{id}/measure")]
    with view("New study", trail, now="/"):
        with tag("div", look="headline"):
            with tag("div"):
                tag("h1", "Make a study of the runs")
                tag(
                    "p",
                    "Fitted runs teach; runs kept aside are only predicted and show whether what was learnt is true.",
                    "soft",
                )
            with tag("div", look="actions"):
                go = button("Save the study", lambda: save(), "act primary")
        said = tag("div", aria_live="polite")
        table = tag("div")
        advice = tag("div", aria_live="polite")

        def show() -> None:
            table.clear()
            enable(go, bool(runs))
            with table:
                _table(runs, advise) if runs else empty("No runs yet", "Bring tables below, or track a clip first.")
            advise()

        def advise() -> None:
            advice.clear()
            used = [run for run in runs if run.chosen]
            with advice:
                if runs and all(run.held_out for run in used):
                    notice(("No run is fitted: nothing could be learnt. Fit one or more.",), "warn")
                elif used and not any(run.held_out for run in used):
                    notice(
                        ("No run is kept aside: how far the gap shrinks could not be tested. Keep one or two aside.",),
                        "warn",
                    )

        async def taken(files: Mapping[str, Path]) -> None:
            for name, path in files.items():
                kind = kind_of(path, name)
                own = Path(folder.name) / f"{len(runs)}-{kind}.csv"
                await asyncio.to_thread(shutil.copyfile, path, own)
                at = await asyncio.to_thread(released, own, kind)
                runs.append(Run(_free_name(Path(name).stem, runs), kind, str(own), at, held_out=len(runs) > 1))
            show()

        async def save() -> None:
            try:
                study = await asyncio.to_thread(_store, service, owner, id, thing.name, runs)
            except Problem as problem:
                tell(problem, said)
                return
            ui.navigate.to(f"/studies/{study.id}")

        show()
        tag("h2", "Add tables")
        drop_zone(
            service,
            "Drop tables of runs here",
            "CSV with time_s, marker, x_m, y_m, z_m (tracks) or time_s, joint, q (encoders); one file a run.",
            ".csv",
            taken,
            primary=not runs,
        )


def _table(runs: list[Run], changed: Callable[[], None]) -> None:
    with tag("div", look="scroll"), tag("table", look="plain"):
        with tag("thead"), tag("tr"):
            for head in ("run", "measured by", "let go at [s]", "use"):
                tag("th", head, scope="col")
        with tag("tbody"):
            for run in runs:
                _row(run, changed)


def _row(run: Run, changed: Callable[[], None]) -> None:
    words = {"tracks": "markers", "joint_positions": "encoders", "joint_efforts": "force sensors", "inputs": "drives"}
    with tag("tr"):
        with tag("td", look="name"):
            tag("span", run.id)
        tag("td", words[run.table])
        with tag("td"):
            now = "" if run.released_s is None else run.released_s
            at = tag(
                "input", look="in", type="number", step="any", style="width: 110px", value=now,
                aria_label=f"{run.id} let go at", placeholder="in motion",
            )  # fmt: skip
            at.on(
                "input", lambda e: setattr(run, "released_s", _number(e.args)), js_handler="(e) => emit(e.target.value)"
            )
        with tag("td"):
            use = tag("select", look="in", aria_label=f"use of {run.id}")
            with use:
                chosen = "none" if not run.chosen else "held_out" if run.held_out else "fit"
                for key, text in (("fit", "fit"), ("held_out", "keep aside to test"), ("none", "leave out")):
                    tag("option", text, value=key, selected=True if key == chosen else None)

            def used(event: Any) -> None:
                run.chosen, run.held_out = event.args != "none", event.args == "held_out"
                changed()

            use.on("change", used, js_handler="(e) => emit(e.target.value)")


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _free_name(stem: str, runs: list[Run]) -> str:
    stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in stem) or "run"
    taken = {run.id for run in runs}
    return next(name for n in range(1, 10_000) if (name := stem if n == 1 else f"{stem}_{n}") not in taken)


def _tracked(service: Service, owner: str, mechanism: str, folder: Path) -> list[Run]:
    """A run of every clip that was tracked for this mechanism, oldest first."""
    runs: list[Run] = []
    for job in reversed(list_jobs(service, owner, 100, state="succeeded").rows):
        if job.kind != "track" or job.request.get("mechanism") != mechanism:
            continue
        path = brought(service, job.id, "tracks.csv")
        try:
            name = find_thing(service, owner, "video", job.request["video"]).name
        except Problem:
            name = "a deleted clip"  # its tracks are there all the same
        runs.append(
            Run(_free_name(Path(name).stem, runs), "tracks", str(path), released(path, "tracks"), len(runs) > 1)
        )
    return runs


def _store(service: Service, owner: str, mechanism: str, name: str, runs: list[Run]) -> Thing:
    """The study of the chosen runs, with a drawing of its own; Problem with every fault."""
    files = {file.path: brought(service, mechanism, file.path) for file in files_of(service, mechanism)}
    experiments = []
    for number, run in enumerate((run for run in runs if run.chosen), start=1):
        path = f"runs/{number}.csv"
        files[path] = Path(run.source)
        release = {"time_s": run.released_s, "at_rest": True}
        if run.released_s is None:
            release = {"time_s": 0.0, "at_rest": False}
        use = "held_out" if run.held_out else "fit"
        experiments.append({"id": run.id, "use": use, run.table: path, "release": release})
    if not experiments:
        raise Problem("invalid", "Every run is left out; choose at least one to fit.")
    with tempfile.TemporaryDirectory(dir=service.settings.scratch) as scratch:
        told = Path(scratch) / STUDY
        document = {"schema_version": "1.0", "mechanism": DRAWING, "experiments": experiments}
        told.write_text(json.dumps(document), encoding="utf-8")
        return store_study(service, owner, {**files, STUDY: told}, name)
