"""The withheld-effect check."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from backend.commands.terminal import MINUTES, AsJson, Failed, Out, answering, folder_for, progress, stoppable


def blind(
    cases: Annotated[int, typer.Option("--n", metavar="N", min=1, help="How many studies.")],
    seed: Annotated[int, typer.Option(min=0, help="0 to 9999; with --test 1000000 to 1999999.")],
    test: Annotated[bool, typer.Option("--test", help="Mechanisms that development never sees.")] = False,
    mechanism: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Draw this mechanism alone; may be repeated.")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND", help="An effect that is neither drawn nor a candidate; may be repeated."),
    ] = None,
    minutes: Annotated[
        float, typer.Option(metavar="M", min=0.0, help="End each search after so long, as `diagnose` does; 0: never.")
    ] = MINUTES,
    workers: Annotated[int, typer.Option(metavar="N", min=1, help="Processes that draw and diagnose.")] = 1,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Draw studies by other engines, seal what is amiss, diagnose each and score: scores.json.

    Ctrl-C ends it after the case at hand; the same command goes on from there.
    """
    with answering(as_json) as answer:
        from backend.blind.withheld.run import Cancelled, Limits, check_limits, check_seed, run_blind
        from backend.diagnose.answer import answer as diagnosed
        from backend.mechanism.effect import kind_named

        for kind in without or ():
            kind_named(kind)
        check_seed(seed, test)
        check_limits(limits := Limits(tuple(mechanism or ()), tuple(without or ())), test)
        folder = folder_for(out, f"blind_{seed}")
        with progress("drawing the studies") as advance, stoppable() as stopped:
            try:
                scores = run_blind(
                    seed,
                    cases,
                    folder,
                    partial(diagnosed, minutes=minutes),
                    test=test,
                    progress=advance,
                    cancelled=stopped,
                    workers=workers,
                    limits=limits,
                )
            except Cancelled as error:
                raise Failed(str(error)) from error
            except ModuleNotFoundError as error:
                raise Failed(f"the check needs {error.name}: install linktwin[peers] and run it again") from error
        text = f"sealed    {scores.sha256} (seed {seed}, {cases} cases)\n{scores.table()}\nwrote     {folder}"
        answer(scores.model_dump(mode="json"), text)
