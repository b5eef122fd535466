"""A worker process: takes jobs from the durable queue, and looks after those whose workers died."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

from dbos import DBOS, SetWorkflowID
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import defer
from sqlmodel import col, func, select, update

from backend.service.jobs.child import tie_to
from backend.service.jobs.holding import alive
from backend.service.jobs.work import carry_out, pause_s
from backend.service.logs import logger, write_logs
from backend.service.pulse import beat
from backend.service.records import Job, Worker
from backend.service.retention import tidy_up
from backend.service.service import Service, open_service
from backend.service.settings import Settings

QUEUE = "jobs"
VERSION = "1"  # of the workflow below: workers of another one leave its jobs alone
TIDY_EVERY_S = 600.0
AGAIN_EVERY_S = 10.0

_self: WorkerProcess  # of this process; a workflow is a plain function, found again by its name


@DBOS.step()
def do_job(id: str) -> None:
    """All of a job.  Begun again where its worker died, from the job's own checkpoint."""
    _self.carry(id)


@DBOS.workflow()
def job(id: str) -> None:
    """A job, as the durable queue sees it."""
    do_job(id)


class WorkerProcess:
    """Heartbeat, work and care, until the process ends."""

    def __init__(self, service: Service, id: str):
        self.service, self.id = service, id
        self.last_beat = time.monotonic()
        self.log = logger().bind(worker=self.id)

    def carry(self, id: str) -> None:
        """Do one job; where it cannot even be claimed, for want of the database, it is asked for again."""
        for failures in count():
            try:
                carry_out(self.service, id, self.id, self.is_fit)
                return
            except Exception:  # the job must not end as if it were done
                self.log.exception("a job could not be claimed or ended here, and is asked for again", job=id)
                time.sleep(pause_s(self.service.settings, failures))

    def is_fit(self) -> bool:
        """True while nobody can have taken this worker for dead; after that the process ends here.

        Its jobs must not seem done: others resume what a dead worker left unfinished, and nothing else.
        """
        if time.monotonic() - self.last_beat > 0.8 * self.service.settings.dead_after_s:
            self.log.error("silent for too long, ending")
            os._exit(1)
        return True

    def run(self, parent: int) -> None:
        """Work until killed."""
        tie_to(parent)
        settings = self.service.settings
        with self.service.database.writing() as session:
            session.add(Worker(id=self.id, host=socket.gethostname(), pid=os.getpid()))
        config: Any = {
            "name": "linktwin", "system_database_url": settings.queue, "executor_id": self.id,
            "application_version": VERSION, "log_level": "WARNING", "sys_db_pool_size": 5,
        }  # fmt: skip
        DBOS(config=config)
        DBOS.listen_queues([QUEUE])
        DBOS.launch()
        DBOS.register_queue(QUEUE, worker_concurrency=1, polling_interval_sec=settings.poll_s)
        threading.Thread(target=self._beat, daemon=True).start()
        self.log.info("working", queue=settings.queue.split("@")[-1])
        self._care()

    def _beat(self) -> None:
        while True:
            try:
                with self.service.database.writing() as session:
                    mine = (col(Worker.id) == self.id, col(Worker.ended).is_(None))
                    found: Any = session.execute(update(Worker).where(*mine).values(beat=time.time()))
                if not found.rowcount:
                    # Taken for dead, after a long stop: its jobs are others' by now, and its process is tied to it.
                    self.log.error("taken for dead, ending")
                    os._exit(1)
                self.last_beat = time.monotonic()
            except SQLAlchemyError:
                self.log.exception("no heartbeat")
            time.sleep(self.service.settings.heartbeat_s)

    def _care(self) -> None:
        duties: list[tuple[Callable[[], None], float]] = [
            (self._hand_over, self.service.settings.poll_s),
            (self._resume_of_dead, self.service.settings.heartbeat_s),
            (self._hand_over_again, AGAIN_EVERY_S),
            (lambda: tidy_up(self.service), TIDY_EVERY_S),
        ]
        due = [0.0 for _ in duties]
        while True:
            try:
                if self._leads():
                    for number, (duty, every_s) in enumerate(duties):
                        if time.monotonic() >= due[number]:
                            due[number] = time.monotonic() + every_s
                            duty()
            except Exception:
                self.log.exception("care failed, and is taken up again")
            time.sleep(self.service.settings.poll_s)

    def _leads(self) -> bool:
        """One worker cares for the others; two at a time do no harm."""
        with self.service.database.reading() as session:
            living = alive(self.service, session)
            first = session.exec(
                select(Worker).where(col(Worker.id).in_(living)).order_by(col(Worker.started), col(Worker.id))
            )
            leader = first.first()
        return leader is not None and leader.id == self.id

    def _hand_over(self) -> None:
        """Give waiting jobs to the durable queue, a few at a time, so that one owner's hundred do not block others."""
        with self.service.database.reading() as session:
            under_way = col(Job.handed_over).is_not(None) & col(Job.state).in_(("queued", "running"))
            busy: dict[str, int] = dict(
                session.exec(select(Job.owner, func.count()).where(under_way).group_by(Job.owner)).all()
            )
            room = 2 * len(alive(self.service, session)) - sum(busy.values())
            where = (Job.state == "queued", col(Job.handed_over).is_(None))
            but_its_request = defer(Job.request)  # pyright: ignore[reportArgumentType]  # it may be a megabyte long
            waiting = list(
                session.exec(select(Job).options(but_its_request).where(*where).order_by(col(Job.created)).limit(500))
            )
        for _ in range(min(room, len(waiting))):
            chosen = min(waiting, key=lambda job: (busy.get(job.owner, 0), job.created))
            waiting.remove(chosen)
            busy[chosen.owner] = busy.get(chosen.owner, 0) + 1
            with SetWorkflowID(f"{chosen.id}.{chosen.handovers}"):
                DBOS.enqueue_workflow(QUEUE, job, chosen.id)
            with self.service.database.writing() as session:
                same = (col(Job.id) == chosen.id, col(Job.handovers) == chosen.handovers)
                session.execute(update(Job).where(*same).values(handed_over=time.time()))

    def _resume_of_dead(self) -> None:
        """Put jobs back into the durable queue whose worker is dead."""
        with self.service.database.reading() as session:
            rows = list(session.exec(select(Worker).where(col(Worker.ended).is_(None))))
        silent = time.time() - self.service.settings.dead_after_s
        if dead := [row.id for row in rows if row.beat < silent or gone_from_here(row)]:
            with self.service.database.writing() as session:  # for good: one that wakes up finds it, and ends
                session.execute(update(Worker).where(col(Worker.id).in_(dead)).values(ended=time.time()))
        living = {row.id for row in rows if row.id not in dead}
        for flow in DBOS.list_workflows(status="PENDING", load_input=False, load_output=False):
            if flow.executor_id not in living:
                self.log.warning("resumed from a dead worker", job=flow.workflow_id, dead=flow.executor_id)
                DBOS.resume_workflow(flow.workflow_id, queue_name=QUEUE)

    def _hand_over_again(self) -> None:
        """Jobs that the durable queue holds for done, while their records say otherwise: an error there loses none."""
        with self.service.database.reading() as session:
            living = alive(self.service, session)
            left = (col(Job.state) == "queued") | (col(Job.state) == "running") & col(Job.worker).not_in(living)
            stuck = list(session.exec(select(Job).where(left, col(Job.handed_over) < time.time() - AGAIN_EVERY_S)))
        for one in stuck:
            flow = DBOS.get_workflow_status(f"{one.id}.{one.handovers}")
            if flow is None or flow.status not in ("ENQUEUED", "PENDING", "DELAYED"):
                self.log.warning("handed over again", job=one.id)
                with self.service.database.writing() as session:
                    same = (col(Job.id) == one.id, col(Job.handovers) == one.handovers, col(Job.state) == one.state)
                    again = {"state": "queued", "worker": None, "handed_over": None, "handovers": one.handovers + 1}
                    session.execute(update(Job).where(*same).values(**again))


def gone_from_here(worker: Worker) -> bool:
    """Whether a worker of this machine has no process any more: its heartbeat need not be waited for."""
    if worker.host != socket.gethostname() or not Path("/proc/self/cmdline").exists():
        return False
    try:
        return worker.id not in Path(f"/proc/{worker.pid}/cmdline").read_text().split("\0")
    except OSError:
        return True


def main() -> None:
    """PARENT PULSE NAME: work for the service that the environment describes, and end with that process."""
    global _self
    parent, pulse, name = sys.argv[1:4]
    write_logs()
    settings = Settings()
    beat(int(pulse), settings.heartbeat_s)
    _self = WorkerProcess(open_service(settings), name)
    _self.run(int(parent))
