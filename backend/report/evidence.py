"""What a report shows, as plain arrays: whoever fits or simulates fills these in and knows nothing of pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from backend.mechanism.fit_report import FitReport
from backend.mechanism.gap_report import GapReport
from backend.mechanism.jam_report import JamReport
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.study import Use


@dataclass(frozen=True)
class Channel:
    """One measured coordinate of one experiment beside its simulations, all at the measured instants.

    at: `marker:ID` or `joint:ID`. component: `x`, `y`, `z` (W) or `q`. unit: SI, `m` or `rad`.
    measured: NaN where nothing was measured. before: the drawing as it was; after: the fitted twin.
    sigma: standard deviation of the measurement noise. release_s: when the mechanism was let go.
    """

    experiment: str
    use: Use
    at: str
    component: str
    unit: str
    time_s: Float[np.ndarray, "t"]
    measured: Float[np.ndarray, "t"]
    before: Float[np.ndarray, "t"] | None
    after: Float[np.ndarray, "t"]
    sigma: float | None = None
    release_s: float | None = None

    def __post_init__(self):
        for name in ("measured", "before", "after"):
            value = getattr(self, name)
            if value is not None and np.shape(value) != np.shape(self.time_s):
                raise ValueError(
                    f"{self.experiment}, {self.at} {self.component}: {name} has shape {np.shape(value)}, "
                    f"time_s {np.shape(self.time_s)}. Give every series at the measured instants."
                )

    def rms(self, of: Float[np.ndarray, "t"]) -> float:
        """Root mean square of measured - of, over what was measured [unit]."""
        residual = (self.measured - of)[np.isfinite(self.measured)]
        return float(np.sqrt(np.mean(residual**2))) if residual.size else float("nan")


@dataclass(frozen=True)
class Motion:
    """A motion of all bodies, in W: positions of body origins [m] and quaternions [w, x, y, z], body to world."""

    time_s: Float[np.ndarray, "t"]
    position_m: Mapping[str, Float[np.ndarray, "t 3"]]
    quaternion_wxyz: Mapping[str, Float[np.ndarray, "t 4"]]


@dataclass(frozen=True)
class Overlay:
    """One experiment to be played back: the fitted motion, the drawn one, and the markers that were seen."""

    experiment: str
    after: Motion
    before: Motion | None = None
    seen_time_s: Float[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0))
    seen_m: Mapping[str, Float[np.ndarray, "n 3"]] = field(default_factory=dict)
    held_out: bool = False


@dataclass(frozen=True)
class FitEvidence:
    """A fit and what it rests on. truth: fitted parameter name -> value, where somebody knows it."""

    title: str
    mechanism: Mechanism
    report: FitReport
    channels: tuple[Channel, ...]
    overlays: tuple[Overlay, ...] = ()
    truth: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SimulationEvidence:
    """A simulated motion. joint_positions: `q` per joint [rad or m]; result: its sentence.

    redundancy: which rows are redundant and which reactions therefore not unique, in a sentence; empty if none.
    forces_page: page of the joint forces beside this one; empty if none was written.
    """

    mechanism: Mechanism
    motion: Motion
    joint_positions: Mapping[str, Float[np.ndarray, "t"]]
    kinetic_j: Float[np.ndarray, "t"]
    potential_j: Float[np.ndarray, "t"]
    constraint_error_m: Float[np.ndarray, "t"]
    step_s: float
    result: str = ""
    redundancy: str = ""
    forces_page: str = ""


@dataclass(frozen=True)
class JamEvidence:
    """What was found of a motion that may have jammed; `report` has its series, `motion` every node."""

    mechanism: Mechanism
    motion: Motion
    report: JamReport


@dataclass(frozen=True)
class Missing:
    """What acts on one joint in one experiment and is not in the drawing [N m or N]: mean and sd against time.

    time_s: from the release.
    """

    experiment: str
    time_s: Float[np.ndarray, "t"]
    mean: Float[np.ndarray, "t"]
    sd: Float[np.ndarray, "t"]


@dataclass(frozen=True)
class GapEvidence:
    """A diagnosis and what its pictures are drawn from.

    pose: one instant, at the release of the first fitted experiment. missing: at the place `missing_at`, in
    `missing_unit`, along `missing_along` where that is an axis of W, one an experiment. channels: of one experiment,
    after: with the best cause; set_aside: how many of its samples were found to be wrong and are left out. overlays:
    motions to be played back, after: with the best cause.
    """

    mechanism: Mechanism
    report: GapReport
    pose: Motion
    missing: tuple[Missing, ...] = ()
    missing_at: str = ""
    missing_unit: str = "N m"
    missing_along: str = ""
    channels: tuple[Channel, ...] = ()
    set_aside: int = 0
    overlays: tuple[Overlay, ...] = ()


@dataclass(frozen=True)
class DemoEvidence:
    """The whole story. stills: (time_s, PNG bytes) of the clip. frames: how many the clip holds.

    reality: in words, what the real mechanism had that the drawing lacked. steps: (what was done, seconds).
    """

    fit: FitEvidence
    reality: str
    frames: int
    frames_per_s: float
    stills: tuple[tuple[float, bytes], ...]
    prediction: tuple[Channel, ...]
    unseen: str
    steps: tuple[tuple[str, float], ...] = ()
    files: tuple[str, ...] = ()
