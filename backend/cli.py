"""The command line: each command parses its arguments, calls one function and says what came of it.

Rooms are imported inside the commands: `--help` and reading a drawing stay free of jax, cadquery and OpenCV.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import typer

from backend.commands.blind import blind
from backend.commands.calibrate import calibrate
from backend.commands.check import check
from backend.commands.convert import convert
from backend.commands.demo import demo
from backend.commands.diagnose import diagnose
from backend.commands.export import export
from backend.commands.fit import fit
from backend.commands.jam import jam
from backend.commands.kit import kit
from backend.commands.serve import key, serve
from backend.commands.simulate import simulate
from backend.commands.still import still
from backend.commands.track import track
from backend.commands.twin import twin

app = typer.Typer(
    name="linktwin",
    help="Draw a linkage, film it, and learn why the real one differs.",
    epilog="Exit codes: 0 done, 1 the work failed, 2 bad arguments or bad input.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    demo, export, check, simulate, kit, calibrate, still, track, convert, fit, diagnose, twin, jam, blind, serve, key,
):  # fmt: skip
    app.command()(command)


def main() -> None:
    """Entry point of `linktwin`: float64 and a shelf for compiled programs, then the command."""
    # Read when jax starts: nothing is imported here.  A program compiled once serves every later command on a
    # mechanism of the same layout.
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    # Threads of small decompositions wait for each other longer than they work: 250 times longer on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    shelf = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "linktwin" / "programs"
    with suppress(OSError):  # a home that cannot be written costs compile time, nothing else
        shelf.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(shelf))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    app()
