"""The fitted twin on disk, as one file that another simulator loads."""

from pathlib import Path
from typing import Literal

from backend.export.fitted import fitted
from backend.export.gather import gather
from backend.export.markup import Written
from backend.export.mjcf import mjcf
from backend.export.urdf import urdf
from backend.mechanism.fit_report import FitReport
from backend.mechanism.mechanism import Mechanism

Format = Literal["mjcf", "urdf"]
FILES: dict[Format, str] = {"mjcf": "twin.xml", "urdf": "twin.urdf"}


def write_twin(
    mechanism: Mechanism,
    folder: str | Path,
    report: FitReport | None = None,
    format: Format = "mjcf",
    step_s: float | None = None,
) -> tuple[Path, Written]:
    """Write twin.xml (MJCF) or twin.urdf; returns its path and what was written.

    report: fitted values that replace drawn ones.  step_s: MuJoCo's time step [s], chosen if not given; URDF
    holds none.
    Raises ValueError where the drawing cannot be assembled, where fit.json belongs to another drawing, and where URDF
    cannot say it.
    """
    if step_s is not None and not step_s > 0.0:
        raise ValueError(f"step is {step_s:g} s; give a positive number of seconds")
    twin = gather(fitted(mechanism, report) if report else mechanism)
    written = mjcf(twin, step_s) if format == "mjcf" else urdf(twin)
    path = Path(folder) / FILES[format]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(written.text, encoding="utf-8")
    return path, written
