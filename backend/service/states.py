"""What things and jobs may be: the words that records, answers and clients share."""

from __future__ import annotations

from typing import Literal

Kind = Literal["mechanism", "study", "video"]
State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
FINISHED = ("succeeded", "failed", "cancelled")
