"""From pictures of the board to a camera's lens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from backend.commands.terminal import AsJson, Out, answering, counting, folder_for, progress


def calibrate(
    pictures: Annotated[
        list[Path], typer.Argument(help="A clip of the kit's lens board, or photos of it.", exists=True, dir_okay=False)
    ],
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Measure a camera's lens from pictures of the kit's board: camera.json, for every clip at that setting."""
    with answering(as_json) as answer:
        from backend.report.camera_summary import camera_text

        folder = folder_for(out, pictures[0].stem)
        with progress("looking for the board") as advance:
            from backend.observe.calibrate_camera import calibrate_camera
            from backend.observe.camera import write_camera

            camera = calibrate_camera(pictures, progress=counting(advance))
        path = write_camera(camera, folder / "camera.json")
        report = {**camera.model_dump(mode="json"), "files": {"camera": str(path)}}
        answer(report, f'{camera_text(report)}\nwrote     {path}\nname it   "camera": "{path.name}" in the bed file')
