"""The settings dialog."""

from __future__ import annotations

import adsk.core

from ... import config
from ...lib import handlers, settings
from .. import button

NAME = "LinkTwin settings"
TEXTS = (("url", "Service (empty: save files only)"), ("key", "API key"), ("folder", "Save exports in"))
UP_WORDS = {"auto": "as in Fusion's preferences", "x": "x", "y": "y", "z": "z"}


def start():
    """Add the button."""
    button.add(config.SETTINGS_COMMAND, NAME, "Where LinkTwin sends and saves mechanisms", _created, promoted=False)


def stop():
    """Remove the button."""
    button.remove(config.SETTINGS_COMMAND)


def _created(args):
    interface = adsk.core.Application.get().userInterface
    try:
        current = settings.load(settings.settings_path())
    except settings.BadSettings as error:
        interface.messageBox(str(error), NAME)
        current = settings.Settings()
    inputs = args.command.commandInputs
    for id, words in TEXTS:
        inputs.addStringValueInput(id, words, getattr(current, id))
    up = inputs.addDropDownCommandInput("up", "Up (against gravity)", adsk.core.DropDownStyles.TextListDropDownStyle)
    for id, words in UP_WORDS.items():
        up.listItems.add(words, id == current.up)
    inputs.addStringValueInput("simulate_s", "Simulate after upload (s, 0: no)", f"{current.simulate_s:g}")
    handlers.listen(config.SETTINGS_COMMAND, args.command.execute, adsk.core.CommandEventHandler, _execute)


def _execute(args):
    inputs = args.command.commandInputs
    told = {id: inputs.itemById(id).value for id, _ in TEXTS}
    words = inputs.itemById("up").selectedItem.name
    try:
        told["up"] = next(id for id, shown in UP_WORDS.items() if shown == words)
        wanted = settings.Settings(**told, simulate_s=_seconds(inputs.itemById("simulate_s").value)).checked()
        settings.store(wanted, settings.settings_path())
    except (settings.BadSettings, OSError) as error:
        args.executeFailed = True
        args.executeFailedMessage = f"Nothing was changed: {error}."


def _seconds(text):
    try:
        return float(text)
    except ValueError:
        raise settings.BadSettings(f'the seconds to simulate are "{text}"; write a number such as 2') from None
