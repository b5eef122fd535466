"""The add-in as tests load it: by its path, as Fusion does, never as a part of this project."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2] / "plugin_fusion" / "LinkTwin"

if "LinkTwin" not in sys.modules:
    _package = ModuleType("LinkTwin")
    _package.__path__ = [str(ROOT)]
    sys.modules["LinkTwin"] = _package


def room(name: str) -> ModuleType:
    """A module of the add-in, such as `lib.mechanism`."""
    return importlib.import_module(f"LinkTwin.{name}")
