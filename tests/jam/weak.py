"""A weightless bar turned against dry friction and nothing else: it jams where friction exceeds the drive."""

from backend.mechanism.mechanism import Mechanism
from tests.mechanisms import WEIGHTLESS, Z, bar, drawing, effect

DRIVE, DRY = "applied_torque:drive.torque_n_m", "coulomb_friction:pin.friction_torque_n_m"
RUN = {"duration_s": 0.05, "step_s": 1e-3}


def weak_bar(torque_n_m: float = 0.01, dry_n_m: float = 0.01) -> Mechanism:
    """One freedom and few effects: its program compiles fast."""
    link = bar("link", (0, 0, 0), (0.2, 0, 0), 0.1)
    effects = [
        effect("dry", "coulomb_friction", ["pin"], friction_torque_n_m=dry_n_m),
        effect("drive", "applied_torque", ["link"], torque_n_m=torque_n_m, axis=[0, 0, 1]),
    ]
    pins = [("pin", "revolute", "ground", "link", (0, 0, 0), Z)]
    return drawing("weak bar", [link], pins, effects, gravity=WEIGHTLESS)
