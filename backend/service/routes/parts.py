"""A part of a file, as `Range` asks for it (RFC 9110, section 14).  Who asks for several at once gets the whole."""

from __future__ import annotations

import re

from pydantic import BaseModel, Field

from backend.service.problems import Problem

ONE = re.compile(r"bytes=([0-9]{0,18})-([0-9]{0,18})", re.IGNORECASE)


class PartAsked(BaseModel):
    """The headers that ask for a part."""

    range: str | None = Field(None, description="One part of the file: `bytes=0-1023`, `bytes=1024-`, `bytes=-100`.")
    if_range: str | None = Field(None, description="The ETag of the file whose part is meant; of another, all is sent.")


def part_of(size: int, etag: str, asked: PartAsked) -> range | None:
    """Which of so many bytes are asked for; None for all, also where what is asked for need not be granted.

    Raises Problem `no-such-part`.
    """
    found = ONE.fullmatch((asked.range or "").strip())
    if found is None or asked.if_range not in (None, etag):
        return None
    first, last = (int(text) if text else None for text in found.groups())
    if first is None:
        if last is None:
            return None
        part = range(max(0, size - last), size)
    elif last is not None and last < first:
        return None
    else:
        part = range(first, size if last is None else min(last + 1, size))
    if not part:
        raise Problem(
            "no-such-part", f"{(asked.range or '').strip()} is asked for, and the file has {size} bytes; ask for less.",
            headers={"Content-Range": f"bytes */{size}"},
        )  # fmt: skip
    return part
