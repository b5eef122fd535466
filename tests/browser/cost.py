"""Processor time of a browser's processes: what a frame costs, however busy the machine is (Linux)."""

import os
from pathlib import Path

ROLES = {"gpu-process": "drawing", "renderer": "page"}


def spent_s() -> dict[str, float]:
    """Seconds of processor time so far by role, of the Chromium processes that descend from this one."""
    parents: dict[int, list[tuple[int, float, str]]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
            command = (stat.parent / "cmdline").read_text()
        except (FileNotFoundError, ProcessLookupError):  # it ended meanwhile
            continue
        seconds = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        parents.setdefault(int(fields[1]), []).append((int(stat.parent.name), seconds, command))
    spent = dict.fromkeys(ROLES.values(), 0.0)
    ask = [os.getpid()]
    while ask:
        for pid, seconds, command in parents.get(ask.pop(), ()):
            ask.append(pid)
            for word, role in ROLES.items():
                if f"--type={word}" in command:
                    spent[role] += seconds
    return spent
