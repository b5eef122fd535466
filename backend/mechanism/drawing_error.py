"""The one way in which reading a drawing fails."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import islice

MOST_LISTED = 100  # faults of one file; who asks for all of a hostile one would wait for hours


class DrawingError(ValueError):
    """A drawing, study or table cannot be used; every problem found is listed, not only the first.

    problems: sentences, each naming the part, the number and the remedy.
    source: the file (or other origin) that was being read.
    """

    def __init__(self, problems: str | Sequence[str], source: str = ""):
        self.problems: tuple[str, ...] = (problems,) if isinstance(problems, str) else tuple(problems)
        self.source = source
        super().__init__(self._sentence())

    def _sentence(self) -> str:
        origin = f"{self.source}: " if self.source else ""
        if len(self.problems) == 1:
            return origin + self.problems[0]
        listed = "\n".join(f"  - {problem}" for problem in self.problems)
        return f"{origin}{len(self.problems)} problems\n{listed}"


def first(faults: Iterable[str]) -> list[str]:
    """The first hundred faults; the others are not even looked for."""
    found = list(islice(faults, MOST_LISTED + 1))
    return found if len(found) <= MOST_LISTED else [*found[:MOST_LISTED], "and more; correct these first"]


def known(ids: Iterable[str], asked: str = "") -> str:
    """Close an error sentence with the names that would have worked; first those that are spelt nearly as what was
    asked for.
    """
    names = sorted(ids)
    if not names:
        return "None is declared."
    near = get_close_matches(asked, names, n=2) if asked else []
    names = [*near, *(name for name in names if name not in near)]
    shown = ", ".join(f'"{name}"' for name in names[:12])
    rest = f" and {len(names) - 12} more" if len(names) > 12 else ""
    meant = f'Did you mean "{near[0]}"? ' if near else ""
    return f"{meant}Known: {shown}{rest}."
