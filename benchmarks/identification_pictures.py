"""The search, the linkage and the errors of one identification, drawn.

python -m benchmarks.identification_pictures [FILE]      three minutes

Ten cells with 1 mm of play and 0.01 N m s/rad at every pin, moved by Exudyn, 0.2 mm of noise; searches begin at half
the play and three times the friction, as in `benchmarks.identification`.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline

from backend.mechanism.mechanism import Mechanism
from backend.simulate.run import Run, simulate
from benchmarks.identification import (
    FRICTION,
    NODES_S,
    RATE_HZ,
    Case,
    drawn,
    filmed,
    found,
    marker_paths,
    study_of,
    unscaled,
    values,
)
from benchmarks.scissor import LENGTH_M

CASE = Case("viscous", "Exudyn", step_s=2.5e-4)
SHOWN_S = (0.0, 0.1, 0.19)
BEGUN, ENDED = "tab:orange", "tab:blue"


def at_samples(mechanism: Mechanism, motion: Run, times: np.ndarray) -> np.ndarray:
    """(T, markers, 2) in W [m]."""
    paths = marker_paths(mechanism, motion)[..., :2]
    return CubicSpline(np.arange(len(paths)) * CASE.step_s, paths)(times)


def bars(axes: Axes, mechanism: Mechanism, motion: Run, time_s: float, colour: str) -> None:
    """Every bar as a line."""
    node = round(time_s / CASE.step_s)
    for body in (b.id for b in mechanism.bodies if b.id[0] in "ab"):
        x, (w, _, _, z) = motion.position_m[body][node], motion.quaternion_wxyz[body][node]
        half = 0.5 * LENGTH_M * np.array([w * w - z * z, 2 * w * z])
        axes.plot(*(1e3 * np.stack([x[:2] - half, x[:2] + half], -1)), color=colour, lw=0.8)


def draw(
    histories: dict[str, list[float]],
    clean: np.ndarray,
    noisy: np.ndarray,
    ended: Sequence[float],
    path: Path,
) -> None:
    """Objective over iterations, errors in time, and the linkage at three times."""
    figure, places = plt.subplot_mosaic(
        [["search", "errors"], *([f"{1e3 * at:.0f} ms"] * 2 for at in SHOWN_S)],
        figsize=(11, 9), height_ratios=(3, 1, 1, 1), layout="constrained",
    )  # fmt: skip
    search, errors, *stages = places.values()
    for name, history in histories.items():
        search.semilogy(history, ".-", label=name)
    search.set(xlabel="iteration", ylabel="half the sum of squares, in sigmas", title="the search")
    search.legend(fontsize=8)
    times, begun = np.arange(len(clean)) / RATE_HZ, (0.5 * CASE.radial_m, 3.0 * FRICTION)
    for name, colour, of in (("begun with", BEGUN, begun), ("found", ENDED, ended)):
        mechanism = drawn(CASE, of[0], of[1])
        motion = simulate(mechanism, CASE.steps * NODES_S, CASE.step_s)
        error = 1e3 * np.linalg.norm(at_samples(mechanism, motion, times) - clean, axis=-1)[1:]
        errors.semilogy(1e3 * times[1:], error.mean(1), color=colour, label=name)
        errors.fill_between(1e3 * times[1:], *np.quantile(error, (0.1, 0.9), axis=1), color=colour, alpha=0.2)
        for axes, time_s in zip(stages, SHOWN_S, strict=True):
            bars(axes, mechanism, motion, time_s, colour)
    errors.axhline(1e3 * CASE.noise_m, color="k", lw=0.8, ls=":", label="noise of a sample")
    errors.set(
        xlabel="time since the release, ms", ylabel="mm off Exudyn's motion", title="20 markers: mean, 10% to 90%"
    )
    errors.set_ylim(1e-3, 30.0)
    errors.legend(fontsize=8)
    for axes, time_s, title in zip(stages, SHOWN_S, list(places)[2:], strict=True):
        axes.plot(*(1e3 * noisy[int(np.argmin(np.abs(times - time_s)))].T), "k.", ms=4)
        axes.set(ylabel="y, mm", aspect="equal", xlim=(-30, 1280), ylim=(-100, 100))
        axes.set_title(title, loc="left", fontsize=9)
    stages[-1].set_xlabel("x, mm; dots: as filmed")
    figure.savefig(path, dpi=110)


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/pictures/identification.png")
    time_s, seen = filmed(CASE)
    study = study_of(CASE, time_s, seen, seed=3)
    ours = found(CASE, study)
    scaled = found(CASE, study, "lbfgsb")
    naive = unscaled(ours, ours.residuals.start)
    histories = {
        "ours, over growing records": [h.objective for h in ours.report.history],
        "L-BFGS-B, scaled, likewise": [h.objective for h in scaled.report.history],
        "L-BFGS-B, unscaled, whole record": [h.objective for h in naive.history],
    }
    ended = values(CASE, ours), values(CASE, scaled), naive.x[:2]
    for (name, history), at in zip(histories.items(), ended, strict=True):
        off = 100 * (at / CASE.truth - 1)
        print(f"{name:32} {len(history):3} iterations: play {off[0]:+.2f}%, friction {off[1]:+.2f}%")
    paths = seen[0][..., :2]
    noisy = paths + CASE.noise_m * np.random.default_rng(3).standard_normal(paths.shape)
    draw(histories, paths, noisy, values(CASE, ours).tolist(), path)


if __name__ == "__main__":
    main()
