"""One answer (gap.json's content) held against one label: what was named, how surely, and whether it is so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

NONE, UNKNOWN, FAILED = "none", "unknown", "failed"
SURE = 0.9
REPORTED = 1 / 20  # of the likeliest cause: what still belongs to the reported set
Z90 = 1.6448536269514722

Named = frozenset[tuple[str, tuple[str, ...]]]


def unanswered(why: str) -> dict[str, Any]:
    """What stands for an answer where a diagnosis failed; it counts as wrong wherever an answer was asked for."""
    return {
        "verdict": FAILED, "sentence": why, "where": {}, "causes": [], "probability_none": 0.0,
        "probability_unknown": 0.0, "p_value": 0.0, "shrink": {}, "detectable": [],
    }  # fmt: skip


def judged(label: Mapping[str, Any], gap: Mapping[str, Any]) -> dict[str, Any]:
    """Plain facts about one case, from which every score is counted.

    right: the share of probability on the truth; top: the likeliest entry's probability; top1, top2: whether the
    truth is the first, or among the first two; covered: for each parameter of a rightly named cause, whether its 90%
    interval holds the true value.
    """
    causes = sorted(gap.get("causes", ()), key=lambda cause: -cause["probability"])
    entries = [(_named(cause["effects"]), float(cause["probability"])) for cause in causes]
    entries += [(NONE, float(gap.get("probability_none", 0.0))), (UNKNOWN, float(gap.get("probability_unknown", 0.0)))]
    entries.sort(key=lambda entry: -entry[1])
    fits = [_is_so(label, what) for what, _ in entries]
    known = [(what, p) for what, p in entries if isinstance(what, frozenset)]
    reported = [what for what, p in known if p >= REPORTED * max((q for _, q in known), default=1.0)]
    locations = sorted(gap.get("where", {}).get("locations", ()), key=lambda place: -place["probability"])
    shrink = (gap.get("shrink") or {}).get("held_out") or {}
    return {
        "stratum": label["stratum"],
        "bin": label["bin"],
        "family": label.get("family", ""),
        "verdict": gap["verdict"],
        "named": sorted([list(map(list, what)) for what in reported[:1]]),
        "top1": fits[0] and gap["verdict"] != FAILED,
        "top2": any(fits[:2]) and gap["verdict"] != FAILED,
        "top": entries[0][1],
        "right": sum(p for (_, p), fit in zip(entries, fits, strict=True) if fit),
        "reported": any(_is_so(label, what) for what in reported),
        "sure_and_wrong": any(p > SURE and not _is_so(label, what) for what, p in known),
        "both": bool(known) and _is_so(label, known[0][0]) and label["stratum"] == "pair",
        "part": bool(known) and known[0] == entries[0] and _is_part(label, known[0][0]),
        "place": bool(locations) and locations[0]["at"] in _places(label),
        "covered": _covered(label, causes),
        "explained": shrink.get("explained_fraction"),
    }


def _named(effects: Sequence[Mapping[str, Any]]) -> Named:
    on = [(effect["kind"], effect["on"]) for effect in effects]
    return frozenset((kind, (where,) if isinstance(where, str) else tuple(sorted(where))) for kind, where in on)


def _alike(label: Mapping[str, Any]) -> list[set[tuple[str, tuple[str, ...]]]]:
    """For each true effect, the names that the data allow for it."""
    return [{(e["kind"], tuple(sorted(e["on"]))) for e in group} for group in label["classes"]]


def _is_so(label: Mapping[str, Any], what: Named | str) -> bool:
    """Whether an entry says what the label allows."""
    groups = _alike(label)
    match label["stratum"]:
        case "none":
            return what == NONE
        case "never" | "left_out":
            # A known cause that the data cannot tell from the truth is a fair answer too.
            return what == UNKNOWN or (isinstance(what, frozenset) and len(what) == 1 and set(what) <= groups[0])
    if not isinstance(what, frozenset) or len(what) != len(groups):
        return False
    return all(any(name in group for name in what) for group in groups)


def _is_part(label: Mapping[str, Any], what: Named | str) -> bool:
    """Whether a cause names something true and nothing wrong."""
    groups = _alike(label)
    return isinstance(what, frozenset) and bool(what) and all(any(n in g for g in groups) for n in what)


def _places(label: Mapping[str, Any]) -> set[str]:
    own = [place for effect in label["effects"] for place in effect["places"]]
    return {*own, *(place for group in label["classes"] for effect in group for place in effect.get("places", ()))}


def _covered(label: Mapping[str, Any], causes: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether 90% intervals hold the true values, for effects of the likeliest cause that bear their true names."""
    true = {(e["kind"], tuple(sorted(e["on"]))): e["parameters"] for e in label["effects"]}
    held = []
    if label["stratum"] not in ("single", "pair"):
        return held
    for effect in causes[0]["effects"] if causes else ():
        (name,) = _named([effect])
        for parameter, value in true.get(name, {}).items():
            found = effect.get("parameters", {}).get(parameter)
            if found and found.get("sd") is not None:
                held.append(abs(found["value"] - value) <= Z90 * found["sd"])
    return held
