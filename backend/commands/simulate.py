"""Let the drawing go."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from backend.commands.terminal import AsJson, Failed, MechanismFile, Out, answering, counting, folder_for, progress


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
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Let the drawing go from rest: run.h5 and a page of its motion, forces.csv and a page of its joint forces."""
    with answering(as_json) as answer:
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
        motion = write_run(run, folder / "run.h5")
        loads = joint_forces(drawn, run)
        forces, ranked = write_forces(run, loads, folder / "forces.csv"), strongest(loads)
        evidence = simulation_evidence(drawn, run, forces_page="forces.html")
        page = write_simulation_page(evidence, folder / "simulation.html")
        write_pictures(simulation_pictures(evidence), folder / "pictures.json")
        told = write_forces_page(
            evidence.mechanism, evidence.motion, ranked, folder / "forces.html",
            table=forces.name, result=run.result, solve=run.solve,
        )  # fmt: skip
        files = {"motion": str(motion), "page": str(page), "forces": str(forces), "forces_page": str(told)}
        peaks = peak_table(run.time_s, ranked)
        answer(
            {**summary_json(run), "joint_forces": peaks, "files": files},
            f"{summary_text(run)}\nwrote       {motion}, {forces}\nopen        {page}, {told}",
        )
        if not run.done:
            raise Failed(run.result)
