"""Logs: one line a happening, on standard error."""

from __future__ import annotations

import logging
import sys
from typing import Any

import structlog


def write_logs(level: int = logging.INFO) -> None:
    """Set up once, by an entry point: words for people on a terminal, JSON otherwise."""
    terminal = sys.stderr.isatty()
    shown = (
        [structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)]
        if terminal
        else [structlog.processors.format_exc_info]
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            *shown,
            *([] if terminal else [structlog.processors.JSONRenderer()]),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )


def logger() -> Any:
    """Where to write."""
    return structlog.get_logger()
