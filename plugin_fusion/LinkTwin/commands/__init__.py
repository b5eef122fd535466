"""The add-in's buttons. Each room has an `entry` with start() and stop()."""

from .export import entry as export
from .settings import entry as settings

ENTRIES = (export, settings)


def start():
    """Add all buttons."""
    for entry in ENTRIES:
        entry.start()


def stop():
    """Remove all buttons; one that fails does not keep the others."""
    failed = None
    for entry in ENTRIES:
        try:
            entry.stop()
        except Exception as error:
            failed = error
    if failed:
        raise failed
