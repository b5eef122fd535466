"""From a clip to tracks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import AsJson, Out, answering, counting, progress

TRACKS, PREVIEW = "tracks.csv", "preview.mp4"


def track(
    video: Annotated[Path, typer.Argument(help="The clip.", exists=True, dir_okay=False)],
    mechanism: Annotated[Path, typer.Option(help="mechanism.json: names the markers.", exists=True, dir_okay=False)],
    bed: Annotated[
        Path, typer.Option(help="JSON: marks on the bed, in metres and pixels, or tags.", exists=True, dir_okay=False)
    ],
    clicks: Annotated[
        Path | None, typer.Option(help="JSON: marker to pixel in the first frame.", exists=True, dir_okay=False)
    ] = None,
    targets: Annotated[
        Path | None,
        typer.Option(
            help="JSON: marker to the tag it carries in place of a dot; to 'texture': nothing is stuck there; to "
            "'dark': dots without a colour; or to 'patch': coloured areas of any shape.",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    cotracker: Annotated[
        Path | None,
        typer.Option(metavar="CHECKPOINT", help="CoTracker's weights, to say where textures went.", dir_okay=False),
    ] = None,
    keep_truncated: Annotated[
        bool, typer.Option("--keep-truncated", help="Measure the readable part of a clip that ends too early.")
    ] = False,
    start_s: Annotated[
        float, typer.Option("--from", metavar="SECONDS", min=0.0, help="Where to begin, as a player shows it.")
    ] = 0.0,
    end_s: Annotated[
        float | None, typer.Option("--to", metavar="SECONDS", min=0.0, help="Where to end, as a player shows it.")
    ] = None,
    filmed_at: Annotated[
        float | None,
        typer.Option(metavar="RATE", min=1.0, help="Frames a second of slow motion that does not note its rate."),
    ] = None,
    coast_s: Annotated[
        float,
        typer.Option(
            "--coast", metavar="SECONDS", min=0.0, help="Fill gaps up to this long with predictions, marked as such."
        ),
    ] = 0.0,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Measure where the markers went in a clip: tracks.csv and an annotated preview."""
    with answering(as_json) as answer:
        from backend.mechanism.read import read_mechanism
        from backend.report.track_summary import track_text

        folder = out or Path("out") / video.stem
        if server is not None:
            if cotracker is not None:
                raise ValueError("--cotracker names weights on this machine; a service has none: leave one out")
            done = done_there(
                server, key, mechanism, folder,
                lambda there, drawing, clip: there.track(
                    clip, drawing, bed=bed, clicks=clicks, targets=targets, from_s=start_s, to_s=end_s,
                    filmed_per_s=filmed_at, keep_truncated=keep_truncated, coast_s=coast_s,
                ),
                study=False, clip=video,
            )  # fmt: skip
            if done.report is not None:
                done.report["files"] = _files(folder)
            done.tell(answer, track_text, PREVIEW)
            return
        drawn = read_mechanism(mechanism)
        with progress("opening the clip") as advance:
            from backend.observe.measure import track_video
            from backend.observe.video import Part

            result = track_video(
                video,
                drawn,
                bed,
                out_dir=folder,
                clicks=clicks,
                targets=targets,
                checkpoint=cotracker,
                keep_truncated=keep_truncated,
                part=Part(start_s, math.inf if end_s is None else end_s, filmed_at),
                coast_s=coast_s,
                progress=counting(advance),
            )
        files = _files(folder)
        written = f"wrote     {files['tracks']}\nopen      {files['preview']}"
        answer({**result.summary, "files": files}, f"{track_text(result.summary)}\n{written}")


def _files(folder: Path) -> dict[str, str]:
    return {"tracks": str(folder / TRACKS), "preview": str(folder / PREVIEW)}
