"""Alembic's entry: runs the versions on the connection it is handed, or on LINKTWIN_DATABASE_URL."""

from alembic import context
from sqlmodel import SQLModel

from backend.service import records  # noqa: F401  (registers the tables)


def migrate() -> None:
    """Run what is missing."""
    connection = context.config.attributes.get("connection")
    if connection is None:
        from backend.service.database import Database
        from backend.service.settings import Settings

        connection = Database(Settings().database).engine.connect()
    context.configure(connection=connection, target_metadata=SQLModel.metadata, render_as_batch=True)
    with context.begin_transaction():
        context.run_migrations()


migrate()
