"""Chunks on a scheduler's workers: one dies on the way, and every sample is answered once all the same."""

import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from backend.jam.chunks import SCHEDULER, answers
from tests.jam.slow_job import SlowJob

ROOT = Path(__file__).resolve().parents[2]
pytest.importorskip("distributed", reason="dask.distributed is not installed: make sets it up from the lock")


def started(stack: ExitStack, name: str, *options: str) -> subprocess.Popen:
    """A process of Dask's own, spawned: a fork of a process in which jax runs may hang."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", f"distributed.cli.{name}", *options]
    process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL)

    def end() -> None:
        process.kill()
        process.wait()

    stack.callback(end)
    return process


@pytest.fixture
def farm(tmp_path, monkeypatch) -> Iterator[list[subprocess.Popen]]:
    """A scheduler and two workers, named by the environment."""
    place = tmp_path / "scheduler.json"
    with ExitStack() as stack:
        started(
            stack, "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", f"--scheduler-file={place}"
        )
        once(place.exists, "the scheduler")
        address = json.loads(place.read_text())["address"]
        monkeypatch.setenv(SCHEDULER, address)
        here = ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        yield [started(stack, "dask_worker", address, *here, f"--local-directory={tmp_path}") for _ in range(2)]


def once(ready, what: str, patience_s: float = 60.0) -> None:
    until = time.monotonic() + patience_s
    while not ready():
        assert time.monotonic() < until, f"{what} did not come"
        time.sleep(0.05)


def test_a_worker_that_dies_loses_no_sample_and_none_counts_twice(farm, tmp_path):
    diary, samples, chunk = tmp_path / "diary", np.linspace(0.0, 1.0, 197)[:, None], 5
    job = SlowJob(str(diary), chunk, 0.25)

    def begun() -> list[list[str]]:
        return [line.split() for line in diary.read_text().splitlines()] if diary.exists() else []

    def chunks_of(worker: subprocess.Popen) -> int:
        return [pid for pid, _ in begun()].count(str(worker.pid))

    def kill_one() -> None:
        once(lambda: all(chunks_of(worker) for worker in farm), "work for both")
        done = chunks_of(farm[0])
        # It dies as it begins another chunk, which takes a quarter of a second: one is surely in flight.
        once(lambda: chunks_of(farm[0]) > done, "another chunk")
        farm[0].kill()

    killer = threading.Thread(target=kill_one)
    killer.start()
    seen = list(answers(job, samples))
    killer.join()
    assert farm[0].poll() is not None, "no worker was killed"
    places = sorted((place for place, _ in seen), key=lambda place: place.start)
    assert [(p.start, p.stop) for p in places] == [(k, min(k + chunk, 197)) for k in range(0, 197, chunk)]
    for place, verdict in seen:
        assert verdict.onset_s.tolist() == samples[place, 0].tolist()  # each answer is about its own samples
        assert verdict.jammed.tolist() == (samples[place, 0] > 0.5).tolist()
        assert verdict.rests.all()  # float64 on the workers
    twice = [chunk for chunk, times in Counter(chunk for _, chunk in begun()).items() if times > 1]
    assert twice, "nothing was in flight when the worker died: the test showed nothing"
    assert begun()[-1][0] != str(farm[0].pid)


def test_a_scheduler_that_is_not_there_is_said_in_a_sentence(monkeypatch):
    monkeypatch.setenv(SCHEDULER, "tcp://127.0.0.1:9")
    monkeypatch.setattr("backend.jam.chunks.PATIENCE_S", 0.5)
    with pytest.raises(ValueError, match=r"no scheduler answers at DASK_SCHEDULER_ADDRESS=tcp://127.0.0.1:9.*unset it"):
        next(answers(SlowJob("", 5, 0.0), np.zeros((3, 1))))
