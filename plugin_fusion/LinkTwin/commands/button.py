"""A button in the Add-Ins panel of Design > Utilities."""

from __future__ import annotations

from collections.abc import Callable

import adsk.core

from .. import config
from ..lib import handlers


def add(id: str, name: str, tip: str, on_created: Callable, promoted: bool) -> None:
    """Add a button that opens a command. on_created: called with CommandCreatedEventArgs."""
    interface = adsk.core.Application.get().userInterface
    remove(id)  # a run that ended badly leaves its button behind, and a second of that id is refused
    definition = interface.commandDefinitions.addButtonDefinition(id, name, tip)
    handlers.listen(id, definition.commandCreated, adsk.core.CommandCreatedEventHandler, on_created)
    control = _controls(interface).addCommand(definition)
    control.isPromoted = promoted


def remove(id: str) -> None:
    """Take a button away, with its command and its handlers."""
    interface = adsk.core.Application.get().userInterface
    for found in (_controls(interface).itemById(id), interface.commandDefinitions.itemById(id)):
        if found:
            found.deleteMe()
    handlers.forget(id)


def _controls(interface):
    workspace = interface.workspaces.itemById(config.WORKSPACE)
    return workspace.toolbarPanels.itemById(config.PANEL).controls
