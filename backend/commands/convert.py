"""From a file of tracks to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, Out, answering, progress


def convert(
    file: Annotated[
        Path, typer.Argument(help="Tracks: CSV, DeepLabCut CSV or HDF5, SLEAP HDF5, TRC.", exists=True, dir_okay=False)
    ],
    mechanism: Annotated[Path, typer.Option(help="mechanism.json: names the markers.", exists=True, dir_okay=False)],
    bed: Annotated[
        Path | None,
        typer.Option(help="JSON: marks on the bed, in metres and pixels, or tags.", exists=True, dir_okay=False),
    ] = None,
    video: Annotated[
        Path | None, typer.Option(help="The clip that was tracked, for its clock.", exists=True, dir_okay=False)
    ] = None,
    fps: Annotated[float | None, typer.Option(help="Frames per second, where there is no clip.")] = None,
    filmed_at: Annotated[
        float | None,
        typer.Option(metavar="RATE", min=1.0, help="Frames a second of slow motion that does not note its rate."),
    ] = None,
    names: Annotated[str, typer.Option(help="theirs=ours,...: equal names need none; theirs= leaves one out.")] = "",
    to: Annotated[str, typer.Option(help="tracks, deeplabcut, sleap or trc.")] = "tracks",
    least_score: Annotated[
        float | None, typer.Option(help="Below it a point counts as hidden (0.6 DeepLabCut, 0.2 SLEAP).")
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Read tracks made by another tool, or write ours for one."""
    with answering(as_json) as answer:
        from backend.mechanism.read import read_mechanism
        from backend.report.track_summary import converted_text

        drawn = read_mechanism(mechanism)
        with progress("converting"):
            from backend.observe.exchange.convert import convert as converted

            result = converted(
                file,
                drawn,
                out_dir=out or Path("out") / file.stem,
                to=to,
                bed=bed,
                video=video,
                frames_per_s=fps,
                filmed_per_s=filmed_at,
                names=names,
                least_score=least_score,
            )
        files = [str(path) for path in result.files]
        wrote = "\n".join(f"wrote     {path}" for path in files)
        answer({**result.summary, "files": files}, f"{converted_text(result.summary)}\n{wrote}")
