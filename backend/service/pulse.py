"""A sign of life between a process and the one that keeps it, which asks nothing of the database.

A process that is stopped (a debugger, a frozen container, a memory that swaps) may hold the one writer's lock of
SQLite: nobody could write that it is dead.  Who keeps it hears the silence and ends it, and the lock is free.
"""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass, field


def beat(file: int, every_s: float) -> None:
    """Write a byte into a pipe now and again, from a thread of its own, as long as this process runs."""
    os.set_blocking(file, False)

    def write() -> None:
        while True:
            try:
                os.write(file, b".")
            except BlockingIOError:  # nobody reads for now
                pass
            except OSError:  # nobody will
                return
            time.sleep(every_s)

    threading.Thread(target=write, daemon=True).start()


@dataclass
class Pulse:
    """The keeper's end: `writing` goes to the process, then is closed here."""

    reading: int
    writing: int
    heard: float | None = field(default=None)

    @classmethod
    def open(cls) -> Pulse:
        """A new pipe."""
        reading, writing = os.pipe()
        os.set_blocking(reading, False)
        return cls(reading, writing)

    def silent_s(self) -> float:
        """How long nothing was heard [s]; 0 before the first sign: a busy machine starts processes slowly."""
        try:
            if os.read(self.reading, 65536):
                self.heard = time.monotonic()
        except BlockingIOError:
            pass
        return 0.0 if self.heard is None else time.monotonic() - self.heard

    def close(self) -> None:
        """Listen no more."""
        os.close(self.reading)
