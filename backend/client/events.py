"""Server-sent events, as the HTML standard writes them, of which only the data is wanted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator


def data_of(lines: Iterable[str]) -> Iterator[str]:
    """The data of each event.

    >>> list(data_of([": ping", "event: progress", "data: 1", "data: 2", "", "data: 3", ""]))
    ['1\\n2', '3']
    """
    held: list[str] = []
    for line in lines:
        if line.startswith("data:"):
            held.append(line.removeprefix("data:").removeprefix(" "))
        elif not line and held:
            yield "\n".join(held)
            held = []
