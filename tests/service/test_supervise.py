"""Processes that are kept alive: begun again where they end, ended where they fall silent."""

import os
import signal
import subprocess
import sys
import time

import pytest

from backend.service.pulse import Pulse
from backend.service.supervise import SLOWEST_S, Kept
from tests.service.serving import until

BEATS = """
import sys, time
from backend.service.pulse import beat
beat(int(sys.argv[1]), 0.05)
time.sleep(600)
"""


@pytest.fixture
def keep():
    kept = []

    def begin(program: str, **more) -> Kept:
        def start(name: str, pulse: Pulse) -> subprocess.Popen:
            return subprocess.Popen(
                [sys.executable, "-c", program, str(pulse.writing)], pass_fds=[pulse.writing], start_new_session=True
            )

        kept.append(Kept(start, dead_after_s=2.0, **more))
        kept[-1].look()
        return kept[-1]

    yield begin
    for one in kept:
        one.process.kill()
        one.process.wait()
        one.pulse.close()


def _heard(one: Kept) -> bool:
    one.look()
    return one.pulse is not None and one.pulse.heard is not None


def test_a_stopped_process_is_ended_and_begun_again(keep):
    died = []
    one = keep(BEATS, died=died.append)
    name, first = one.name, one.process
    until("it is heard", lambda: _heard(one))
    os.kill(first.pid, signal.SIGSTOP)
    until("another is heard", lambda: _heard(one) and one.process is not first)
    assert first.returncode == -signal.SIGKILL
    assert died == [name]


def test_a_process_that_runs_and_one_that_has_not_begun_to_beat_are_left_alone(keep):
    runs, starts = keep(BEATS), keep("import time; time.sleep(600)")
    until("it is heard", lambda: _heard(runs))
    first = runs.process, starts.process
    end = time.monotonic() + 3.0
    while time.monotonic() < end:
        runs.look(), starts.look()
        time.sleep(0.05)
    assert (runs.process, starts.process) == first


def test_a_process_that_never_holds_is_started_again_for_ever(keep):
    one = keep("raise SystemExit(1)")
    one.process.wait()
    one.quick = 5000  # half a day of it
    one.look()
    assert one.quick == 5001
    assert one.process is None  # not before the longest pause is over
    one.began -= SLOWEST_S
    one.look()
    assert one.process is not None
