"""The service on this machine, and the keys that open it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from backend.commands.terminal import AsJson, answering

DataFolder = Annotated[
    Path | None, typer.Option("--data", help="Folder for all it keeps; out/service.", file_okay=False)
]


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on; 127.0.0.1.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port; 8000, 0 for any free one.")] = None,
    workers: Annotated[int | None, typer.Option(min=0, help="Jobs worked on at once; 1.")] = None,
    data: Annotated[
        Path | None, typer.Option("--data", "--out", help="Folder for all it keeps; out/service.", file_okay=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Answer over HTTP: the page at /ui, the API at /api/v1, and workers for its jobs.  Ctrl-C ends it.

    Everything else is set by LINKTWIN_... variables: docs/service.md.
    """
    with answering(as_json) as answer:
        from backend.service.settings import Settings
        from backend.service.supervise import supervise

        settings = Settings(**_given(host=host, port=port, workers=workers, data_folder=data))
        if settings.require_keys is False and not settings.on_loopback:
            raise ValueError(
                f"LINKTWIN_REQUIRE_KEYS=false holds on loopback alone, and {settings.host} is reached from elsewhere: "
                "make a key with `linktwin key new OWNER` and leave the variable out, or listen on 127.0.0.1"
            )
        has_key = _proven(settings)
        if settings.keys_required and not has_key:
            raise ValueError(
                f"listening on {settings.host} needs an API key, and there is none: make one with "
                "`linktwin key new OWNER`, or listen on 127.0.0.1"
            )
        kept = str(settings.data_folder.resolve())
        supervise(settings, lambda url: answer({"url": url, "data": kept}, f"serving   {url}\ndata      {kept}"))


def key(
    what: Annotated[Literal["new", "list", "revoke"], typer.Argument(help="What to do.")],
    name: Annotated[str | None, typer.Argument(help="The owner of a new key, or the id of one to revoke.")] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Make, list and revoke API keys.  A key is shown once; keys of the same owner open the same things."""
    with answering(as_json) as answer:
        from backend.service.keys import list_keys, make_key, revoke_key
        from backend.service.service import open_service
        from backend.service.settings import Settings

        if what != "list" and not name:
            raise ValueError(f"`linktwin key {what}` needs {'an owner' if what == 'new' else 'the id of a key'}")
        service = open_service(Settings(**_given(data_folder=data)))
        try:
            if what == "new":
                made, text = make_key(service.database, name or "")
                answer(
                    {"id": made.id, "owner": made.owner, "key": text}, f"{text}\nkey of {made.owner}; not shown again"
                )
            elif what == "revoke":
                gone = revoke_key(service.database, name or "")
                answer({"id": gone.id, "owner": gone.owner, "revoked": gone.revoked}, f"revoked {gone.id}")
            else:
                keys = [{"id": k.id, "owner": k.owner, "revoked": k.revoked} for k in list_keys(service.database)]
                lines = [f"{k['id']}  {k['owner']}{'  revoked' if k['revoked'] else ''}" for k in keys]
                answer({"keys": keys}, "\n".join(lines) or "no keys")
        finally:
            service.close()


def _given(**options: object) -> dict:
    return {name: value for name, value in options.items() if value is not None}


def _proven(settings: object) -> bool:
    """Use database and storage once, before anything is started on them; whether there is a key."""
    from backend.service.keys import any_key
    from backend.service.service import open_service

    service = open_service(settings)  # pyright: ignore[reportArgumentType]
    try:
        service.storage.prove()
        return any_key(service.database)
    finally:
        service.close()
