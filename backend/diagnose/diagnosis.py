"""What a diagnosis begins from and what it comes to."""

from __future__ import annotations

from dataclasses import dataclass

from backend.diagnose.adequacy import Adequacy
from backend.diagnose.belief import Belief
from backend.diagnose.cause import Cause
from backend.diagnose.latent import Latent
from backend.diagnose.screen import Screen
from backend.diagnose.shrink import Test
from backend.diagnose.subject import Subject
from backend.diagnose.where import Trace
from backend.mechanism.gap_report import GapReport


@dataclass(frozen=True)
class Drawn:
    """The drawing as it is, and what was learnt about its motion before any cause is sought.

    about: first-order gains of the library. latent: responses to what is unknown. p: of as large a misfit where nothing
    is amiss. model_free: log evidence of unknown forces or shifts at each place. tests: on held-out experiments.
    """

    cause: Cause
    about: Screen
    latent: Latent
    adequacy: Adequacy
    p: float
    model_free: dict[str, float]
    tests: tuple[Test, ...]

    @property
    def whole(self) -> bool:
        """Whether it follows the whole of the records."""
        return self.cause.fitted.fraction == 1.0


@dataclass(frozen=True)
class Diagnosis:
    """The report and what its pictures are drawn from. before, after: held-out tests (or none)."""

    report: GapReport
    subject: Subject
    baseline: Cause
    best: Cause
    belief: Belief
    model_free: dict[str, float]
    missing: Trace | None
    before: tuple[Test, ...]
    after: tuple[Test, ...]
    scale: float
