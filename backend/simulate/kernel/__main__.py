"""Build the compiled kernel: python -m backend.simulate.kernel."""

import subprocess
import sys

from backend.simulate.kernel.build import NoCompiler, build

WITHOUT = "linktwin runs without its compiled kernel: the same results, slower"


def main() -> int:
    """One line on what became of it; a machine without a compiler is no failure."""
    try:
        print(f"compiled kernel: {build().name}")
    except NoCompiler as missing:
        print(f"{WITHOUT} ({missing}).")
    except (subprocess.CalledProcessError, OSError) as refused:
        print(f"{WITHOUT} (the C++ compiler or the folder refuses: {refused}).")
        print(getattr(refused, "stderr", None) or "", file=sys.stderr, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
