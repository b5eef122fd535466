"""Verdicts of many samples, chunk by chunk: on the cores of this process, or on the workers of a Dask scheduler.

A chunk is a pure function of its samples, told apart by its number: one that a worker took along when it died is
asked again, and each number is answered once.  In flight are a few chunks a worker; no more is held.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice

import jax
import numpy as np
from jaxtyping import Float

from backend.jam.batch import CHUNK, Verdicts, verdicts
from backend.jam.distribution import varied
from backend.mechanism.read import decode, parse_mechanism
from backend.model.build import build
from backend.model.model import Address, Model

SCHEDULER = "DASK_SCHEDULER_ADDRESS"
IN_FLIGHT = 3  # chunks a worker: one at work, one waiting, one on its way
PATIENCE_S = 30  # for a scheduler that should be there


@dataclass(frozen=True)
class Job:
    """What is asked of every sample.  document: the drawing as JSON text; specs: what varies, one column each."""

    document: str
    specs: tuple[str, ...]
    duration_s: float
    step_s: float
    chunk: int = CHUNK

    def ask(self, samples: Float[np.ndarray, "samples parameters"]) -> Verdicts:
        """Verdicts of one chunk; pure, so that it may be asked anywhere and again."""
        model, columns, addresses = _model(self.document, self.specs)
        ((_, seen),) = verdicts(model, addresses, samples[:, columns], self.duration_s, self.step_s, self.chunk)
        return seen


def content_of(job: Job, samples: Float[np.ndarray, "samples parameters"]) -> str:
    """A fingerprint of what is asked, and of which samples."""
    return hashlib.sha256(repr(job).encode() + np.ascontiguousarray(samples).tobytes()).hexdigest()[:16]


@lru_cache(maxsize=4)
def _model(document: str, specs: tuple[str, ...]) -> tuple[Model, np.ndarray, tuple[Address, ...]]:
    """The drawing at the middle of what varies, the address of each number, and the column that it reads.

    The middle, not the drawn value: a play that is drawn as 0 is play all the same where it varies, and the ideal
    copy must be without it.
    """
    drawn = parse_mechanism(decode(document, "mechanism"))
    several, added = varied(drawn, specs)
    pairs = [(k, address) for k, one in enumerate(several) for address in one.parameter.addresses]
    middle = {address: float(several[k].distribution.ppf(np.array(0.5))) for k, address in pairs}
    model = build(drawn, added).with_parameters(middle)
    return model, np.array([k for k, _ in pairs]), tuple(address for _, address in pairs)


def answers(
    job: Job, samples: Float[np.ndarray, "samples parameters"], done: Container[int] = ()
) -> Iterator[tuple[slice, Verdicts]]:
    """Every chunk once, with the samples that it is about, in the order in which they are done.

    done: first samples of the chunks that are left out.  Where the environment names a scheduler in
    DASK_SCHEDULER_ADDRESS, its workers do them.  Raises ValueError where it cannot be reached, RuntimeError where a
    chunk takes worker after worker along.
    """
    every = range(0, len(samples), job.chunk)
    places = [slice(first, min(first + job.chunk, len(samples))) for first in every if first not in done]
    address = os.environ.get(SCHEDULER)
    if address and places:
        yield from _spread(address, job, samples, places)
    else:
        yield from _threaded(job, samples, places)


def _threaded(job: Job, samples: np.ndarray, places: list[slice]) -> Iterator[tuple[slice, Verdicts]]:
    """A chunk a core; the first one alone, so that its program is compiled once."""
    for place in places[:1]:
        yield place, job.ask(samples[place])
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as pool:
        try:
            yield from zip(places[1:], pool.map(lambda place: job.ask(samples[place]), places[1:]), strict=True)
        finally:
            pool.shutdown(cancel_futures=True)  # whoever stops asking waits for the chunks at work alone


def _spread(address: str, job: Job, samples: np.ndarray, places: list[slice]) -> Iterator[tuple[slice, Verdicts]]:
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise ValueError(
            f"{SCHEDULER} is set, and dask.distributed is not installed: pip install distributed, or unset it"
        ) from None
    content = content_of(job, samples)
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"no scheduler answers at {SCHEDULER}={address} ({error}); start one, or unset it") from None
    with client:

        def ask(number: int):
            return client.submit(_asked, job, number, samples[places[number]], key=f"jam-{content}-{number}")

        def room() -> int:
            workers = max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)  # some may join or leave
            return max(IN_FLIGHT * workers - flying.count(), 0)

        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            raise ValueError(f"the scheduler at {SCHEDULER}={address} has no workers; start one, or unset it") from None
        waiting, flying = iter(range(len(places))), as_completed(loop=client.loop)
        flying.update([ask(number) for number in islice(waiting, room())])
        for future in flying:
            try:
                number, seen = future.result()
            except KilledWorker as error:
                raise RuntimeError(
                    f"a chunk of {job.chunk} samples took several workers along ({error}); give them more memory"
                ) from None
            yield places[number], seen
            flying.update([ask(number) for number in islice(waiting, room())])


def _asked(job: Job, number: int, samples: np.ndarray) -> tuple[int, Verdicts]:
    jax.config.update("jax_enable_x64", True)  # a worker has no command that does
    return number, job.ask(samples)
