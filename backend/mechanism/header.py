"""The first row of a table: columns that are missing, misspelt, or one for each marker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from backend.mechanism.drawing_error import known

SHOWN = 3  # columns of a wide table


def header_faults(
    header: Sequence[str], required: Sequence[str], allowed: Sequence[str], key: str, ids: Iterable[str]
) -> Iterator[str]:
    """Sentences of what a header lacks and what it has beyond the columns that are known.

    key: the column that holds `ids`, the names of drawn parts.
    """
    missing = [name for name in required if name not in header]
    unknown = [name for name in header if name not in allowed]
    if key in missing and (wide := _wide(unknown, set(ids))):
        few = ", ".join(map(repr, wide[:SHOWN])) + (", ..." if len(wide) > SHOWN else "")
        yield (
            f"has {len(wide)} columns of its own for each {key} ({few}); write a row for each time and {key}, with the "
            f"columns {','.join(required)}"
        )
        return
    meant = {name: near for name in missing if (near := _meant(name, unknown))}
    for name, near in meant.items():
        yield f"lacks column {name}; {near!r} is likely it: rename it, in the unit that {name} says"
    if rest := [name for name in missing if name not in meant]:
        yield f"lacks column {', '.join(rest)}; its header is {','.join(header)[:200]}"
    if spare := [name for name in unknown if name not in meant.values()]:
        yield f"has unknown column {', '.join(map(repr, spare))[:1000]}; remove it. {known(allowed)}"


def _meant(name: str, unknown: Sequence[str]) -> str | None:
    """The one unknown column that is called as the missing one is but for unit and letters' size, or begins it."""
    word = name.partition("_")[0]
    alike = [given for given in unknown if given and word.startswith(_word(given))]
    return alike[0] if len(alike) == 1 else None


def _word(given: str) -> str:
    """`X (mm)`, `x_mm` and `x [m]` are x."""
    letters = [c if c.isalpha() else " " for c in given.lower()]
    return "".join(letters).split()[0] if "".join(letters).split() else given


def _wide(unknown: Sequence[str], ids: set[str]) -> list[str]:
    """Columns that are called after a drawn part and something else, where there are several."""
    wide = [name for name in unknown if any(id in name for id in ids)]
    return wide if len(wide) > 1 else []
