"""One diagnosis as a plain function of files, for whoever poses many: in this process or in another."""

from __future__ import annotations

import json
import multiprocessing
import signal
import time
from pathlib import Path
from typing import Any

from backend.environment import many_programs


def answer(study: Path, without: frozenset[str] = frozenset(), minutes: float = 0.0) -> dict[str, Any]:
    """What gap.json would say of a study.json, with kinds of effects left out of the library.

    minutes: after which the search ends and what it found is weighed; 0: never.
    """
    began = time.monotonic()
    if multiprocessing.parent_process() is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started the workers decides when they end
    import jax

    jax.config.update("jax_enable_x64", True)  # before any array is made

    from backend.diagnose.run import diagnose_study
    from backend.mechanism.read import read_study

    try:
        found = diagnose_study(
            read_study(study), without=without, cancelled=lambda: 0.0 < 60.0 * minutes < time.monotonic() - began
        )
        return json.loads(found.report.model_dump_json())
    finally:
        if many_programs():
            jax.clear_caches()
