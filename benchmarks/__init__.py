"""What is measured, and beside whom; each module prints its own figures."""

import os

os.environ.setdefault("JAX_ENABLE_X64", "1")  # read when jax starts
# Read when numpy starts.  Matrices are small: on a busy machine BLAS threads mostly wait for each other, and a singular
# value decomposition of 170 x 126 takes a second instead of 5 ms.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
