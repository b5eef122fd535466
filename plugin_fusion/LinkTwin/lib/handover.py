"""Hand an export to the service, off Fusion's main thread: nothing here touches Fusion."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from pathlib import Path

from .service import Cancelled, Refused, Service, Unreachable

POLL_S = 0.5
FINISHED = ("succeeded", "failed", "cancelled")


class Handover(threading.Thread):
    """Uploads an export and, where asked, has it simulated; tells `report` every step as a plain dict.

    report: called from this thread with {"step", "share" (0 to 1, or None), "text"}, with "page" once it is
    stored, and at the end once with {"step": "done" | "failed" | "cancelled", "text", "page"}. Inside Fusion it must
    do no more than fireCustomEvent.
    """

    def __init__(self, service: Service, folder: Path, report: Callable[[dict], None], simulate_s: float = 0.0):
        super().__init__(name="linktwin-handover", daemon=True)
        self._service, self._folder, self._report, self._simulate_s = service, folder, report, simulate_s
        self._stop_asked = threading.Event()
        self._share = -1.0

    def cancel(self) -> None:
        """Ask it to end; what was saved stays."""
        self._stop_asked.set()

    def run(self) -> None:
        """The work of the thread."""
        try:
            self._report(self._hand_over())
        except Cancelled:
            self._end("cancelled", "Stopped.")
        except (Refused, Unreachable, OSError) as error:
            self._end("failed", str(error))
        except Exception as error:  # a thread that dies silently would leave the palette waiting for ever
            self._end("failed", f"{type(error).__name__}: {error}")

    def _hand_over(self) -> dict:
        self._service.check()
        stored = self._service.store_mechanism(self._folder, str(uuid.uuid4()), self._sent)
        id = str(stored.get("id") or "")
        if not id:
            raise Refused(200, "the answer names no mechanism: this is not a LinkTwin service; correct its address")
        page = self._service.page(id)
        stored = "The mechanism is on the service."
        self._report({"step": "stored", "share": 1.0, "text": stored, "page": page})
        if self._simulate_s > 0.0:
            self._simulate(id)
            stored = f"The mechanism is on the service, and {self._simulate_s:g} s of its motion."
        return {"step": "done", "share": 1.0, "text": stored, "page": page}

    def _sent(self, sent: int, size: int) -> None:
        if self._stop_asked.is_set() and sent < size:  # once all is sent, the service has it
            raise Cancelled
        share = sent / max(size, 1)
        if share - self._share >= 0.01 or share == 1.0 > self._share:
            self._share = share
            self._report(
                {"step": "upload", "share": share, "text": f"Uploaded {sent / 1e6:.1f} of {size / 1e6:.1f} MB"}
            )

    def _simulate(self, mechanism: str) -> None:
        request = {"kind": "simulate", "mechanism": mechanism, "duration_s": self._simulate_s}
        job = str(self._service.start_job(request, str(uuid.uuid4())).get("id") or "")
        if not job:
            raise Refused(200, "the answer names no job; open the page and start it there")
        last = None
        while True:
            told = self._service.job(job)
            state = str(told.get("state"))
            if state in FINISHED:
                break
            text = f"Simulating {self._simulate_s:g} s: {told.get('words') or state}"
            message = {"step": "simulate", "share": _share(told), "text": text}
            if message != last:
                last = message
                self._report(message)
            if self._stop_asked.wait(POLL_S):
                self._service.cancel_job(job)
                raise Cancelled
        if state != "succeeded":
            raise Refused(200, f"The mechanism is on the service; simulating it {state}: {told.get('message') or ''}")

    def _end(self, step: str, text: str) -> None:
        saved = f"{text} The files stay in {self._folder}."
        self._report({"step": step, "share": None, "text": saved, "page": None})


def _share(job: dict) -> float | None:
    part = job.get("part")
    return float(part) if isinstance(part, (int, float)) else None
