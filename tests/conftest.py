"""What every test shares: float64, one thread per worker, how programs are compiled, measurements of real rigs."""

import gc
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
    # The same arithmetic by passes that end sooner: a program compiles in two thirds of the time.
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_disable_hlo_passes=while-loop-invariant-code-motion,simplify-while-loops",
)
os.environ.setdefault("XLA_FLAGS", " ".join(XLA_FLAGS))
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tracing makes millions of objects that stay; looking them all through again and again takes its share.
gc.set_threshold(50_000, 20, 100)
