"""Where a written mechanism comes from."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any


def provenance(warnings: Sequence[str]) -> dict[str, Any]:
    """The `provenance` block; `created` is SOURCE_DATE_EPOCH where that is set, for files that can be compared."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    created = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(int(epoch), UTC)
    return {
        "tool": "CadQuery",
        "tool_version": _version("cadquery"),
        "exporter": "cad_export",
        "exporter_version": _version("linktwin"),
        "created": created.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "warnings": list(warnings),
    }


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:  # a checkout on the path, not installed
        return "unknown"
