"""What every test shares: float64, one thread per worker, and the measurements of real rigs."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# Read when jax starts, so nothing is imported here: a test of the drawing stays free of jax.
os.environ["JAX_ENABLE_X64"] = "1"
os.environ.setdefault("JAX_PLATFORMS", "cpu")
XLA_FLAGS = (
    "--xla_cpu_multi_thread_eigen=false",  # two workers share the cores; threads inside each would only fight
    # Most programs here are compiled for a few runs: the same arithmetic, compiled three times faster, running slower.
    "--xla_backend_optimization_level=0",
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_disable_hlo_passes=while-loop-invariant-code-motion,simplify-while-loops",
)
os.environ.setdefault("XLA_FLAGS", " ".join(XLA_FLAGS))
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

ROOT = Path(__file__).resolve().parents[1]
MOST_MAPS = 20_000  # a third of what Linux grants a process


@pytest.fixture(scope="module", autouse=True)
def few_programs() -> Iterator[None]:
    """Forget compiled programs when there are many: each takes memory maps, and a process without any left aborts."""
    yield
    maps = Path("/proc/self/maps")
    if "jax" in sys.modules and maps.exists() and maps.read_bytes().count(b"\n") > MOST_MAPS:
        sys.modules["jax"].clear_caches()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real studies; skips where it is absent, since the measurements are not ours to ship."""
    folder = Path(os.environ.get("LINKTWIN_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measurements of real rigs at {folder}: set LINKTWIN_DATA to their folder")
    return folder
