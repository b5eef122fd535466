"""From pydantic's error records to sentences that name the part, the number and the remedy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from backend.mechanism.drawing_error import DrawingError

PART_NAMES = {
    "bodies": "body",
    "joints": "joint",
    "effects": "effect",
    "markers": "marker",
    "experiments": "experiment",
    "tolerances": "tolerance",
    "meshes": "mesh",
}


def sentences(error: ValidationError, raw: Any) -> list[str]:
    """One sentence for each fault; `raw` is the document, in which the parts' ids are looked up."""
    found: list[str] = []
    for record in error.errors(include_url=False):
        if _counts_the_good_alone(record):
            continue
        cause = record.get("ctx", {}).get("error")
        where = _where(record["loc"], raw)
        if isinstance(cause, DrawingError):
            found += [f"{where}: {problem}" if where else problem for problem in cause.problems]
        else:
            fault = _fault(record)
            joined = " " if fault.startswith(("is ", "has ", "moves ")) else ": "
            found.append(f"{where}{joined}{fault}" if where else fault)
    return list(dict.fromkeys(found))


def _counts_the_good_alone(record: Any) -> bool:
    """Whether a list is called too short only because its faulty entries, which are told, were not counted."""
    listed = record["input"]
    return (
        record["type"] == "too_short"
        and isinstance(listed, list | tuple)
        and len(listed) >= record["ctx"]["min_length"]
    )


def _where(location: tuple[int | str, ...], raw: Any) -> str:
    """'joint "j1": frame_a.quaternion_wxyz' for ("joints", 0, "frame_a", "quaternion_wxyz")."""
    parts: list[str] = []
    fields: list[str] = []
    node = raw
    for step in location:
        parent, node = node, _child(node, step)
        if isinstance(step, int) and fields and fields[-1] in PART_NAMES and isinstance(parent, list | tuple):
            id = node.get("id") if isinstance(node, Mapping) else None
            name = f'"{id}"' if isinstance(id, str) and id else f"{step + 1}"
            parts.append(f"{PART_NAMES[fields.pop()]} {name}")
        elif isinstance(step, int):
            fields.append(f"[{step}]")
        else:
            fields.append(step)
    field = ".".join(fields).replace(".[", "[")
    return ": ".join([*parts, field] if field else parts)


def _child(node: Any, step: int | str) -> Any:
    if isinstance(node, Mapping):
        return node.get(step)
    if isinstance(node, list | tuple) and isinstance(step, int) and step < len(node):
        return node[step]
    return None


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fault(record: Any) -> str:
    kind, value, context = record["type"], record["input"], record.get("ctx", {})
    match kind:
        case "value_error":
            return str(context["error"])
        case "missing":
            return "is missing; add it, docs/mechanism.md says what it means"
        case "extra_forbidden":
            known_to = "a field unknown to version 1.0"
            return f"is {known_to} (its value is {_shown(value)}); check its spelling, or remove it"
        case "finite_number":
            return f"is {value!r}; every number must be finite"
        case "float_type":
            return f"is {_shown(value)}; write a finite number, without quotes"
        case "string_type":
            return f"is {_shown(value)}; write text in quotes"
        case "bool_type":
            return f"is {_shown(value)}; write true or false"
        case "literal_error":
            return f"is {_shown(value)}; write one of {context['expected']}"
        case "greater_than":
            return f"is {_shown(value)}; it must be above {context['gt']:g}"
        case "greater_than_equal":
            return f"is {_shown(value)}; it must not be below {context['ge']:g}"
        case "too_long":
            return f"has {context['actual_length']} entries; it takes {context['max_length']}"
        case "too_short":
            return f"has {context['actual_length']} entries; it takes at least {context['min_length']}"
        case "tuple_type" | "list_type":
            return f"is {_shown(value)}; write a list in square brackets"
        case "dict_type" | "model_type" | "model_attributes_type":
            return f"is {_shown(value)}; write an object in braces"
    return f"is {_shown(value)}: {record['msg']}"
