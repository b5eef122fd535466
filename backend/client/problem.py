"""Whatever goes wrong between a client and its service, in the service's own words."""

from __future__ import annotations

import httpx
from pydantic import ValidationError

from backend.service.answers import ProblemAnswer


class ServiceProblem(Exception):
    """The service did not do what it was asked, or no answer came.

    status: HTTP's, None where no answer came.  kind: the last word of the problem's type, such as "no-key".  title,
    detail: the service's words.  faults: each fault of the input with its remedy.  retry_after_s: when to come back.
    """

    def __init__(
        self,
        title: str,
        detail: str,
        status: int | None = None,
        kind: str = "",
        faults: tuple[str, ...] = (),
        retry_after_s: float | None = None,
    ):
        super().__init__(title, detail, status)
        self.title, self.detail, self.status, self.kind = title, detail, status, kind
        self.faults, self.retry_after_s = faults, retry_after_s

    def __str__(self) -> str:
        return "\n".join([self.detail, *(f"- {fault}" for fault in self.faults)])

    @property
    def passing(self) -> bool:
        """Whether the same request may do better in a moment."""
        return self.status in (None, 502, 503, 504) or self.kind == "too-often"


def refused(answer: httpx.Response) -> ServiceProblem:
    """What an answer that has been read says went wrong."""
    status = answer.status_code
    try:
        told = ProblemAnswer.model_validate_json(answer.content)
    except ValidationError:
        return not_ours(answer.url, f"HTTP {status} {answer.reason_phrase}, no problem document", status)
    wait = answer.headers.get("retry-after", "")
    return ServiceProblem(
        told.title, told.detail, status, told.type.rpartition("/")[2], tuple(told.errors or ()),
        float(wait) if wait.isdecimal() else None,
    )  # fmt: skip


def no_answer(url: httpx.URL | str, error: httpx.RequestError) -> ServiceProblem:
    """Nothing listens there, the name is unknown, or the connection broke."""
    why = str(error) or type(error).__name__
    return ServiceProblem(
        "No answer came", f"{url} does not answer ({why}); start the service (linktwin serve), or correct its address."
    )


def not_ours(url: httpx.URL | str, what: str, status: int | None = 200) -> ServiceProblem:
    """An answer came that the service would not give: a proxy's, another server's, or another version's."""
    return ServiceProblem("That is no answer of linktwin", f"{url} answers {what}; correct its address.", status)
