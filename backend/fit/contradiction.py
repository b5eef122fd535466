"""Whether the data contradict a camera's calibration: it had to move farther than its covariance allows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from backend.fit.residual import Residuals

FALSE_ALARMS = 1e-3  # fits of a right camera that are warned of


def contradictions(residuals: Residuals, x: np.ndarray) -> Iterator[str]:
    """A sentence for each camera file that does not fit its clip."""
    for source, z in residuals.camera_numbers(x).items():
        if float(z @ z) < chi2.isf(FALSE_ALARMS, max(z.size, 1)):
            continue
        eye = residuals.cameras[source]
        change, sd = eye.root @ z, np.sqrt(np.sum(eye.root**2, axis=1))
        score = np.divide(change, sd, out=np.zeros_like(change), where=sd > 0)
        worst = int(np.abs(score).argmax())
        films = ", ".join(f"'{r.experiment.id}'" for r in residuals.filmed(source))
        yield (
            f"The data of {films} contradict {source.name}: to fit, the camera had to move by "
            f"{np.sqrt(float(z @ z)):.1f} deviations of its calibration in all (usual: {np.sqrt(z.size):.1f}), most in "
            f"{eye.names[worst]}: {eye.values[worst] + change[worst]:.5g} against {eye.values[worst]:.5g}, sd "
            f"{sd[worst]:.2g}. Calibrate again at the clip's setting, or find what moved between calibration and clip; "
            "until then do not trust the fitted values."
        )
