"""The command line: each command parses its arguments, calls one function and says what came of it.

Rooms are imported inside the commands: `--help` and reading a drawing stay free of jax, cadquery and OpenCV.
"""

from __future__ import annotations

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
from backend.commands.surface import surface
from backend.commands.track import track
from backend.commands.twin import twin
from backend.environment import keep_programs, settle

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
    demo, export, surface, check, simulate, kit, calibrate, still, track, convert, fit, diagnose, twin, jam, blind,
    serve, key,
):  # fmt: skip
    app.command()(command)


def main() -> None:
    """Entry point of `linktwin`: float64 and a shelf for compiled programs, then the command."""
    settle()
    keep_programs()
    app()
