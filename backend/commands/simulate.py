"""Let the drawing go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from backend.commands.remote import Key, Server, done_there
from backend.commands.terminal import AsJson, Failed, MechanismFile, Out, answering, counting, folder_for, progress

FILES = {"motion": "run.h5", "page": "simulation.html", "forces": "forces.csv", "forces_page": "forces.html"}


def simulate(
    mechanism: MechanismFile,
    duration_s: Annotated[float, typer.Option("--duration", metavar="S", min=0.0, help="How long [s].")] = 1.0,
    step_s: Annotated[float, typer.Option("--step", metavar="S", min=0.0, help="Time step [s].")] = 1e-3,
    solve: Annotated[
        Literal["compliance", "reduced"],
        typer.Option(help="All held rows give way alike, or redundant rows are let go."),
    ] = "compliance",
    threshold: Annotated[
        float | None, typer.Option(metavar="REL", help="Singular value, over the largest, below which a row repeats.")
    ] = None,
    server: Server = None,
    key: Key = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Let the drawing go from rest: run.h5 and a page of its motion, forces.csv and a page of its joint forces."""
    with answering(as_json) as answer:
        if server is not None:
            from backend.report.run_summary import summary_text

            done = done_there(
                server, key, mechanism, out,
                lambda there, id: there.simulate(
                    id, duration_s=duration_s, step_s=step_s, solve=solve, threshold=threshold
                ),
                study=False,
            )  # fmt: skip
            if done.report is not None:
                done.report["files"] = _files(done.folder)
            done.tell(answer, summary_text, FILES["page"])
            return
        from backend.mechanism.read import read_mechanism
        from backend.report.forces_page import peak_table, write_forces_page
        from backend.report.linked import simulation_pictures
        from backend.report.pictures import write_pictures
        from backend.report.run_summary import simulation_evidence, summary_json, summary_text
        from backend.report.simulation_page import write_simulation_page

        drawn = read_mechanism(mechanism)
        folder = folder_for(out, drawn.name)
        with progress("simulating") as advance:
            from backend.simulate.joint_forces import joint_forces, strongest
            from backend.simulate.run import simulate as run_drawing
            from backend.simulate.write import write_run
            from backend.simulate.write_forces import write_forces

            run = run_drawing(drawn, duration_s, step_s, progress=counting(advance), solve=solve, threshold=threshold)
        motion = write_run(run, folder / FILES["motion"])
        loads = joint_forces(drawn, run)
        forces, ranked = write_forces(run, loads, folder / FILES["forces"]), strongest(loads)
        evidence = simulation_evidence(drawn, run, forces_page=FILES["forces_page"])
        page = write_simulation_page(evidence, folder / FILES["page"])
        write_pictures(simulation_pictures(evidence), folder / "pictures.json")
        told = write_forces_page(
            evidence.mechanism, evidence.motion, ranked, folder / FILES["forces_page"],
            table=forces.name, result=run.result, solve=run.solve,
        )  # fmt: skip
        peaks = peak_table(run.time_s, ranked)
        summary = summary_json(run)
        answer(
            {**summary, "joint_forces": peaks, "files": _files(folder)},
            f"{summary_text(summary)}\nwrote       {motion}, {forces}\nopen        {page}, {told}",
        )
        if not run.done:
            raise Failed(run.result)


def _files(folder: Path) -> dict[str, str]:
    return {name: str(folder / file) for name, file in FILES.items()}
