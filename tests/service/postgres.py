"""A real PostgreSQL in a folder of its own, where the machine has one."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def _program(name: str) -> str | None:
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return shutil.which(name) or (str(found[-1]) if found else None)


def _as_somebody_else() -> tuple[list[str], str | None]:
    """PostgreSQL refuses to run as root: how to run it as another user, and as whom."""
    if os.geteuid() != 0:
        return [], None
    setpriv = shutil.which("setpriv")
    for user in ("postgres", "nobody"):
        try:
            found = pwd.getpwnam(user)
        except KeyError:
            continue
        if setpriv:
            return [setpriv, f"--reuid={found.pw_uid}", f"--regid={found.pw_gid}", "--clear-groups", "--"], user
    return [], None


@contextmanager
def postgres() -> Iterator[str]:
    """The URL of an empty database; skips with the reason where there is no PostgreSQL."""
    initdb, server = _program("initdb"), _program("postgres")
    if initdb is None or server is None:
        pytest.skip("no PostgreSQL here: install the package postgresql to run this")
    prefix, user = _as_somebody_else()
    if os.geteuid() == 0 and not prefix:
        pytest.skip("PostgreSQL does not run as root, and there is no other user or no setpriv")
    with tempfile.TemporaryDirectory(prefix="linktwin-pg-") as name:  # its socket's path must be short
        folder = Path(name)
        if user is not None:
            shutil.chown(folder, user)
        data = str(folder / "data")
        environment = {**os.environ, "LC_ALL": "C"}
        making = [*prefix, initdb, "-D", data, "-U", "linktwin", "--auth=trust", "--no-sync", "-E", "UTF8"]
        subprocess.run(making, check=True, capture_output=True, cwd=name, env=environment)
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
        serving = [*prefix, server, "-D", data, "-p", str(port), "-k", name, "-c", "listen_addresses=127.0.0.1"]
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(serving, stdout=log, stderr=log, cwd=name, env=environment)
        try:
            yield _made(f"postgresql://linktwin@127.0.0.1:{port}")
        finally:
            process.terminate()
            process.wait(30)


def _made(server: str) -> str:
    import psycopg

    from tests.service.serving import until

    def connect() -> psycopg.Connection | None:
        try:
            return psycopg.connect(f"{server}/postgres", autocommit=True)
        except psycopg.OperationalError:
            return None

    with until("PostgreSQL answers", connect) as connection:
        connection.execute("CREATE DATABASE records")
    return f"{server}/records"
