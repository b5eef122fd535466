"""Whether the service works."""

from __future__ import annotations

from fastapi import APIRouter
from sqlalchemy.exc import SQLAlchemyError
from sqlmodel import func, select

from backend.service.answers import HealthAnswer
from backend.service.asking import TheService, may_fail
from backend.service.jobs.holding import alive
from backend.service.problems import Problem
from backend.service.records import Job

router = APIRouter(tags=["health"])


@router.get("/health", responses=may_fail())
def get_health(service: TheService) -> HealthAnswer:
    """Told to anybody: it names nothing that is anybody's."""
    try:
        with service.database.reading() as session:
            workers = len(alive(service, session))
            counted = session.exec(select(Job.state, func.count()).group_by(Job.state))
            states: dict[str, int] = dict(counted.all())
    except SQLAlchemyError:
        raise Problem("unavailable", "The database does not answer; try again in a while.") from None
    return HealthAnswer(
        status="ok", workers=workers, waiting=states.get("queued", 0), running=states.get("running", 0)
    )  # fmt: skip
