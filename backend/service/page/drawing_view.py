"""What was drawn: the mechanism on stage, with its parts, loops, mobility and warnings beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from backend.mechanism.mechanism import Mechanism
from backend.service.page.late import ROOT
from backend.service.page.markup import facts, notice, tag
from backend.service.page.running import checked
from backend.service.page.shell import tell
from backend.service.page.stage import Drawn, on_stage
from backend.service.problems import Problem
from backend.service.service import Service
from backend.service.things import files_of


def staged(service: Service, mechanism: Mechanism, room: str, id: str, folder: str = "", shared: str = "") -> Drawn:
    """A stored drawing for the stage.

    folder: where its mechanism.json lies among the files. shared: JOB/TOKEN of a link.
    """
    there = {file.path for file in files_of(service, id)}
    base = f"{ROOT}/shared-files/{shared}/subject/" if shared else f"{ROOT}/files/{room}/{id}/"

    def address(uri: str) -> str | None:
        path = f"{folder}/{uri}".lstrip("/") if folder else uri
        return base + quote(path) if path in there else None

    return on_stage(mechanism, address)


async def facts_beside(service: Service, thing: str, drawing: str, where: Any) -> None:
    """Fill a panel with what `linktwin check` says; it takes a second and is fetched after the view stands."""
    try:
        report = await checked(service, thing, drawing)
    except Problem as problem:
        tell(problem, where)
        return
    where.clear()
    with where:
        mobility = report["mobility"]
        freedoms = mobility["by_rank"]
        tag("h2", f"{freedoms} {'freedom' if freedoms == 1 else 'freedoms'}")
        facts(_counts(report))
        notice(report["errors"], "bad", "It cannot be built as drawn" if report["errors"] else "")
        notice(report["warnings"], "warn")
        if not report["errors"] and not report["warnings"]:
            notice((), "good", "All joints meet; nothing to warn of.")
        if report["loops"]:
            with tag("details"):
                tag("summary", f"Loops: {len(report['loops'])}")
                with tag("ul", look="parts"):
                    for loop in report["loops"]:
                        tag("li", " – ".join(loop["joints"]), "code")


def _counts(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    mobility = report["mobility"]
    rows = [
        ("moving bodies", str(report["moving_bodies"])),
        ("joints", ", ".join(f"{count} {type}" for type, count in sorted(report["joints"].items())) or "none"),
        ("loops", str(len(report["loops"]))),
        ("joints and masses span", f"{report['size_mm']:.0f} mm"),
        ("freedoms by rank", str(mobility["by_rank"])),
    ]
    if mobility["by_count_in_plane"] is not None:
        rows.append(("by count in the plane", str(mobility["by_count_in_plane"])))
    rows.append(("by count in space", str(mobility["by_count_in_space"])))
    if mobility["redundant_rows"]:
        rows.append(("redundant conditions", f"{mobility['redundant_rows']} of {mobility['rows']}"))
    gap = max((row["gap_mm"] for row in report["closure"]), default=0.0)
    rows.append(("joints open by", f"{gap:.2g} mm" if gap > 1e-9 else "0 mm"))
    return rows


def parts(mechanism: Mechanism) -> None:
    """Joints, bodies and markers as lists whose entries light up on the stage."""
    with tag("div", look="panel"):
        tag("h3", f"Joints: {len(mechanism.joints)}")
        with tag("ul", look="parts"):
            for joint in mechanism.joints:
                loose = joint.fit.clearance_m() if joint.fit else None
                told = f"{joint.type}, {joint.body_a} – {joint.body_b}" + (
                    f", {1e6 * loose:.0f} µm loose" if loose else ""
                )
                _part(f"joint:{joint.id}", joint.id, told)
        tag("h3", f"Bodies: {len(mechanism.bodies)}")
        with tag("ul", look="parts"):
            for body in mechanism.bodies:
                mass = f"{1e3 * body.inertial.mass_kg:.4g} g" if body.inertial else ""
                _part(f"body:{body.id}", body.id, "fixed" if body.fixed else mass)
        if mechanism.markers:
            tag("h3", f"Markers: {len(mechanism.markers)}")
            with tag("ul", look="parts"):
                for marker in mechanism.markers:
                    _part(f"marker:{marker.id}", marker.id, f"on {marker.body}")
        if mechanism.effects:
            tag("h3", "Effects already in the drawing")
            with tag("ul", look="parts"):
                for effect in mechanism.effects:
                    on = effect.on if isinstance(effect.on, str) else ", ".join(effect.on)
                    _part("", effect.id, f"{effect.kind.replace('_', ' ')} at {on}")


def _part(part: str, name: str, told: str) -> None:
    with tag("li"), tag("button", type="button", data_part=part or None):
        tag("b", name)
        tag("span", told)
