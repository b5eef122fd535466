"""Fifty clients at once: is anything lost, and how long do the routes that do no work take?

python -m benchmarks.service_load [--clients 50] [--uploads 200] [--real] [--postgres]

Each client stores a drawing, asks for a job on it, looks at lists and files, and waits for its job.  Jobs are stood in
for (0.2 s of waiting each) unless --real: then every tenth is a `diagnose` of the measured pendulum, and the others
are in turn `simulate` and `jam` of the four-bar and `fit` of the pendulum.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from backend.service.settings import Settings
from tests.service.postgres import postgres
from tests.service.serving import FOURBAR, Served, pendulum, serving, settings_in

LONGEST_S = 3600.0


class Timed:
    """A client whose answers are timed by route."""

    def __init__(self, client: httpx.Client, took: dict[str, list[float]]):
        self.client, self.took = client, took

    def __call__(self, route: str, method: str, path: str, **more) -> httpx.Response:
        began = time.perf_counter()
        answer = self.client.request(method, path, **more)
        self.took[route].append(time.perf_counter() - began)
        if answer.status_code >= 400:
            raise RuntimeError(f"{route}: {answer.status_code} {answer.text[:300]}")
        return answer


def visit(
    served: Served, number: int, times: int, took: dict[str, list[float]], stored: dict[str, str], real: bool
) -> None:
    """One client: upload, ask, look, wait; `stored`: thing -> job."""
    with httpx.Client(base_url=served.client.base_url, timeout=120.0) as client:
        ask = Timed(client, took)
        for turn in range(times):
            name = f"client {number}, turn {turn}"
            text = FOURBAR.read_text().replace('"name": "fourbar"', f'"name": "{name}"').encode()
            headers = {"content-type": "application/json"}
            first = ", first" if turn == 0 else ""  # of all clients at once
            thing = ask(f"POST mechanisms{first}", "POST", "/api/v1/mechanisms", content=text, headers=headers).json()
            job = ask(
                f"POST jobs{first}", "POST", "/api/v1/jobs", headers={"Idempotency-Key": name.replace(" ", "-")},
                json=wanted(ask, thing["id"], number * times + turn if real else 0),
            ).json()  # fmt: skip
            stored[thing["id"]] = job["id"]
            ask("GET mechanisms", "GET", "/api/v1/mechanisms", params={"limit": 20})
            back = ask("GET a file", "GET", thing["files"][0]["url"]).content
            if hashlib.sha256(back).digest() != hashlib.sha256(text).digest():
                raise RuntimeError(f"{name}: what came back is not what was stored")
            end = time.monotonic() + LONGEST_S
            while time.monotonic() < end:
                if ask("GET a job", "GET", f"/api/v1/jobs/{job['id']}").json()["finished"]:
                    break
                time.sleep(0.5)


def wanted(ask: Timed, drawing: str, number: int) -> dict[str, Any]:
    """What the job of that number is."""
    kind = "diagnose" if number % 10 == 9 else ("simulate", "jam", "fit")[number % 3]
    if kind in ("simulate", "jam"):
        return {"kind": kind, "mechanism": drawing, "duration_s": 0.2}
    headers = {"content-type": "application/zip"}
    study = ask("POST studies", "POST", "/api/v1/studies", content=pendulum(), headers=headers).json()["id"]
    return {"kind": kind, "study": study, **({"free": ["coulomb_friction:pivot"]} if kind == "fit" else {})}


def run(settings: Settings, folder: Path, clients: int, uploads: int, real: bool) -> None:
    """Print p50, p95 and largest of each route, and what became of every upload and job."""
    took: dict[str, list[float]] = defaultdict(list)
    stored: dict[str, str] = {}
    with serving(folder, settings) as served:
        failures: list[str] = []
        began = time.perf_counter()

        def one(number: int) -> Callable[[], None]:
            def go() -> None:
                try:
                    visit(served, number, uploads // clients, took, stored, real)
                except Exception as error:
                    failures.append(f"{type(error).__name__}: {error}")

            return go

        threads = [threading.Thread(target=one(number)) for number in range(clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        wall_s = time.perf_counter() - began
        print("failures:", failures or "none", flush=True)  # first: of a service that is gone nothing else can be asked
        told = [served.job(job) for job in stored.values()]
        states = [job["state"] for job in told]
        total = served.client.get("/api/v1/mechanisms").json()["total"]
        print(f"{clients} clients, {len(stored)} uploads and jobs, {settings.workers} workers, {wall_s:.1f} s")
        print(f"{'route':22s} {'asked':>6s} {'p50, ms':>9s} {'p95, ms':>9s} {'most, ms':>9s}")
        for route, times_s in sorted(took.items()):
            low, high = np.percentile(times_s, (50, 95)) * 1e3
            print(f"{route:22s} {len(times_s):6d} {low:9.1f} {high:9.1f} {max(times_s) * 1e3:9.1f}")
        every_s = [one for route, times_s in took.items() for one in times_s]
        print(f"{'all of them':22s} {len(every_s):6d} {'':9s} {np.percentile(every_s, 95) * 1e3:9.1f}")
        print(f"kept {total} of {uploads} uploads; jobs: {states.count('succeeded')} of {uploads} succeeded")
        if real:
            for kind in sorted({job["kind"] for job in told}):
                took_s = [job["elapsed_s"] for job in told if job["kind"] == kind]
                print(f"{kind:22s} {len(took_s):6d} jobs, {np.median(took_s):.0f} s each from start to end (median)")
        else:
            ends = [served.ledger("end", job) for job in stored.values()]
            print(f"each done once: {ends.count(1)}; more than once: {sum(end > 1 for end in ends)}")


def main() -> None:
    """Read what is wanted, and run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--uploads", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--postgres", action="store_true")
    asked = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="linktwin-load-")))
        more: dict = {"dead_after_s": Settings().dead_after_s}
        if asked.postgres:
            more["database_url"] = stack.enter_context(postgres())
        if asked.real:
            more["job_command"] = Settings().job_command
        settings = settings_in(folder, workers=asked.workers, active_jobs_per_owner=10 * asked.uploads, **more)
        run(settings, folder, asked.clients, asked.uploads, asked.real)


if __name__ == "__main__":
    main()
