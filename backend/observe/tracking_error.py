"""The one way in which reading a clip fails."""

from __future__ import annotations


class TrackingError(ValueError):
    """A clip, its bed marks or its dots cannot be used; the sentence says what was found and what to do."""
