"""A new database is made as the records say, an old one is upgraded: both must come to the same tables."""

from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import inspect, text
from sqlmodel import SQLModel

from backend.service.database import HEAD, MIGRATIONS, Database
from backend.service.records import Repeat


@pytest.fixture
def made(tmp_path: Path):
    database = Database(f"sqlite:///{tmp_path / 'made.sqlite'}")
    database.migrate()
    yield database
    database.close()


@pytest.fixture
def upgraded(tmp_path: Path):
    database = Database(f"sqlite:///{tmp_path / 'upgraded.sqlite'}")
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
    yield database
    database.close()


def test_both_ways_come_to_the_same_tables(made, upgraded):
    assert _tables(made) == _tables(upgraded)
    with upgraded.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, SQLModel.metadata) == []


def test_a_database_of_either_way_needs_nothing_more(made, upgraded):
    for database in (made, upgraded):
        before = _tables(database)
        database.migrate()
        assert _tables(database) == before
        with database.engine.connect() as connection:
            assert connection.execute(text("SELECT version_num FROM alembic_version")).scalars().all() == [HEAD]


def test_keys_that_made_a_job_still_stand_for_it_after_an_upgrade(tmp_path):
    database = Database(f"sqlite:///{tmp_path / 'old.sqlite'}")
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
        connection.execute(text("INSERT INTO repeat VALUES ('ada', 'k', 'f', 'the job', 0)"))
    database.migrate()
    with database.reading() as session:
        assert session.get_one(Repeat, ("ada", "k")).made == "the job"
    database.close()


def _tables(database: Database) -> dict:
    seen = inspect(database.engine)
    return {
        table: (
            {c["name"]: (str(c["type"]), c["nullable"]) for c in seen.get_columns(table)},
            seen.get_pk_constraint(table)["constrained_columns"],
            sorted((i["name"], tuple(i["column_names"]), bool(i["unique"])) for i in seen.get_indexes(table)),
            sorted(tuple(u["column_names"]) for u in seen.get_unique_constraints(table)),
        )
        for table in sorted(seen.get_table_names())
    }


@pytest.mark.parametrize("url", ["postgresql+psycopg:///jobs?host=/run/pg", "postgresql+psycopg:///jobs"])
def test_a_database_behind_a_socket_is_the_same_from_every_folder(url, tmp_path, monkeypatch):
    database = Database(url)
    here = database.digest
    monkeypatch.chdir(tmp_path)
    assert database.digest == here
    assert Database("postgresql+psycopg:///others?host=/run/pg").digest != here
