"""A simulated motion on disk, as run.h5."""

from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np

from backend.simulate.run import Run


def write_run(run: Run, path: str | Path) -> Path:
    """Write run.h5 (names as in docs/mechanism.md); returns its path."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file.attrs.update(mechanism=run.mechanism, step_s=run.step_s, version=version("linktwin"), result=run.result)
        file.attrs["solve"] = run.solve
        for name, values in _tables(run):
            file.create_dataset(name, data=values, compression="gzip", shuffle=True)
    return path


def _tables(run: Run) -> list[tuple[str, np.ndarray]]:
    tables = [
        ("time_s", run.time_s),
        ("energy_j/kinetic", run.kinetic_j),
        ("energy_j/potential", run.potential_j),
        ("constraint_error_m", run.constraint_error_m),
    ]
    for field in ("position_m", "quaternion_wxyz", "velocity_m_per_s", "angular_velocity_rad_per_s"):
        tables += [(f"bodies/{body}/{field}", values) for body, values in getattr(run, field).items()]
    still = np.zeros((len(run.time_s), 3))
    for body, pose in run.standing.items():
        fields = {
            "position_m": still + pose[:3],
            "quaternion_wxyz": np.tile(pose[3:], (len(run.time_s), 1)),
            "velocity_m_per_s": still,
            "angular_velocity_rad_per_s": still,
        }
        tables += [(f"bodies/{body}/{field}", values) for field, values in fields.items()]
    for field in ("q", "reaction_force_n", "reaction_torque_n_m"):
        tables += [(f"joints/{joint}/{field}", values) for joint, values in getattr(run, field).items()]
    tables += [(f"markers/{marker}/position_m", values) for marker, values in run.markers_m.items()]
    return tables
