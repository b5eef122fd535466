"""Four releases of a real pendulum, as a camera would have seen them: SciPy moves it, dry friction holds it back.

Nothing of linktwin's own physics is used. `python samples/pendulum/measure.py` writes study.json and one table a run
into samples/pendulum/measured/, always the same.
"""

import json
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).parent
GRAVITY = 9.80665
FRICTION_N_M = 2.5e-3  # at the pivot; the drawing has none
CREEP_RAD_PER_S = 0.01  # below it the dry friction of the pivot gives way like a very stiff fluid
NOISE_M = 4e-4
RATE, HELD_S, MOVING_S = 60.0, 0.25, 2.0
RUNS = {"low": (20.0, "fit"), "middle": (45.0, "fit"), "high": (75.0, "fit"), "far": (60.0, "held_out")}


def main() -> None:
    """Write the study."""
    drawn = json.loads((HERE / "mechanism.json").read_text())
    link = next(body for body in drawn["bodies"] if body["id"] == "link")
    mass, (arm, _, _) = link["inertial"]["mass_kg"], link["inertial"]["center_of_mass_m"]
    inertia = link["inertial"]["inertia_kg_m2"]["zz"] + mass * arm**2
    rng, out = np.random.default_rng(20261122), HERE / "measured"
    out.mkdir(exist_ok=True)

    def slope(t: float, y: np.ndarray) -> list[float]:
        rub = FRICTION_N_M * np.tanh(y[1] / CREEP_RAD_PER_S)
        return [y[1], (-mass * GRAVITY * arm * np.sin(y[0]) - rub) / inertia]

    experiments = []
    for run, (angle, use) in RUNS.items():
        still, moving = round(HELD_S * RATE), (np.arange(round(MOVING_S * RATE)) + 0.5) / RATE
        start = [np.radians(angle), 0.0]
        found = solve_ivp(slope, (0.0, moving[-1]), start, t_eval=moving, rtol=1e-9, atol=1e-11, max_step=1e-3)
        angles = np.concatenate([np.full(still, start[0]), found.y[0]])
        times = (np.arange(len(angles)) + 0.5) / RATE
        lines = ["time_s,marker,x_m,y_m,z_m,sigma_m"]
        for marker in drawn["markers"]:
            reach = marker["position_m"][0]
            place = reach * np.stack([np.sin(angles), -np.cos(angles)], 1) + NOISE_M * rng.standard_normal(
                (len(angles), 2)
            )
            lines += [f"{t:.6f},{marker['id']},{x:.6f},,{z:.6f}," for t, (x, z) in zip(times, place, strict=True)]
        (out / f"{run}.csv").write_text("\n".join(lines) + "\n")
        release = {"time_s": HELD_S, "at_rest": True}
        experiments.append({"id": run, "use": use, "tracks": f"{run}.csv", "release": release})
    study = {"schema_version": "1.0", "mechanism": "../mechanism.json", "experiments": experiments}
    (out / "study.json").write_text(json.dumps(study, indent=1) + "\n")


if __name__ == "__main__":
    main()
