"""What every test shares: float64, one thread per worker, how programs are compiled, measurements of real rigs."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.environment import many_programs, plain_flags

# Read when jax starts, so nothing is imported here: a test of the drawing stays free of jax.
os.environ["JAX_ENABLE_X64"] = "1"
os.environ.setdefault("JAX_PLATFORMS", "cpu")
XLA_FLAGS = (
    "--xla_cpu_multi_thread_eigen=false",  # two workers share the cores; threads inside each would only fight
    *plain_flags(),
    "--xla_disable_hlo_passes=while-loop-invariant-code-motion,simplify-while-loops",
)
os.environ.setdefault("XLA_FLAGS", " ".join(XLA_FLAGS))
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tracing makes millions of objects that stay; looking them all through again and again takes its share.
gc.set_threshold(50_000, 20, 100)

ROOT = Path(__file__).resolve().parents[1]
LONGEST = ("diagnose", "service", "effects", "report", "browser", "fit", "jam", "physics", "simulate", "blind")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the folders of the longest modules: begun last, one would run on while the other worker is idle."""
    order = {folder: place for place, folder in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.relative_to(ROOT / "tests").parts[0], len(order)))


@pytest.fixture(scope="module", autouse=True)
def few_programs() -> Iterator[None]:
    """Forget compiled programs when there are many: each takes memory maps, and a process without any left aborts."""
    yield
    if "jax" in sys.modules and many_programs():
        sys.modules["jax"].clear_caches()


@pytest.fixture(scope="module")
def run_often() -> bool:
    """Whether programs here run for longer than they take to compile; folders and modules where they do say so."""
    return False


@pytest.fixture(scope="module", autouse=True)
def compiled_to_suit(run_often: bool) -> None:
    """Compile at the lowest level what runs a few times: half the time, for runs up to seven times as long."""
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(not run_often)  # read when jax starts, here or in a child
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_disable_most_optimizations", not run_often)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real studies; skips where it is absent, since the measurements are not ours to ship."""
    folder = Path(os.environ.get("LINKTWIN_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measurements of real rigs at {folder}: set LINKTWIN_DATA to their folder")
    return folder
