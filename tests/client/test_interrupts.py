"""Ctrl-C at the moments at which Python, or a job that nobody knows yet, would lose it."""

import os
import signal
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from backend.commands import remote
from backend.commands.terminal import Failed
from tests.service.serving import FOURBAR


class Service:
    """One job, which is cancelled or runs for ever."""

    def __init__(self):
        self.did: list[str] = []

    def store_mechanism(self, file: Any, sent: Any) -> Any:
        self.did.append("stored")
        return SimpleNamespace(id="drawing")

    def wait(self, job: Any, told: Any) -> Any:
        self.did.append("waited")
        with suppress(KeyboardInterrupt):  # as where it falls into a destructor
            os.kill(os.getpid(), signal.SIGINT)
        told(SimpleNamespace(part=0.5, words="half way", state="running"))
        raise AssertionError("went on after Ctrl-C")

    def cancel(self, job: Any) -> Any:
        self.did.append(f"cancelled {job.id}")
        return SimpleNamespace(state="cancelled")

    def page(self, job: Any) -> str:
        return "its page"


@pytest.fixture
def service(monkeypatch) -> Service:
    made = Service()

    @contextmanager
    def asking(server, key):
        yield made

    monkeypatch.setattr(remote, "asking", asking)
    return made


def done(tmp_path: Path, start: Any) -> remote.DoneThere:
    return remote.done_there("http://127.0.0.1:9", None, FOURBAR, tmp_path, start, study=False)


def test_pressed_while_the_job_is_being_started_it_cancels_that_job(service, tmp_path):
    def start(there, drawing):
        os.kill(os.getpid(), signal.SIGINT)
        return SimpleNamespace(id="just started")

    with pytest.raises(Failed, match="the job is cancelled"):
        done(tmp_path, start)
    assert service.did == ["stored", "cancelled just started"]


def test_pressed_where_python_drops_it_it_is_heeded_at_the_next_progress(service, tmp_path):
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Failed, match="the job is cancelled"):
        done(tmp_path, lambda there, drawing: SimpleNamespace(id="running"))
    assert service.did == ["stored", "waited", "cancelled running"]
    assert signal.getsignal(signal.SIGINT) is before


def test_pressed_twice_while_the_job_is_being_started_it_ends_at_once(service, tmp_path):
    def start(there, drawing):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        done(tmp_path, start)
    assert service.did == ["stored"]
