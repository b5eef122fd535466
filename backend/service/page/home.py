"""The first view: your mechanisms and studies, a place to drop one, samples to begin with."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nicegui import ui

from backend.mechanism.body import SURFACES
from backend.service.intake.folder import unpack
from backend.service.mechanisms import DRAWING, load_mechanism, store_mechanism
from backend.service.page.markup import drawn, empty, link, tag
from backend.service.page.samples import Sample, outline, outline_of, samples, store_sample
from backend.service.page.shell import page, tell, view
from backend.service.page.upload import drop_zone
from backend.service.page.work import ago
from backend.service.problems import Problem
from backend.service.records import Thing
from backend.service.service import Service
from backend.service.studies import STUDY, store_study
from backend.service.things import list_things

SHOWN = 24


@page("/")
def home(service: Service, owner: str) -> None:
    """Mechanisms, newest first; samples below, or alone where nothing is stored yet."""
    own = list_things(service, owner, "mechanism", SHOWN)
    studied = list_things(service, owner, "study", SHOWN)
    with view("Mechanisms", now="/"):
        with tag("div", look="headline", style="padding-top: 26px"), tag("div"):
            tag("h1", "Why does the real one differ from the drawing?")
            tag(
                "p",
                "Bring a mechanism, film it, and see where its motion leaves the drawing, which effect is missing and "
                "how surely that is known.",
                "lead soft",
            )
        if studied.rows:
            tag("h2", "Studies")
            with tag("div", look="cards"):
                for thing in studied.rows:
                    _card(thing, f"/studies/{thing.id}", _runs(thing.summary))
        if own.rows:
            tag("h2", "Mechanisms")
            with tag("div", look="cards"):
                for thing in own.rows:
                    _card(
                        thing,
                        f"/mechanisms/{thing.id}",
                        _parts(thing.summary),
                        load_mechanism(service, owner, thing.id),
                    )
        if own.rows or studied.rows:
            _bring(service, owner, True)
            _samples(service, owner)
        else:
            _samples(service, owner)
            _bring(service, owner, False)


def _bring(service: Service, owner: str, primary: bool) -> None:
    tag("h2", "Bring your own")

    async def taken(files: Mapping[str, Path]) -> None:
        thing = await asyncio.to_thread(_store, service, owner, files)
        ui.navigate.to(f"/{'studies' if thing.kind == 'study' else 'mechanisms'}/{thing.id}")

    drop_zone(
        service,
        "Drop mechanism.json and its meshes here",
        "As linktwin export or the Fusion add-in wrote them: the files together, or one zip of the folder. A "
        "study.json with its tables is taken too.",
        f".json,{','.join(SURFACES)},.zip,.csv,.parquet,.mp4,.mov",
        taken,
        primary=primary,
    )


def _samples(service: Service, owner: str) -> None:
    tag("h2", "Samples")
    said = tag("div", aria_live="polite")
    with tag("div", look="cards"):
        for sample in samples():
            _sample(service, owner, sample, said)


def _card(thing: Thing, address: str, words: str, mechanism: Any = None) -> None:
    with link("", address, "card"):
        if mechanism is not None:
            drawn(outline_of(mechanism), "figure")
        with tag("div", look="words"):
            tag("b", thing.name)
            tag("span", words)
            tag("span", f"brought {ago(thing.created)}")


def _sample(service: Service, owner: str, sample: Sample, said: Any) -> None:
    async def open_it() -> None:
        said.clear()
        with said, empty(f"Fetching {sample.title} …", "The first time CadQuery draws its meshes: some seconds."):
            gauge = tag("div", look="gauge busy", role="progressbar", style="width: 60%")
        with gauge:
            tag("i")
        try:
            thing = await store_sample(service, owner, sample.name)
        except Problem as problem:
            tell(problem, said)
            return
        ui.navigate.to(f"/{'studies' if thing.kind == 'study' else 'mechanisms'}/{thing.id}")

    card = tag("button", look="card", type="button", data_sample=sample.name).on("click", open_it)
    with card:
        drawn(outline(sample.name), "figure")
        with tag("div", look="words"):
            tag("b", sample.title)
            tag("span", sample.words)
            if sample.measured:
                tag(
                    "span",
                    f"with {sample.measured} measured runs: begin here",
                    style="color: var(--after); font-weight: 600",
                )


def _parts(summary: dict[str, Any]) -> str:
    return f"{summary['bodies']} bodies, {summary['joints']} joints, {len(summary['markers'])} markers"


def _runs(summary: dict[str, Any]) -> str:
    held = sum(one["use"] == "held_out" for one in summary["experiments"])
    runs = len(summary["experiments"])
    return f"{runs} {'run' if runs == 1 else 'runs'}, {held} held out; {summary['bodies']} bodies"


def _store(service: Service, owner: str, files: Mapping[str, Path]) -> Thing:
    given = dict(files)
    archives = [name for name in given if name.lower().endswith(".zip")]
    if archives:
        if len(given) > 1:
            raise Problem("invalid", "A zip came with other files; send the zip alone, or the files without it.")
        archive = given[archives[0]]
        into = archive.with_name("unpacked")
        into.mkdir()
        given = unpack(archive, into, service.settings)
    else:
        given = {_placed(name): path for name, path in given.items()}
    if any(name.rpartition("/")[2] == STUDY for name in given):
        return store_study(service, owner, given)
    if len(given) == 1 and not any(name.rpartition("/")[2] == DRAWING for name in given):
        (only,) = given
        if only.endswith(".json"):
            given = {DRAWING: given[only]}
    return store_mechanism(service, owner, given)


def _placed(name: str) -> str:
    """A browser sends names without folders; exporters put meshes into meshes/."""
    return f"meshes/{name}" if name.lower().endswith(SURFACES) else name
