"""What a fit says of the cameras that took its clips: the calibration's numbers, as the data moved them."""

from __future__ import annotations

import numpy as np

from backend.fit.identifiability import Uncertainty
from backend.fit.residual import Residuals
from backend.fit.solve import Solution
from backend.mechanism.fit_report import CameraNumber, FittedCamera

UNITS = {"_px": "px", "_rad": "rad", "_m": "m"}  # by the end of a number's name


def fitted_cameras(residuals: Residuals, solution: Solution, uncertainty: Uncertainty) -> tuple[FittedCamera, ...]:
    """Every camera file with its lens, pose and heights before and after; numbers that it holds fixed are left out."""
    found = []
    for source, z in residuals.camera_numbers(np.arange(solution.x.size)).items():
        eye = residuals.cameras[source]
        change = eye.root @ solution.x[z]
        sd = np.sqrt(np.sum((eye.root @ uncertainty.covariance[np.ix_(z, z)]) * eye.root, 1))
        known = np.sqrt(np.diag(np.array(eye.pose.covariance)))
        numbers = [
            CameraNumber(
                name=name, value=float(eye.values[k] + change[k]), sd=float(sd[k]),
                calibrated=float(eye.values[k]), calibrated_sd=float(known[k]), unit=_unit(name),
            )
            for k, name in enumerate(eye.names) if known[k] > 0
        ]  # fmt: skip
        films = tuple(run.experiment.id for run in residuals.filmed(source))
        found.append(FittedCamera(file=source.name, experiments=films, numbers=tuple(numbers)))
    return tuple(found)


def _unit(name: str) -> str:
    return next((unit for end, unit in UNITS.items() if name.partition(" of ")[0].endswith(end)), "1")
