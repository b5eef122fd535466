"""Commit and reveal: what the truth is stands fixed, as a hash, before the first answer is given."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from backend.blind.withheld.case import ALL, Limits
from backend.blind.withheld.write import as_json

SEAL, LABELS = "seal.json", "labels.json"


def generator_version() -> str:
    """A hash of the generators' own source: any change to them is another version."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def commitment(labels: Sequence[dict[str, Any]], salt: str, version: str) -> str:
    """SHA-256 of the labels, the salt that keeps them from being guessed, and the generators' version."""
    return hashlib.sha256("\n".join([version, salt, *map(as_json, labels)]).encode()).hexdigest()


def seal(labels: Sequence[dict[str, Any]], out: Path, seed: int, limits: Limits = ALL) -> str:
    """Write labels.json, and seal.json whose hash may be told to anyone; returns the hash."""
    salt, version = secrets.token_hex(16), generator_version()
    sha = commitment(labels, salt, version)
    (out / LABELS).write_text(json.dumps({"salt": salt, "version": version, "labels": list(labels)}))
    sealed = {"sha256": sha, "seed": seed, "cases": len(labels), "version": version,
              **limits.stamp, "sealed": datetime.now(UTC).isoformat(timespec="seconds")}  # fmt: skip
    (out / SEAL).write_text(json.dumps(sealed, indent=1))
    return sha


def revealed(out: Path) -> list[dict[str, Any]]:
    """The labels, once they are found to be those that were sealed.

    Raises ValueError where they are not: a label, the salt or the version was changed after sealing.
    """
    sealed, kept = (json.loads((out / name).read_text()) for name in (SEAL, LABELS))
    if commitment(kept["labels"], kept["salt"], kept["version"]) != sealed["sha256"]:
        raise ValueError(
            f"{out / LABELS} does not match the hash {sealed['sha256'][:12]}... in {SEAL}: "
            "it was changed after sealing; remove the folder and run the check again"
        )
    return kept["labels"]


def is_sealed(out: Path, seed: int, cases: int, limits: Limits = ALL) -> bool:
    """Whether a folder holds the sealed cases of this seed, by the generators as they are now.

    Raises ValueError where it holds another check.
    """
    if not (out / SEAL).exists():
        return False
    sealed = json.loads((out / SEAL).read_text())
    asked = seed, cases, generator_version(), limits.stamp
    held = Limits(**{name: tuple(sealed.get(name, ())) for name in limits.stamp})
    if (sealed["seed"], sealed["cases"], sealed["version"], held.stamp) != asked:
        raise ValueError(
            f"{out} holds seed {sealed['seed']} with {sealed['cases']} cases of {held.words} by "
            f"generators {sealed['version']}, not seed {seed} with {cases} of {limits.words} by {asked[2]}; "
            "name another folder, or ask for resume=False"
        )
    return True
