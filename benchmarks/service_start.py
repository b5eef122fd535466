"""What the web process takes of a core until it answers, on a fresh data folder and on one that was used.

python -m benchmarks.service_start [TIMES]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.service.serving import serving, settings_in


def main(times: int) -> None:
    """Its own time: a clock on the wall would measure what else the machine does."""
    took_s = []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as folder:
            for _ in ("fresh", "used"):
                with serving(Path(folder), settings_in(Path(folder), workers=0)) as service:
                    took_s.append(service.web_start_s)
    for name, of in (("fresh", took_s[::2]), ("used", took_s[1::2])):
        print(f"{name:6s} {np.median(of):.2f} s of a core, {max(of):.2f} at most of {times} (asked: under 3)")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2] or ("5",)))
