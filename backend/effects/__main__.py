"""Write what the effects declare where others read it: python -m backend.effects.

effect_kinds.json serves the reader of drawings, docs/effects.md serves people.
"""

import json
from pathlib import Path

import backend.mechanism
from backend.effects.catalogue import effect_of_kind, vocabulary
from backend.effects.effect import Declaration

VOCABULARY = Path(backend.mechanism.__file__).with_name("effect_kinds.json")
PAGE = Path(__file__).parents[2] / "docs" / "effects.md"

HEAD = """\
# Effects that can be simulated

Written by `python -m backend.effects` from the declarations in `backend/effects/`; do not edit. Gravity is not listed:
a drawing gives it as `gravity_m_per_s2`. A default of "give it" means that a drawing must name the value; bounds are
those of a drawing and of a fit. "Expected" is the standard deviation of a value before any data, in natural sizes of
its unit, which follow from a mechanism's own mass, length and gravity; empty where a diagnosis does not free it.
Parameters marked *record* can follow recorded inputs. "Unstated up to": where neither drawing nor fit says it, the
intervals of a fit allow for all values from the default to that one.

| Kind | Acts on | Parameter | Unit | Default | Bounds | Expected | Meaning |
|---|---|---|---|---|---|---|---|
"""


def page() -> str:
    """The table of all effects, as Markdown."""
    rows = []
    for kind, entry in vocabulary().items():
        doc = entry["doc"].replace("|", "\\|")
        rows.append(f"| **{kind}** | {entry['acts_on']} | | | | | | {doc} |")
        effect = effect_of_kind(kind)
        rows += [f"| | | {_row(name, declared)} |" for name, declared in effect.declarations().items()]
        rows += [
            f"| | | `{name}` | word | {c.options[0]} | {' or '.join(c.options)} | | {c.doc} |"
            for name, c in effect.choices().items()
        ]
    return HEAD + "\n".join(rows) + "\n"


def _row(name: str, declared: Declaration) -> str:
    size = f" ({declared.size} numbers)" if declared.size > 1 else ""
    drawn = "the drawn fit" if declared.joint_types else f"the {declared.drawn}"
    default = drawn if declared.drawn else "give it"
    default = default if declared.default is None else f"{declared.default:g}"
    low, high = declared.lower, declared.upper
    bounds = "" if low is None and high is None else f"{_end(low, '-∞')} to {_end(high, '∞')}"
    where = f"; at {', '.join(declared.joint_types)} joints" if declared.joint_types else ""
    record = "; *record*" if declared.drive else ""
    natural = " natural sizes" if declared.unstated_is_natural else ""
    far = "" if declared.unstated is None else f"; unstated up to {declared.unstated:g}{natural}"
    expected = "" if declared.expected is None else f"{declared.expected * declared.typical:g}"
    return f"`{name}`{size} | {declared.unit} | {default} | {bounds} | {expected} | {declared.doc}{where}{record}{far}"


def _end(bound: float | None, none: str) -> str:
    return none if bound is None else f"{bound:g}"


if __name__ == "__main__":
    VOCABULARY.write_text(json.dumps(vocabulary(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
