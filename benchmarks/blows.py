"""Where bouncing walls would gain energy: two of them struck within the same few steps, not in the same one.

python -m benchmarks.blows

First the scheme of Paoli and Schatzman (2002) by itself, a point in the plane of two walls, masses coupled by c: 3000
random blows per row.  A wall's blow takes two steps, and what it gives back is told by its gaps before; a blow of the
other wall in between has changed the motion that those gaps tell of.  Then a slider-crank, every pin loose by 0.5 mm,
as it is simulated: no wall gives back more than it took (`backend/simulate/giving.py`).
"""

import numpy as np

from backend.simulate.run import simulate
from tests.mechanisms import effect, slider_crank

RESTITUTIONS, COUPLINGS, BLOWS, STEPS = (0.0, 0.5, 0.7, 0.9, 1.0), (0.0, 0.5, -0.5, 0.9, -0.9), 3000, 40
ACTIVE = ((), (0,), (1,), (0, 1))
STEPS_S, DURATION_S, DIP_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4), 0.4, 6e-3
PINS = ["main", "crankpin", "wrist"]


def kept(e: float, mass: np.ndarray, gap: np.ndarray, velocity: np.ndarray) -> float:
    """Share of the energy that is left when a point has met two walls; gaps in steps, velocities a step."""
    mobility, back = np.linalg.inv(mass), gap - velocity
    before = velocity @ mass @ velocity
    for _ in range(STEPS):
        free = 2 * gap - back
        for walls in map(list, ACTIVE):
            push = np.zeros(2)
            if walls:
                push[walls] = np.linalg.solve(mobility[np.ix_(walls, walls)], -(free + e * back)[walls])
            ahead = free + mobility @ push
            if push.min() >= -1e-12 and (ahead + e * back).min() >= -1e-9:
                break
        back, gap = gap, ahead
    velocity = gap - back
    return float(velocity @ mass @ velocity / before)


def gained(restitution: float, step_s: float) -> float:
    """Largest growth of a slider-crank's energy over its largest kinetic energy; nodes of blows show dips."""
    play = effect("play", "clearance", PINS, radial_m=5e-4, restitution=restitution)
    run = simulate(slider_crank(effects=[play]), DURATION_S, step_s)
    around = round(DIP_S / step_s)
    seen = np.lib.stride_tricks.sliding_window_view(run.kinetic_j + run.potential_j, around).max(1)
    return float(np.max(seen - np.minimum.accumulate(seen)) / run.kinetic_j.max())


def main() -> None:
    random = np.random.default_rng(0)
    print("two walls: largest energy after over before, and share of blows that gain")
    print(f"{'e':>6}" + "".join(f"{f'c {c:g}':>18}" for c in COUPLINGS))
    for e in RESTITUTIONS:
        cells = []
        for c in COUPLINGS:
            mass = np.array([[1.0, c], [c, 1.0]])
            ways = random.normal(size=(BLOWS, 2))
            left = np.array([kept(e, mass, random.uniform(2, 6, 2), v) for v in ways if v.min() < 0.0])
            cells.append(f"{left.max():10.3f} {(left > 1 + 1e-9).mean():6.1%}")
        print(f"{e:6.1f}" + "".join(f"{cell:>18}" for cell in cells), flush=True)
    print("slider-crank: growth of the energy over the largest kinetic energy")
    print(f"{'e':>6}" + "".join(f"{1e3 * h:>9g} ms" for h in STEPS_S))
    for e in (0.5, 0.7, 0.9, 1.0):
        print(f"{e:6.1f}" + "".join(f"{gained(e, h):12.2%}" for h in STEPS_S), flush=True)


if __name__ == "__main__":
    main()
