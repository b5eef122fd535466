"""One self-contained HTML file: style and script stand inside it, nothing is fetched."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from backend.report.playback import playback
from backend.report.quantity import at_the_bench, measured, shown
from backend.report.strip import correlation_matrix, interval_strip


def write_page(template: str, path: str | Path, **story: Any) -> Path:
    """Render a template of this room with its story; the folder is made where it is missing."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    created = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    page = _environment().get_template(template).render(**story, version=version("linktwin"), created=created)
    path.write_text(page, encoding="utf-8")
    return path


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("backend.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(shown=shown, measured=measured)
    environment.globals.update(
        at_the_bench=at_the_bench,
        interval_strip=interval_strip,
        correlation_matrix=correlation_matrix,
        playback=playback,
    )
    return environment
