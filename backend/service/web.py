"""The web process."""

from __future__ import annotations

import socket
import sys
import tempfile

import uvicorn

from backend.service.app import create_app
from backend.service.jobs.child import tie_to
from backend.service.listen import AT_ONCE, allow_connections, protocol
from backend.service.logs import logger, write_logs
from backend.service.page.late import mount_late
from backend.service.pulse import beat
from backend.service.service import open_service
from backend.service.settings import Settings


def main() -> None:
    """PARENT PULSE SOCKET: answer on a socket that the parent listens on, and end with it."""
    parent, pulse, descriptor = (int(word) for word in sys.argv[1:4])
    tie_to(parent)
    write_logs()
    allow_connections()
    settings = Settings()
    beat(pulse, settings.heartbeat_s)
    service = open_service(settings)
    tempfile.tempdir = str(settings.scratch)  # parts of forms are spooled where uploads are
    app = create_app(service)
    mount_late(app, service)
    config = uvicorn.Config(
        app, log_config=None, access_log=False, server_header=False, timeout_keep_alive=30,
        timeout_graceful_shutdown=3, limit_concurrency=AT_ONCE, backlog=1024, http=protocol(settings.stall_s),
    )  # fmt: skip
    logger().info("answering", host=settings.host, port=settings.port)
    uvicorn.Server(config).run(sockets=[socket.socket(fileno=descriptor)])


if __name__ == "__main__":
    main()
