"""Engines that nobody here wrote, loaded when they are asked for."""

from __future__ import annotations

import importlib
from typing import Any


def peer(module: str) -> Any:
    """The engine's module; ImportError with the remedy where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise ImportError(f"{package} is not installed; install linktwin[peers]") from error
