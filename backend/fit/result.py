"""What a fit found, as data: fit.json, and the curves for its overlays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from backend.fit.identifiability import Profile, Uncertainty
from backend.fit.residual import Residuals
from backend.fit.run import Run
from backend.fit.solve import Iteration, Solution
from backend.fit.unstated import Allowed
from backend.mechanism import fit_report
from backend.mechanism.fit_report import FitReport


@dataclass(frozen=True)
class Overlay:
    """One joint, marker or sensor of one experiment: measured beside simulated.

    at: `joint:ID` or `marker:ID`; coordinates: what the k columns are (`q`, `x_m`, `effort`, ...). time_s is as
    stated in the data. before: with the drawing as it was; after: fitted; NaN where a motion was lost.
    """

    experiment: str
    use: str
    at: str
    unit: str
    coordinates: tuple[str, ...]
    time_s: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, "n k"]
    sigma: Float[np.ndarray, "n k"]
    before: Float[np.ndarray, "n k"]
    after: Float[np.ndarray, "n k"]
    release_s: float


@dataclass(frozen=True)
class FitResult:
    """A finished fit. `report` is fit.json; the rest serves reports and diagnosis.

    values: fitted numbers by name, in the order of report.parameters. residuals and solution: the least-squares
    problem and where it ended, with every unknown (starts included). spread: misfit in noise sigmas, rms. held_out:
    the experiments that were not fitted, each seen through its camera as others of that camera have found it.
    """

    report: FitReport
    overlays: tuple[Overlay, ...]
    values: dict[str, float]
    residuals: Residuals
    solution: Solution
    uncertainty: Uncertainty
    spread: float
    held_out: tuple[Run, ...] = ()

    def rms(self, use: str, unit: str, before: bool = False) -> float:
        """Root mean square error over all samples in motion of one use and unit; inf where a motion was lost."""
        squares, count = 0.0, 0
        for o in self.overlays:
            if o.use == use and o.unit == unit:
                miss = ((o.before if before else o.after) - o.measured)[o.time_s >= o.release_s]
                seen = np.isfinite(o.measured[o.time_s >= o.release_s])
                squares += float(np.sum(miss[seen] ** 2))
                count += int(seen.sum())
        return float(np.sqrt(squares / count)) if count and np.isfinite(squares) else np.inf

    def write(self, folder: str | Path) -> Path:
        """Write fit.json into a folder, made if need be; returns its path."""
        path = Path(folder) / "fit.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.report.model_dump(mode="json"), indent=1, ensure_ascii=False, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")
        return path


def overlays_of(run: Run, before: np.ndarray, after: np.ndarray) -> list[Overlay]:
    """Overlays of one run from its flat predictions."""
    data = run.data
    places: dict[tuple[str, str], list[int]] = {}
    for i, c in enumerate(data.channels):
        places.setdefault((c.at, c.unit), []).append(i)
    made = []
    for (at, unit), channels in places.items():
        time = np.unique(np.concatenate([data.time_s[data.of(i)] for i in channels]))
        table = np.full((4, time.size, len(channels)), np.nan)
        for k, i in enumerate(channels):
            rows = data.of(i)
            slot = np.searchsorted(time, data.time_s[rows])
            for layer, source in enumerate((data.value, data.sigma, before, after)):
                table[layer, slot, k] = source[rows]
        names = tuple(data.channels[i].coordinate for i in channels)
        experiment = run.experiment
        made.append(Overlay(experiment.id, experiment.use, at, unit, names, time, *table, release_s=data.release_s))
    return made


def residual_of(overlay: Overlay) -> fit_report.Residual | None:
    """Root mean square distance of one overlay after the release; None where a motion was lost."""
    moving = overlay.time_s >= overlay.release_s

    def rms(miss: np.ndarray) -> float | None:
        size = float(np.sqrt(np.nanmean(np.nansum(miss[moving] ** 2, axis=1)))) if moving.any() else np.nan
        return size if np.isfinite(size) else None

    seen = np.isfinite(overlay.measured)
    lost = np.any(~np.isfinite(overlay.after[moving]) & seen[moving])
    after = None if lost else rms(overlay.after - overlay.measured)
    if after is None:
        return None
    before_lost = np.any(~np.isfinite(overlay.before[moving]) & seen[moving])
    return fit_report.Residual(
        experiment=overlay.experiment, use=overlay.use, at=overlay.at, rms=after,  # type: ignore[arg-type]
        before=None if before_lost else rms(overlay.before - overlay.measured),
        noise=rms(np.where(seen, overlay.sigma, np.nan)), unit=overlay.unit, count=int(moving.sum()),
    )  # fmt: skip


def make_report(
    residuals: Residuals,
    solution: Solution,
    uncertainty: Uncertainty,
    profiles: dict[str, Profile],
    history: Sequence[Iteration],
    overlays: Sequence[Overlay],
    wall_s: float,
    warnings: Sequence[str],
    allowed: Allowed,
    deviations: Sequence[fit_report.Deviation] = (),
    cameras: Sequence[fit_report.FittedCamera] = (),
) -> FitReport:
    """fit.json from what the fit left behind. Starts are marginalised: only parameters appear."""
    found = []
    identified = []
    p = len(residuals.parameters)
    sd, rho = uncertainty.sd, uncertainty.correlation
    for i, f in enumerate(residuals.parameters):
        x, known = float(solution.x[i]), bool(np.isfinite(sd[i]))
        profile = profiles.get(f.name)
        low, high = (x + allowed.ends[i]).tolist()
        ci95 = (max(low, f.lower), min(high, f.upper)) if known else None
        found.append(
            fit_report.FittedParameter(
                name=f.name, kind=f.kind, on="all" if f.label == "all" else f.on, parameter=f.parameter, value=x,
                sd=float(sd[i]) if known else None, ci95=ci95, unit=f.unit, at_bound=solution.at_bound[i],
            )
        )  # fmt: skip
        own = [w for w in uncertainty.warnings if f.name in w]
        identified.append(
            fit_report.Identifiability(
                name=f.name, information=float(uncertainty.information[i]),
                profile=(profile.lower, profile.upper) if profile else None,
                weakest_direction=uncertainty.weakest or None, warning=" ".join(own) or None,
            )
        )  # fmt: skip
    blind = np.array(uncertainty.unidentified[:p], bool)
    correlation = tuple(tuple(None if blind[i] or blind[j] else float(rho[i, j]) for j in range(p)) for i in range(p))
    rows = [r for o in overlays if (r := residual_of(o)) is not None]
    return FitReport(
        parameters=tuple(found), correlation=correlation, identifiability=tuple(identified),
        history=tuple(
            fit_report.Iteration(
                iteration=i, objective=h.objective, gradient_norm=h.gradient_norm,
                parameters={f.name: float(h.parameters[k]) for k, f in enumerate(residuals.parameters)},
            )
            for i, h in enumerate(history)
        ),
        residuals=tuple(r for r in rows if r.use == "fit"),
        held_out=tuple(r for r in rows if r.use == "held_out"),
        converged=solution.converged, wall_s=wall_s, message=solution.message, warnings=tuple(warnings),
        deviations=tuple(deviations), cameras=tuple(cameras), unstated=allowed.rows(),
    )  # fmt: skip
