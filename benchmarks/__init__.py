"""What is measured, and beside whom; each module prints its own figures."""

import os

os.environ.setdefault("JAX_ENABLE_X64", "1")  # read when jax starts
