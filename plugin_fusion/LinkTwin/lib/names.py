"""Names that a mechanism can use: printable, trimmed and each once."""

from __future__ import annotations

import re
from collections.abc import Iterable


def readable(name: str, otherwise: str) -> str:
    """The name without control characters and outer spaces; `otherwise` where nothing is left."""
    kept = "".join(letter if letter.isprintable() else " " for letter in name)
    return " ".join(kept.split()) or otherwise


def unique(names: Iterable[str]) -> list[str]:
    """The names in order, repeated ones numbered: Rev1, Rev1 (2)."""
    wanted = list(names)
    taken: set[str] = set()
    found = []
    for name in wanted:
        choice, number = name, 1
        while choice in taken or (number > 1 and choice in wanted):
            number += 1
            choice = f"{name} ({number})"
        taken.add(choice)
        found.append(choice)
    return found


def body_ids(paths: Iterable[str]) -> dict[str, str]:
    """Short ids for occurrence paths: `Cell:1+Bar:1` is `Cell/Bar`; the numbers stay where they tell two apart.

    The root component is `ground`.
    """
    wanted = list(paths)
    short = {
        path: "/".join(readable(part, "part") for part in path.split("+")) if path else "ground" for path in wanted
    }
    bare = {path: readable(re.sub(r"\s*:1(?=/|$)", "", id), "part") for path, id in short.items()}
    several = {re.sub(r":\d+(?=/|$)", "", id) for id in short.values() if re.search(r":(?!1(?:/|$))\d+(?=/|$)", id)}
    chosen = [short[path] if re.sub(r":\d+(?=/|$)", "", short[path]) in several else bare[path] for path in wanted]
    return dict(zip(wanted, unique(chosen)))


def file_names(names: Iterable[str], ending: str) -> list[str]:
    """File names that every system takes; other letters become _, and repeats are numbered."""
    stems = [re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._")[:60] or "part" for name in names]
    taken: set[str] = set()
    found = []
    for stem in stems:
        choice, number = stem, 1
        while choice.lower() in taken:
            number += 1
            choice = f"{stem}-{number}"
        taken.add(choice.lower())
        found.append(choice + ending)
    return found
