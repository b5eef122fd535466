"""The add-in's entry: Fusion calls run() when it is started and stop() when it is ended."""

import traceback

import adsk.core

from . import commands


def run(context):
    """Put the buttons where they belong."""
    try:
        commands.start()
    except Exception:
        _show("LinkTwin could not start", traceback.format_exc())


def stop(context):
    """Take everything away again."""
    try:
        commands.stop()
    except Exception:
        _show("LinkTwin could not stop", traceback.format_exc())


def _show(title, text):
    interface = adsk.core.Application.get().userInterface
    if interface:
        interface.messageBox(text, title)
