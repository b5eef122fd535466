"""The palette that shows how an export goes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import adsk.core

from ... import config
from ...lib import handlers

PAGE = Path(__file__).with_name("palette.html")
WIDTH, HEIGHT = 380, 460


class ProgressPalette:
    """Messages go to the page one by one; those sent before it has loaded are kept, and sent when it says so."""

    def __init__(self):
        self._told: list[dict] = []
        self._ready = False

    def show(self, asked: Callable[[str, dict], None]) -> None:
        """Show an empty palette. asked: called with the action and data of a button on it."""
        palettes = adsk.core.Application.get().userInterface.palettes
        self._told = []
        palette = palettes.itemById(config.PALETTE)
        if palette is None:
            self._ready = False
            palette = palettes.add(config.PALETTE, "LinkTwin", PAGE.as_uri(), True, True, True, WIDTH, HEIGHT, True)
            palette.dockingState = adsk.core.PaletteDockingStates.PaletteDockStateRight

            def arrived(args):
                if args.action == "ready":
                    self._ready = True
                    for message in self._told:
                        self._send(message)
                else:
                    data = json.loads(args.data) if args.data else {}
                    asked(args.action, data if isinstance(data, dict) else {})

            handlers.listen(config.PALETTE, palette.incomingFromHTML, adsk.core.HTMLEventHandler, arrived)
        elif self._ready:
            self._send({"step": "begin"})
        palette.isVisible = True

    def tell(self, message: dict) -> None:
        """Show a message."""
        self._told.append(message)
        if self._ready:
            self._send(message)

    def folder(self) -> str | None:
        """Where the export lies that is shown."""
        return next((message["folder"] for message in reversed(self._told) if message.get("folder")), None)

    def remove(self) -> None:
        """Take the palette away."""
        palette = adsk.core.Application.get().userInterface.palettes.itemById(config.PALETTE)
        if palette:
            palette.deleteMe()
        handlers.forget(config.PALETTE)
        self._ready = False

    def _send(self, message: dict) -> None:
        palette = adsk.core.Application.get().userInterface.palettes.itemById(config.PALETTE)
        if palette:  # the user may have closed it; the export goes on
            palette.sendInfoToHTML("progress", json.dumps(message))
