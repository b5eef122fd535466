"""Clips with nothing in them, for a service that looks at their boxes alone."""

from __future__ import annotations

import struct


def box(kind: bytes, content: bytes = b"") -> bytes:
    """One box of an MP4."""
    return struct.pack(">I4s", 8 + len(content), kind) + content


def clip(size: int = 1000) -> bytes:
    """What it is, its index, and what was filmed."""
    return box(b"ftyp", b"isom\0\0\2\0isomiso2mp41") + box(b"moov") + box(b"mdat", bytes(size))
