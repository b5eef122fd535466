"""The script that a STEP file begins with: its parts, the ground guessed, and the proposed joints to be confirmed."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from backend.mechanism.drawing_error import DrawingError
from cad_export.assembly import CadPart
from cad_export.drawing import Drawing
from cad_export.picture import proposal_svg
from cad_export.proposal import Proposal

PICTURE, SCRIPT = "proposal.svg", "design.py"


@dataclass(frozen=True)
class Begun:
    """What was written for the user to look at and correct.

    script: None where the user has one already.  lost: what a STEP file did not bring along.
    """

    picture: Path
    script: Path | None
    proposed: Sequence[Proposal]
    lost: Sequence[str] = ()

    def json(self) -> dict[str, object]:
        """The same as a report."""
        return {
            "picture": str(self.picture),
            "script": self.script and str(self.script),
            "proposed": [one.json() for one in self.proposed],
            "lost": list(self.lost),
        }

    def text(self) -> str:
        """The same for a terminal, with what to do next."""
        told = [f"lost      {what}" for what in self.lost]
        told += [f"proposed  {one.sentence()}" for one in self.proposed] or [
            "proposed  0 joints: no pin stands in a hole"
        ]
        told.append(f"look at   {self.picture}")
        if self.script:
            told.append(f"correct   {self.script}: ground, density, joints; then: linktwin export {self.script}")
        else:
            told.append('confirm   in the script: drawing.confirm("ID"), or declare the joint yourself')
        return "\n".join(told)


def propose(drawing: Drawing, out_dir: str | Path) -> Begun:
    """Write the picture of what a drawing's cylinders suggest."""
    proposed = drawing.propose()
    open_ones = sum(one.declared is None for one in proposed)
    title = f"{drawing.name}: {open_ones} of {len(proposed)} proposed joints are open"
    picture = Path(out_dir) / PICTURE
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_text(proposal_svg(drawing.parts, proposed, title), "utf-8")
    return Begun(picture, None, proposed)


def begin(step_path: str | Path, out_dir: str | Path) -> Begun:
    """Write a picture and a script for a STEP file; DrawingError where the script exists, which may be corrected."""
    script = Path(out_dir) / SCRIPT
    if script.exists():
        raise DrawingError(
            f"exists and may hold corrections; run `linktwin export {script}`, or choose another --out", str(script)
        )
    drawing = Drawing.from_step(step_path)
    begun = propose(drawing, out_dir)
    script.write_text(_script(Path(step_path), script, drawing, begun.proposed), "utf-8")
    return Begun(begun.picture, script, begun.proposed, drawing.lost)


def _script(step: Path, script: Path, drawing: Drawing, proposed: Sequence[Proposal]) -> str:
    where = os.path.relpath(step.resolve(), script.resolve().parent)
    ground = max(drawing.parts.values(), key=_extent).path
    confirmed = [
        f"    drawing.confirm({_quoted(one.id)})" + (f"  # {one.remark}" if one.remark else "")
        for one in proposed
    ]  # fmt: skip
    return "\n".join([
        f'"""{step.name}: what stands still, what it weighs, and which of the proposed joints are right."""',
        "",
        "from pathlib import Path",
        "",
        "from cad_export import Drawing",
        "",
        "",
        "def design(density_kg_per_m3: float = 7850.0) -> Drawing:",
        f"    drawing = Drawing.from_step(Path(__file__).parent / {_quoted(where)})",
        f"    drawing.ground({_quoted(ground)})  # a guess: the largest part",
        "    drawing.material(density_kg_per_m3=density_kg_per_m3)  # a guess: steel, for every part",
        *(confirmed or ["    # no joint was proposed: drawing.revolute(...), see docs/cad_export.md"]),
        "    return drawing",
        "",
    ])  # fmt: skip


def _extent(part: CadPart) -> float:
    return part.shape.BoundingBox().DiagonalLength


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
