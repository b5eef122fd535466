"""A scissor drawn tight and without friction, whose every pin is loose and rubs: does a diagnosis say so?

python -m benchmarks.diagnosed_loose [ENGINE ...] [--cells N]      twenty minutes each with three cells

The paper's mechanism in an engine's motions: 0.5 mm of play and 0.01 N m s/rad at every pin, five springs of which the
fourth is held out, 0.4 s at 240 frames/s with 0.2 mm of noise. The whole library is asked.
"""

import argparse
import dataclasses
import time

from backend.commands.terminal import progress
from backend.diagnose.run import diagnose_study
from backend.mechanism.study import Study
from backend.report.gap_summary import gap_text
from benchmarks.identification import SOFT_N_PER_M, SPRINGS, Case, filmed, study_of

ENGINES = ("Exudyn", "MuJoCo")
RADIAL_M, FRICTION = 5e-4, 0.01
HELD_OUT = 3  # which of the springs
EFFECTS = ("play", "drag")  # ids of what the drawing lacks


def untold(case: Case) -> Study:
    """The case's records beside a drawing that knows neither play nor friction."""
    study = study_of(case, *filmed(case), seed=3)
    bare = tuple(e for e in study.mechanism.effects if e.id not in EFFECTS)
    runs = tuple(
        dataclasses.replace(run, use="held_out") if i == HELD_OUT else run for i, run in enumerate(study.experiments)
    )
    return dataclasses.replace(study, mechanism=study.mechanism.model_copy(update={"effects": bare}), experiments=runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("engines", nargs="*", choices=[[], *ENGINES], default=[])
    parser.add_argument("--cells", type=int, default=3)
    asked = parser.parse_args()
    for engine in asked.engines or ENGINES:
        soft = SOFT_N_PER_M if engine == "MuJoCo" else None
        study = untold(
            Case("viscous", engine, radial_m=RADIAL_M, friction=FRICTION, loads=len(SPRINGS), steps=400,
                 cells=asked.cells, stiffness_n_per_m=soft)
        )  # fmt: skip
        began = time.process_time()
        with progress(engine) as advance:
            found = diagnose_study(study, progress=advance)
        print(f"\n{engine}, {asked.cells} cells\n{gap_text(found.report)}")
        print(f"seconds   {time.process_time() - began:.0f} of a core", flush=True)


if __name__ == "__main__":
    main()
