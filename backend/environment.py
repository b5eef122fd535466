"""What is read when jax and numpy start: float64, how programs are compiled, where they are kept, how many.

Nothing is imported here, and what the user's environment says already is left as it is.
"""

from __future__ import annotations

import os
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

# A step is hundreds of small loops; the older of XLA's two ways to compile one takes two thirds of the time, and the
# loops are a tenth faster.
PLAIN_LOOPS = "--xla_cpu_use_fusion_emitters=false"
# Sums and products of some hundred rows, as links that touch have, wait longer for a library's threads than they take.
PLAIN_SUMS = "--xla_cpu_experimental_ynn_fusion_type="
# jaxlib from which on each was tried, and from which on it was not: XLA ends a process at a flag that it does not know.
TRIED = {PLAIN_LOOPS: ((0, 0), (0, 11)), PLAIN_SUMS: ((0, 10), (0, 11))}

MAPS = Path("/proc/self/maps")
MOST_MAPS = 20_000  # memory maps; Linux ends a process that asks for 65 530, and one study's programs take up to 20 000


def settle() -> None:
    """Float64, quick compiling and small decompositions on one thread: waiting for each other takes threads longer."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    said = os.environ.get("XLA_FLAGS", "").split()
    told = {flag.split("=")[0] for flag in said}
    os.environ["XLA_FLAGS"] = " ".join([*said, *(flag for flag in plain_flags() if flag.split("=")[0] not in told)])


def plain_flags() -> list[str]:
    """Those of XLA's flags above that the jaxlib at hand is known to take."""
    with suppress(PackageNotFoundError, ValueError):
        jaxlib = tuple(int(part) for part in version("jaxlib").split(".")[:2])
        return [flag for flag, (first, beyond) in TRIED.items() if first <= jaxlib < beyond]
    return []


def keep_programs() -> None:
    """A program compiled once serves every later command on a mechanism of the same layout."""
    shelf = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "linktwin" / "programs"
    with suppress(OSError):  # a home that cannot be written costs compile time, nothing else
        shelf.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(shelf))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")


def many_programs() -> bool:
    """Whether compiled programs hold so much of what the system grants a process that they should be let go."""
    return MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS
