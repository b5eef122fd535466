"""One picture of a clip."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, answering


def still(
    video: Annotated[Path, typer.Argument(help="The clip.", exists=True, dir_okay=False)],
    part: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of the clip: 0 its first picture, 1 its last.")] = 0.0,
    start_s: Annotated[
        float, typer.Option("--from", metavar="SECONDS", min=0.0, help="Leave out what a player shows before.")
    ] = 0.0,
    out: Annotated[Path, typer.Option(help="The PNG to write.", dir_okay=False)] = Path("still.png"),
    as_json: AsJson = False,
) -> None:
    """Write one picture of a clip, upright and in its own size, as PNG: to read pixels off for marks and clicks."""
    with answering(as_json) as answer:
        from backend.observe.stills import still as one

        time_s, png, (width, height) = one(video, part, start_s)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(png)
        report = {"time_s": time_s, "width_px": width, "height_px": height, "picture": str(out)}
        answer(report, f"{width} x {height} px at {time_s:.3f} s\nwrote     {out}")
