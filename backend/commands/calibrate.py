"""From pictures of the board, or of the mechanism on its bed, to a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, Out, answering, counting, folder_for, progress


def calibrate(
    pictures: Annotated[
        list[Path],
        typer.Argument(
            help="A clip of the kit's lens board, or photos of it; with --mechanism and --bed a clip of both.",
            exists=True,
            dir_okay=False,
        ),
    ],
    mechanism: Annotated[
        Path | None,
        typer.Option(help="mechanism.json: whose bars stand in for the board.", exists=True, dir_okay=False),
    ] = None,
    bed: Annotated[
        Path | None, typer.Option(help="JSON: tags or marks on the bed.", exists=True, dir_okay=False)
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Measure a camera's lens from pictures of the kit's board: camera.json, for every clip at that setting.

    Without a board: --mechanism and --bed, and a clip of the moving mechanism; the camera's pose and the dots' heights
    are found with the lens.
    """
    with answering(as_json) as answer:
        from backend.report.camera_summary import camera_text

        if (mechanism is None) != (bed is None):
            raise ValueError("--mechanism and --bed go together: its bars and the bed's tags stand in for the board")
        if mechanism is not None and len(pictures) != 1:
            raise ValueError(f"{len(pictures)} files are given; one clip of the moving mechanism is what bars need")
        folder = folder_for(out, pictures[0].stem)
        with progress("looking for the board" if bed is None else "following the dots") as advance:
            from backend.observe.camera import write_camera

            if mechanism is not None and bed is not None:
                from backend.mechanism.read import read_mechanism
                from backend.observe.without_board import calibrate_from_clip

                camera = calibrate_from_clip(
                    pictures[0], read_mechanism(mechanism), bed, out_dir=folder, progress=counting(advance)
                )
            else:
                from backend.observe.calibrate_camera import calibrate_camera

                camera = calibrate_camera(pictures, progress=counting(advance))
        path = write_camera(camera, folder / "camera.json")
        report = {**camera.model_dump(mode="json"), "files": {"camera": str(path)}}
        answer(report, f'{camera_text(report)}\nwrote     {path}\nname it   "camera": "{path.name}" in the bed file')
