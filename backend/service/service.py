"""The service as one value: settings, records and storage.  Every use case takes it first, and an owner second."""

from __future__ import annotations

from dataclasses import dataclass

from backend.service.database import Database
from backend.service.settings import Settings
from backend.service.storage import Storage

LOCAL = "local"  # who owns what is stored where no key is asked for


@dataclass(frozen=True)
class Service:
    """What use cases work on."""

    settings: Settings
    database: Database
    storage: Storage

    def close(self) -> None:
        """Close the database."""
        self.database.close()


def open_service(settings: Settings) -> Service:
    """Make what is missing: folders, tables."""
    settings.scratch.mkdir(parents=True, exist_ok=True)
    database = Database(settings.database)
    database.migrate()
    return Service(settings, database, Storage(settings.storage))
