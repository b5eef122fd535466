"""The records' database: SQLite or PostgreSQL, by URL alone."""

from __future__ import annotations

import fcntl
import hashlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from sqlalchemy import Connection, Engine, create_engine, event, inspect, text
from sqlmodel import Session, SQLModel

from backend.service import records  # noqa: F401  (registers the tables)

MIGRATIONS = Path(__file__).parent / "migrations"
HEAD = "0002"  # the latest file of migrations/versions
LOCK = 0x11E7  # of PostgreSQL's advisory locks; one migrates, the others wait


class Database:
    """Sessions that read, and sessions that write all or nothing."""

    def __init__(self, url: str):
        self.url = url
        self.engine = _engine(url)
        # SQLite lets who waits for its one writer sleep and try again, the unlucky for seconds: threads here queue up.
        self._turn = threading.Lock() if url.startswith("sqlite") else nullcontext()

    @property
    def digest(self) -> str:
        """A name of this database that tells neither its user nor a password, the same from wherever it is opened."""
        url = self.engine.url
        place = f"{url.host or url.query.get('host')}:{url.port}/{url.database}"
        if self.url.startswith("sqlite"):
            place = str(Path(url.database or "").resolve())
        return hashlib.sha256(place.encode()).hexdigest()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session over one consistent picture."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A session that is committed at its end, or rolled back by whatever is raised inside."""
        writer = self.engine.execution_options(writing=True)
        with self._turn, Session(writer, expire_on_commit=False) as session, session.begin():
            yield session

    def migrate(self) -> None:
        """Bring the tables to this version; many processes may ask at once."""
        if self._version() == HEAD:
            return
        with self._alone() as connection:
            version = self._version(connection)
            if version is None:  # nothing to upgrade: the tables are made as the records say
                SQLModel.metadata.create_all(connection)
                connection.execute(text("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL PRIMARY KEY)"))
                connection.execute(text("INSERT INTO alembic_version VALUES (:head)"), {"head": HEAD})
            elif version != HEAD:
                from alembic import command  # half a second that only an upgrade needs
                from alembic.config import Config

                config = Config()
                config.set_main_option("script_location", str(MIGRATIONS))
                config.attributes["connection"] = connection
                command.upgrade(config, "head")

    def close(self) -> None:
        """Close every connection."""
        self.engine.dispose()

    def _version(self, connection: Connection | None = None) -> str | None:
        if connection is None:
            with self.engine.connect() as fresh:
                return self._version(fresh)
        if not inspect(connection).has_table("alembic_version"):
            return None
        return connection.execute(text("SELECT version_num FROM alembic_version")).scalar()

    @contextmanager
    def _alone(self) -> Iterator[Connection]:
        if self.engine.dialect.name == "sqlite":
            with (
                open(f"{self.engine.url.database}.lock", "a") as file,
                self.engine.execution_options(writing=True).connect() as connection,
            ):
                fcntl.flock(file, fcntl.LOCK_EX)
                yield connection
                connection.commit()
            return
        with self.engine.begin() as connection:
            connection.execute(text(f"SELECT pg_advisory_xact_lock({LOCK})"))
            yield connection


def _engine(url: str) -> Engine:
    if not url.startswith("sqlite"):
        return create_engine(url, pool_pre_ping=True, pool_size=10, max_overflow=30)
    path = Path(url.removeprefix("sqlite:///"))
    path.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, pool_size=10, max_overflow=30, connect_args={"timeout": 30})

    @event.listens_for(engine, "connect")
    def prepare(connection, record) -> None:
        connection.isolation_level = None  # begin() below says BEGIN itself
        connection.execute("PRAGMA journal_mode=WAL")  # readers and a writer do not wait for each other
        connection.execute("PRAGMA synchronous=FULL")  # what was acknowledged survives a power cut
        connection.execute("PRAGMA foreign_keys=ON")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A reader that turns writer half way fails at once when another wrote meanwhile; who means to write says so.
        immediate = connection.get_execution_options().get("writing")
        connection.exec_driver_sql("BEGIN IMMEDIATE" if immediate else "BEGIN")

    return engine
