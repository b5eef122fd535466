"""What ten undamped seconds keep, and the order of the step.

python -m benchmarks.laws
"""

import numpy as np

from backend.model.build import build
from tests.mechanisms import bennett, double_pendulum, fourbar
from tests.motions import follow

STEP_S, STEPS = 1e-3, 10_000


def main() -> None:
    """Print one line per linkage."""
    print("10 s at h = 1 ms, undamped          max |dE|/KE   end drift/KE   joints open, m   order   iterations a step")
    for drawn in (double_pendulum(), fourbar(), bennett()):
        model = build(drawn)
        motion = follow(model, STEP_S, STEPS)
        moved, largest = motion.energy - motion.energy[0], motion.kinetic.max()
        at_one_second = [follow(model, STEP_S / n, STEPS).path.pose.position[1000 * n] for n in (1, 2, 4)]
        coarse, fine = (np.linalg.norm(np.subtract(*at_one_second[i : i + 2])) for i in (0, 1))
        print(
            f"{drawn.name:34s}  {np.abs(moved).max() / largest:11.1e}   {moved[-50:].mean() / largest:+12.1e}   "
            f"{motion.open_m.max():14.1e}   {np.log2(coarse / fine):5.3f}   {motion.path.iterations.mean():.2f}"
        )


if __name__ == "__main__":
    main()
