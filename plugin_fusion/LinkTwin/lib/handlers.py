"""Event handlers that stay alive: Fusion keeps no reference to them, and Python would collect them."""

from __future__ import annotations

import traceback
from collections.abc import Callable

_KEPT: dict = {}


def listen(owner: str, event, base: type, react: Callable) -> None:
    """Have `react(arguments)` called on an event until `forget(owner)`; what it raises is shown, and ends there.

    base: the adsk handler class of that event.
    """

    class Handler(base):
        """Passes the event on."""

        def notify(self, args):
            """Called by Fusion."""
            try:
                react(args)
            except Exception:
                show_failure(owner, traceback.format_exc())

    handler = Handler()
    event.add(handler)
    _KEPT.setdefault(owner, []).append(handler)


def forget(owner: str) -> None:
    """Let the handlers of an owner go."""
    _KEPT.pop(owner, None)


def show_failure(owner: str, text: str) -> None:
    """Tell the user of an unforeseen failure."""
    import adsk.core

    adsk.core.Application.get().userInterface.messageBox(f"{owner} failed:\n{text}", "LinkTwin")
