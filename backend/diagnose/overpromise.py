"""What first order promises too much: laws of unknown form are weighed by it, named causes by their fits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backend.diagnose.adequacy import scaled
from backend.diagnose.belief import log_prior
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.fitted import log_evidence
from backend.diagnose.latent import evidence, log_mean
from backend.diagnose.screen import library_slopes
from backend.diagnose.subject import SAME
from backend.diagnose.unknown import without_causes


def overpromise(best: Cause, causes: Sequence[Cause], scale: float) -> float:
    """How much more [nats] fitted causes promise to first order in place of the best one than their fits brought.

    What is not linear in the causes' share of the motion flatters laws of unknown form and named ones alike: to first
    order about one motion friction of one kind may leave less than the same friction leaves once it is fitted.
    """
    subject = best.fitted.subject
    bare, S = scaled(without_causes(best.fitted), scale), library_slopes(best.fitted, SAME, best.candidates) / scale
    count = len(subject.library.candidates)

    def weight(members: Sequence[Candidate], z: float) -> float:
        return log_prior(len(members), count) + sum(c.log_odds for c in members) + z

    def promised(members: Sequence[Candidate]) -> float:
        L = np.concatenate([S @ c.ties(S.shape[1]) for c in members], 1)
        moves = np.linalg.norm(L, axis=0)
        return weight(members, log_mean(evidence(bare, L[:, moves > 0] / moves[moves > 0])))

    own = [c for c in causes if c.fitted.subject is subject]
    found = [weight(c.candidates, log_evidence(scaled(c.fitted, scale))) for c in own]
    ahead = float(np.logaddexp.reduce([promised(c.candidates) for c in own])) - promised(best.candidates)
    came = float(np.logaddexp.reduce(found)) - weight(best.candidates, log_evidence(scaled(best.fitted, scale)))
    return max(0.0, ahead - came)
