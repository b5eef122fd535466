"""What tests say of an answer."""

from __future__ import annotations

from typing import Any

import httpx


def refused(answer: httpx.Response, status: int, kind: str) -> dict[str, Any]:
    """A problem document of that status and kind; the document."""
    assert answer.status_code == status, answer.text[:500]
    assert answer.headers["content-type"] == "application/problem+json"
    document = answer.json()
    assert document["status"] == status
    assert document["type"].endswith(f"/{kind}"), document
    assert document["title"]
    assert document["detail"].strip()
    return document
