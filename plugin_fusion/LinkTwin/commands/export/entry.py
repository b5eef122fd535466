"""The one button: read the design, save it, send it, show how it goes, open the page."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path

import adsk.core
import adsk.fusion

from ... import config
from ...lib import bundle, handlers, reader, settings
from ...lib.handover import Handover
from ...lib.service import Service
from .. import button
from .palette import ProgressPalette

NAME = "Export to LinkTwin"
TIP = "Save this design's mechanism, and send it to the LinkTwin service"

_palette = ProgressPalette()
_handover: Handover | None = None


def start():
    """Add the button, and the event by which the upload's thread speaks to Fusion's own."""
    application = adsk.core.Application.get()
    application.unregisterCustomEvent(config.PROGRESS_EVENT)
    event = application.registerCustomEvent(config.PROGRESS_EVENT)
    button.add(config.EXPORT_COMMAND, NAME, TIP, _created, promoted=True)
    handlers.listen(config.EXPORT_COMMAND, event, adsk.core.CustomEventHandler, _progressed)


def stop():
    """Remove the button, the palette and the event; an upload under way is told to end."""
    if _handover:
        _handover.cancel()
    _palette.remove()
    button.remove(config.EXPORT_COMMAND)
    adsk.core.Application.get().unregisterCustomEvent(config.PROGRESS_EVENT)


def _created(args):
    # No inputs: Fusion then executes at once, and the button is a single click.
    handlers.listen(config.EXPORT_COMMAND, args.command.execute, adsk.core.CommandEventHandler, lambda _: export())


def export() -> None:
    """Read and save on this thread, the only one that Fusion allows; send on another."""
    global _handover
    application = adsk.core.Application.get()
    design = adsk.fusion.Design.cast(application.activeProduct)
    if not design:
        application.userInterface.messageBox("Open a design first: this is another kind of document.", NAME)
        return
    if _handover and _handover.is_alive():
        application.userInterface.messageBox("The last export is still being sent; stop it or wait for its end.", NAME)
        return
    try:
        wanted = settings.load(settings.settings_path())
        folder = bundle.new_folder(Path(wanted.folder).expanduser(), reader.document_name(design, application))
    except (settings.BadSettings, OSError) as error:
        application.userInterface.messageBox(f"{error}\n\nCorrect it in LinkTwin settings.", NAME)
        return
    _palette.show(_asked)
    _palette.tell({"step": "read", "share": 0.0, "text": "Reading the design"})

    def progress(what: str, share: float) -> None:
        _palette.tell({"step": "read", "share": share, "text": f"Reading {what}"})
        adsk.doEvents()

    bundle.save_snapshot(reader.read_design(design, application, folder, wanted.up, progress), folder)
    saved = bundle.save(folder)
    _palette.tell({"step": "saved", **bundle.summary(saved)})
    if saved.mechanism is None:
        text = f"It is no mechanism yet. What Fusion said is kept in {folder}."
        _palette.tell({"step": "failed", "share": None, "text": text, "page": None})
    elif not wanted.url:
        _palette.tell({"step": "done", "share": 1.0, "text": f"Saved in {folder}.", "page": None})
    else:

        def post(message: dict) -> None:
            # On the upload's thread: the one call that Fusion allows there.
            application.fireCustomEvent(config.PROGRESS_EVENT, json.dumps(message))

        _handover = Handover(Service(wanted.url, wanted.key), folder, post, wanted.simulate_s)
        _handover.start()


def _progressed(args):
    """On Fusion's thread again."""
    message = json.loads(args.additionalInfo)
    _palette.tell(message)
    if message["step"] == "stored":
        webbrowser.open(message["page"])


def _asked(action: str, data: dict) -> None:
    """A button of the palette was pressed."""
    if action == "stop" and _handover:
        _handover.cancel()
    elif action == "open" and str(data.get("page", "")).startswith(("http://", "https://")):
        webbrowser.open(data["page"])
    elif action == "folder":
        folder = _palette.folder()
        if folder:
            webbrowser.open(Path(folder).as_uri())
