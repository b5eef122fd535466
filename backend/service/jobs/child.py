"""The process that does a job's work: it ends with the worker that started it, and stays within its limits."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def tie_to(parent: int) -> None:
    """End at once when the process that started this one ends, however it ends (Linux)."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)


def limit(file_bytes: int, nice: int) -> None:
    """No core files, no file above so many bytes, and after those who wait for an answer."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))
    os.nice(nice)


def main() -> None:
    """PARENT FILE_BYTES NICE, then a command, which takes this process over and keeps its ties and limits."""
    parent, file_bytes, nice, *command = sys.argv[1:]
    tie_to(int(parent))
    limit(int(file_bytes), int(nice))
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
