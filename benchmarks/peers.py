"""Our motions beside two engines nobody here wrote, on the same mechanism.json.

python -m benchmarks.peers
"""

import time
from pathlib import Path

import numpy as np

from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.blind.poses import PeerMotion
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from backend.simulate.run import Run, simulate
from benchmarks.scissor import scissor

SAMPLES = Path(__file__).parents[1] / "samples"
DURATION_S, STEP_S, SEEN_S = 1.0, 2.5e-4, 1e-2


def largest_difference_rad(ours: Run, peer: PeerMotion) -> float:
    """Over every joint's coordinate and every sample [rad, or m at a slide]."""
    every = round(SEEN_S / ours.step_s)
    return max(float(np.abs(q[::every] - peer.joint_positions[joint]).max()) for joint, q in ours.q.items())


def compare(name: str, mechanism: Mechanism) -> None:
    """Print one line: our conservation, and how far each engine is from us."""
    begin = time.perf_counter()
    ours = simulate(mechanism, DURATION_S, STEP_S)
    ours_s = time.perf_counter() - begin
    energy = ours.kinetic_j + ours.potential_j
    line = f"{name:>14}  travel {max(np.ptp(q) for q in ours.q.values()):5.2f}"
    line += f"  dE/KE {np.abs(energy - energy[0]).max() / ours.kinetic_j.max():.1e}"
    line += f"  constraint {ours.constraint_error_m.max():.1e} m  ({ours_s:.0f} s)"
    for engine, settings in ((simulate_exudyn, {"step_s": 5e-4, "extrapolated": True}), (simulate_mujoco, {})):
        begin = time.perf_counter()
        peer = engine(mechanism, DURATION_S, output_step_s=SEEN_S, **settings)
        spent = time.perf_counter() - begin
        line += f"  {peer.engine} {largest_difference_rad(ours, peer):.1e} ({spent:.0f} s)"
    print(line, flush=True)


if __name__ == "__main__":
    print(f"largest difference of a joint coordinate over {DURATION_S:g} s; ours at h = {STEP_S * 1e3:g} ms")
    for sample in ("pendulum", "double_pendulum", "fourbar", "slider_crank", "bennett"):
        compare(sample, read_mechanism(SAMPLES / sample / "mechanism.json"))
    for cells in (5, 10):
        compare(f"scissor {cells}", scissor(cells))
