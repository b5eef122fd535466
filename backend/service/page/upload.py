"""A place to drop files on, or to press: what is taken, how far the upload is, and what is wrong with it."""

from __future__ import annotations

import tempfile
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from nicegui import events, ui

from backend.service.logs import logger
from backend.service.page.markup import notice, tag
from backend.service.page.shell import tell
from backend.service.problems import Problem, disk_full
from backend.service.service import Service

Taken = Callable[[Mapping[str, Path]], Awaitable[None]]


def told(error: Exception) -> Problem:
    """An error on the way of an upload as a problem; one of the service's own is logged."""
    if isinstance(error, Problem):
        return error
    if isinstance(error, OSError) and (full := disk_full(error)) is not None:
        return full
    logger().error("an upload failed", exc_info=error)
    return Problem("internal", "The service failed at this; its log says where. Try again, or tell us.")


def drop_zone(
    service: Service, title: str, sentence: str, accept: str, taken: Taken, *, many: bool = True, primary: bool = True
) -> None:
    """Show it; `taken` is given the files by name, lying on this machine until it returns. It may raise Problem."""
    said = tag("div", aria_live="polite")

    async def arrived(event: events.MultiUploadEventArguments) -> None:
        said.clear()
        with said:
            tag("p", "Checking what arrived …", "note")
        with tempfile.TemporaryDirectory(dir=service.settings.scratch) as scratch:
            try:
                files: dict[str, Path] = {}
                for number, file in enumerate(event.files):
                    place = Path(scratch) / str(number)
                    await file.save(place)
                    files[file.name] = place
                await taken(files)
                said.clear()
            except Exception as error:  # whatever it is, the view must not wait for ever
                tell(told(error), said)
            finally:
                upload.reset()

    def refused() -> None:
        said.clear()
        with said:
            notice((f"Only {accept.replace(',', ', ')} of up to {limit // 2**20} MB are taken here.",), "bad")

    limit = service.settings.largest_video if ".mp4" in accept else service.settings.largest_archive
    upload = ui.upload(
        multiple=many, on_multi_upload=arrived, on_rejected=refused, max_file_size=limit, auto_upload=True
    )
    upload.props(f'accept="{accept}" batch').classes("hidden-upload")
    box = tag("div", look="empty drop")
    with box:
        tag("b", title)
        tag("p", sentence)
        press = tag(
            "button", "Choose files" if many else "Choose a file", "act primary" if primary else "act", type="button"
        )
        progress = tag("div", look="gauge", role="progressbar", aria_label="Upload", style="width: 60%; display: none")
        with progress:
            tag("i")
    inner = f"getElement({upload.id}).$refs.qRef"
    bar = f"document.getElementById('{progress.html_id}')"
    press.on("click", js_handler=f"() => {inner}.pickFiles()")
    box.on("dragover", js_handler="(e) => { e.preventDefault(); e.currentTarget.classList.add('over'); }")
    box.on("dragleave", js_handler="(e) => e.currentTarget.classList.remove('over')")
    box.on(
        "drop",
        js_handler=f"(e) => {{ e.preventDefault(); e.currentTarget.classList.remove('over'); "
        f"{inner}.addFiles([...e.dataTransfer.files]); }}",
    )
    upload.on("uploading", js_handler=f"() => {{ {bar}.style.display = 'block'; {bar}.classList.add('busy'); }}")
    upload.on("finish", js_handler=f"() => {{ {bar}.style.display = 'none'; }}")
