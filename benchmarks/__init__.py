"""What is measured, and beside whom; each module prints its own figures."""

from backend.environment import settle

settle()  # before jax and numpy start
