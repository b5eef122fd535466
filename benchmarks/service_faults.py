"""Workers, and now and then the web process, are killed at random while jobs run: does each job end once?

python -m benchmarks.service_faults [--duration 600] [--jobs 60] [--seconds 4] [--real] [--postgres]

Jobs are stood in for (--seconds of waiting each) unless --real: then each is `linktwin simulate` of the four-bar.
They are asked for over the first half of the duration.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx

from backend.service.settings import Settings
from tests.service.postgres import postgres
from tests.service.serving import Served, serving, settings_in

SEED = 7
WEB_SHARE = 0.15  # of the kills


def ask(served: Served, drawing: str, number: int, seconds: float) -> str | None:
    """Ask for a job as a client does that knows its web process may die: again, under the same key."""
    asked = {"kind": "simulate", "mechanism": drawing, "duration_s": seconds}
    with suppress(httpx.TransportError):
        answer = served.client.post("/api/v1/jobs", json=asked, headers={"Idempotency-Key": f"job-{number}"})
        return answer.json()["id"] if answer.status_code == 202 else None
    return None


def kill(served: Served, chance: random.Random) -> str | None:
    """kill -9 of one process."""
    module = "backend.service.web" if chance.random() < WEB_SHARE else "backend.service.jobs"
    if not (there := served.processes(module)):
        return None
    with suppress(ProcessLookupError):
        os.kill(chance.choice(there), signal.SIGKILL)
    return module.rpartition(".")[2]


def run(
    settings: Settings, folder: Path, duration_s: float, jobs: int, seconds: float, gap_s: float, real: bool
) -> None:
    """Print how often what was killed, and what became of every job."""
    chance, killed = random.Random(SEED), Counter()
    with serving(folder, settings) as served:
        drawing = served.store()
        began = time.monotonic()
        ids: list[str] = []
        next_kill = began + gap_s
        while (now := time.monotonic()) < began + duration_s:
            due = len(ids) < jobs and now >= began + len(ids) * duration_s / 2 / jobs
            if due and (id := ask(served, drawing, len(ids), seconds)):
                ids.append(id)
            if now >= next_kill:
                if dead := kill(served, chance):
                    killed[dead] += 1
                next_kill = now + chance.uniform(0.5, 1.5) * gap_s
            time.sleep(0.1)
        told = [served.finished(id) for id in ids]
        wall_s = time.monotonic() - began
        files = [len(served.client.get(f"/api/v1/jobs/{id}/files").json()) for id in ids]
        listed = served.client.get("/api/v1/jobs").json()["total"]
        print(f"{duration_s:.0f} s of kills, {wall_s:.0f} s in all")
        print(f"killed   {killed['jobs']} workers, {killed['web']} web processes")
        print(f"jobs     {len(ids)} asked for, {len(set(ids))} different, {listed} listed")
        print("states  ", dict(Counter(job["state"] for job in told)))
        print("attempts", dict(sorted(Counter(job["attempt"] for job in told).items())))
        print("files   ", dict(Counter(files)), "(number of files: jobs)")
        if not real:
            ends = Counter(served.ledger("end", id) for id in ids)
            print("came to the end of their work", dict(sorted(ends.items())), "(times: jobs)")
        for job in told:
            if job["state"] != "succeeded":
                print(job["id"], job["state"], job["message"])


def main() -> None:
    """Read what is wanted, and run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--jobs", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--gap", type=float, default=8.0, help="Mean time between kills [s].")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--postgres", action="store_true")
    asked = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="linktwin-faults-")))
        more: dict = {"dead_after_s": Settings().dead_after_s}
        if asked.postgres:
            more["database_url"] = stack.enter_context(postgres())
        if asked.real:
            more["job_command"] = Settings().job_command
        settings = settings_in(folder, workers=asked.workers, **more)
        run(settings, folder, asked.duration, asked.jobs, asked.seconds, asked.gap, asked.real)


if __name__ == "__main__":
    main()
