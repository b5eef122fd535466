"""What came of each kind of job: words and numbers beside linked pictures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from backend.report.gap_words import parameter_name
from backend.report.quantity import measured, prefixed, shown
from backend.service.page.film import Film, film_tracks
from backend.service.page.markup import drawn as markup
from backend.service.page.markup import facts, figures, link, notice, tag
from backend.service.page.running import brought
from backend.service.page.stage import Drawn, StageView
from backend.service.page.timeline import charts, groups
from backend.service.records import Job
from backend.service.service import Service
from backend.service.things import file_of, files_of

Told = Mapping[str, Any]
BADGES = {
    "none": "none",
    "identified": "",
    "ambiguous": "ambiguous",
    "approximate": "approximate",
    "unknown": "unknown",
}


TRACKED = (
    ("frames", "frames", "", 1.0),
    ("frames_per_s", "filmed at", "a second", 1.0),
    ("begins_s", "from", "s", 1.0),
    ("duration_s", "for", "s", 1.0),
    ("metres_per_px", "a pixel is", "mm", 1e3),
    ("dot_radius_px", "radius of a dot", "px", 1.0),
    ("sigma_m", "a place is known to", "mm", 1e3),
    ("calibration_sd_m", "and the scale's share of it", "mm", 1e3),
    ("mark_residual_px", "marks are missed by", "px", 1.0),
    ("dots_not_drawn", "dots the drawing lacks", "", 1.0),
)


def _stage(drawn: Drawn | None, told: Told, address: str, title: str, **rest: Any) -> None:
    if drawn is None:
        notice(("The mechanism was deleted since; the charts and numbers below are complete.",), "warn")
    else:
        StageView(drawn, title, replay=address if told["motions"] else None, calm=True, **rest)


def simulation(report: Told, told: Told, drawn: Drawn | None, address: str) -> None:
    """The drawing let go."""
    notice([told["story"]["result"]] if told["story"]["result"] not in ("", "done") else [], "warn")
    with tag("div", style="margin-top: 14px"):
        _stage(drawn, told, address, "The motion")
    _charts(told)


def jam(report: Told, told: Told, drawn: Drawn | None, address: str) -> None:
    """Whether it jams, where, and what the joints carry."""
    if report:
        tag("p", report["sentence"], "lead")
    notice(told["story"]["cautions"], "warn")
    figures(told["story"]["figures"])
    onset = report.get("onset_s") if report.get("jammed") else None
    heat = {at: 1.0 for at in report.get("at", ())} if report.get("jammed") else {}
    _stage(drawn, told, address, "Joint forces along the motion", heat=heat, start_s=onset)
    tag(
        "p",
        "Arrows: what each joint puts on its body B; the longest is the strongest force but for rare blows.",
        "note",
    )
    _charts(told)


def fit(report: Told, told: Told, drawn: Drawn | None, address: str) -> None:
    """What was fitted, how surely, and the twin beside what was measured."""
    story = told["story"]
    tag("p", story["headline"], "lead")
    notice(story["cautions"], "warn")
    figures(story["figures"])
    tag("h2", "Values")
    _parameters(report["parameters"])
    tag("h2", "Measured and twin")
    _stage(drawn, told, address, "Measured, as drawn, and fitted")
    _charts(told)


def gap(report: Told, told: Told, drawn: Drawn | None, address: str) -> None:
    """Is there a gap, where, what is it, how far does it shrink, what to do next."""
    story = told["story"]
    with tag("div", look="verdict"):
        tag("span", story["badge"], f"badge {BADGES.get(report['verdict'], '')}")
        tag("p", report["sentence"], "lead")
    tag("p", story["meaning"], "soft")
    figures(story["figures"])
    heat = {place["at"]: place["probability"] for place in story["places"]}
    with tag("div", look="split"):
        _stage(drawn, told, address, "Where the gap lies, and the motion with and without it", heat=heat)
        with tag("div", look="stack"):
            if story["places"]:
                with tag("div", look="panel"):
                    tag("h3", "Where it lies")
                    _bars(story["places"])
            with tag("div", look="panel"):
                tag("h3", "What it may be")
                for cause in story["causes"]:
                    _cause(cause)
    if story["next"]:
        with tag("div", look="panel", style="margin-top: 14px; border-left: 4px solid var(--after)"):
            tag("h3", "What to do next")
            tag("p", story["next"])
    _charts(told)
    if story["shrink"]:
        tag("h2", "How far the gap shrinks")
        with tag("div", look="charts"):
            for bars in story["shrink"]:
                markup(bars)
    if story["detectable"]:
        with tag("details"):
            tag("summary", f"The smallest amounts that could have been seen: {len(story['detectable'])}")
            with tag("div", look="scroll"), tag("table", look="plain"), tag("tbody"):
                for name, on, least in story["detectable"]:
                    with tag("tr"):
                        tag("td", name, "name")
                        tag("td", on)
                        tag("td", least, "n")
    if story.get("inseparable"):  # results of older versions have none
        with tag("details"):
            tag("summary", f"Groups of effects that these data cannot tell apart: {len(story['inseparable'])}")
            with tag("ul"):
                for line in story["inseparable"]:
                    tag("li", line)
    if report["warnings"]:
        tag("h2", "What these data cannot say")
        notice(report["warnings"], "warn")


VIEWS: dict[str, Callable[[Told, Told, Drawn | None, str], None]] = {
    "simulate": simulation, "jam": jam, "fit": fit, "diagnose": gap,
}  # fmt: skip


def tracking(service: Service, job: Job, base: str, film: str | None) -> None:
    """The clip with its tracks; film: where the clip lies, None for whoever may see the preview alone."""
    told = json.loads(service.storage.read(file_of(service, job.id, "report.json").key))
    path = brought(service, job.id, "tracks.csv")
    preview = base + "preview.mp4"
    filmed = files_of(service, job.request["video"]) if film is not None else []
    clip = f"{film}{filmed[0].path}" if filmed else preview  # the clip may have been deleted since
    notice(told.get("warnings", []), "warn")
    with tag("div", look="split"):
        Film(clip, preview, film_tracks(path), told.get("begins_s", 0.0), told.get("slower", 1.0))
        with tag("div", look="panel"):
            tag("h3", "How well it went")
            facts(_track_facts(told))
            tag("p", "Green: seen. Orange: partly covered. Red: hidden.", "note")


def _track_facts(told: Told) -> list[tuple[str, str]]:
    rows = []
    for key, name, unit, factor in TRACKED:
        if (value := told.get(key)) is not None:
            rows.append((name, f"{value if isinstance(value, int) else shown(factor * value)} {unit}".strip()))
    return rows


def written_page(there: set[str], base: str) -> None:
    """A result that is a page of its own."""
    for path in sorted(path for path in there if path.endswith(".html")):
        tag("iframe", look="panel", src=base + path, title="The report", sandbox="allow-scripts",
            style="width: 100%; height: 76vh; padding: 0")  # fmt: skip


def file_list(service: Service, job: Job, base: str) -> None:
    """Every file to download or open."""
    files = files_of(service, job.id)
    if not files:
        return
    tag("h2", "Files")
    with tag("div", look="scroll"), tag("table", look="plain"), tag("tbody"):
        for file in files:
            with tag("tr"):
                with tag("td", look="name"):
                    link(file.path, base + file.path, target="_blank")
                tag("td", MEANT.get(file.path.rpartition("/")[2], ""))
                tag("td", _size(file.bytes), "n")


MEANT = {
    "gap.json": "the gap report, for programs", "gap.html": "the gap report as one page, to mail or print",
    "fit.json": "the fit, for programs", "fit.html": "the fit as one page", "jam.json": "the jam report, for programs",
    "jam.html": "the jam report as one page", "pictures.json": "motions and charts of this view",
    "report.json": "what the command answered", "tracks.csv": "where every marker was, for a study",
    "tracking.json": "how the tracking went", "preview.mp4": "the clip with every dot circled",
    "run.h5": "the motion, every node", "forces.csv": "joint forces over time",
    "simulation.html": "the motion as one page", "forces.html": "joint forces as one page",
}  # fmt: skip


def _size(count: int) -> str:
    return f"{count} B" if count < 1000 else f"{count / 1e3:.0f} kB" if count < 1e6 else f"{count / 1e6:.1f} MB"


def _charts(told: Told) -> None:
    for group in groups(told["charts"]):
        tag("h2", group)
        charts(told["charts"], group)


def _parameters(rows: Sequence[Told]) -> None:
    with tag("div", look="scroll"), tag("table", look="plain"):
        with tag("thead"), tag("tr"):
            for head, look in (("effect", ""), ("parameter", ""), ("value", "n"), ("95% interval", "n"), ("", "")):
                tag("th", head, look, scope="col")
        with tag("tbody"):
            for p in rows:
                _parameter(p)


def _parameter(p: Told) -> None:
    on = p["on"] if isinstance(p["on"], str) else ", ".join(p["on"])
    unit, factor = prefixed(abs(p["value"]) or (p["sd"] or 0.0), p["unit"])
    sd = None if p["sd"] is None else factor * p["sd"]
    low, high = p["ci95"] or (None, None)
    span = (
        f"{shown(factor * low, 4)} … {shown(factor * high, 4)}"
        if low is not None and high is not None
        else "not bounded"
    )
    with tag("tr"):
        tag("td", p["kind"].replace("_", " ") + f" at {on}", "name")
        tag("td", parameter_name(p["parameter"]))
        tag("td", f"{measured(factor * p['value'], sd)} {unit}", "n")
        tag("td", span, "n")
        tag("td", "at its bound" if p["at_bound"] else "")


def _bars(rows: Sequence[Told]) -> None:
    with tag("ul", look="places"):
        for row in rows:
            with tag("li"), tag("button", look="ranked", type="button", data_part=row.get("at")):
                tag("span", row["name"])
                with tag("span", look="track"):
                    tag("i", style=f"width: {100 * row['probability']:.1f}%")
                tag("b", row["percent"], "share")


def _cause(cause: Told) -> None:
    with tag("div", look="cause"):
        with tag("div", look="ranked"):
            tag("b", cause["name"])
            with tag("span", look="track"):
                tag("i", style=f"width: {100 * cause['probability']:.1f}%")
            tag("b", cause["percent"], "share")
        for what, much in cause["amounts"]:
            tag("p", f"{what}: {much}" if what else much)
        if cause["alike"]:
            tag("p", f"These data cannot tell it from {'; '.join(cause['alike'])}.", "soft note")
        if cause["note"]:
            tag("p", cause["note"], "soft note")
