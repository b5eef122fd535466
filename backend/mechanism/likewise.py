"""One sentence for what several experiments have in common: a slip of the exporter stands in all of its tables."""

from __future__ import annotations

import re
from collections.abc import Iterable

# What may differ: numbers and names of files; what stands in quotes is a part's name.
DIFFERS = re.compile(r'("[^"]*")|[^\s:"]+\.(?:csv|parquet|pq)\b|[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')

NAMED = 10  # experiments


def likewise(said: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """(experiment, sentence) in order; sentences that differ in numbers and files alone are told of the first
    experiment, with the others named after it.

    >>> likewise([("e1", "ends at 0.2 s"), ("e2", "ends at 0.3 s"), ("e3", 'knows no "m1"')])
    [('e1', "ends at 0.2 s; likewise 'e2'"), ('e3', 'knows no "m1"')]
    """
    first: dict[str, tuple[str, list[str]]] = {}
    others: dict[str, list[str]] = {}
    for id, sentence in said:
        shape = DIFFERS.sub(lambda found: found[1] or "#", sentence)
        owner, sentences = first.setdefault(shape, (id, []))
        if id == owner:
            sentences.append(sentence)
        elif id not in others.setdefault(shape, []):
            others[shape].append(id)
    told: list[tuple[str, str]] = []
    for shape, (id, sentences) in first.items():
        named = [f"'{other}'" for other in others.get(shape, ())]
        also = ", ".join(named[:NAMED]) + (f" and {len(named) - NAMED} more" if len(named) > NAMED else "")
        told += [(id, sentence) for sentence in sentences[:-1]]
        told.append((id, f"{sentences[-1].removesuffix('.')}; likewise {also}" if also else sentences[-1]))
    return told
