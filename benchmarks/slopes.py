"""What the program that a diagnosis asks for slopes costs: to make, and to run with more and more directions at once.

python -m benchmarks.slopes [NAME ...]      a few minutes a study; NAME: one of the studies that others made

Slopes of the first experiment in numbers of the smooth library, about the drawing. Seconds of a processor, so that what
else the machine does counts little; of runs in turns the least.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from backend.diagnose.library import SMOOTH, library
from backend.diagnose.run import default_step
from backend.diagnose.subject import prepare
from backend.mechanism.read import read_study
from backend.mechanism.study import driven_effects
from backend.model.build import build
from benchmarks.judged import FOLDER

NAMES = "a03", "u06"  # two metronomes on a rolling board (three freedoms), a scissor
WIDTHS = 4, 8, 16
RUNS = 9


def report(name: str) -> None:
    """Of one study."""
    study = read_study(FOLDER / name / "study.json")
    known = library(study.mechanism, SMOOTH, study.tolerances, driven=driven_effects(study))
    subject = prepare(study, known, default_step(study, build(study.mechanism)))
    probe = subject.chosen(subject.fit[0], subject.choose())
    x = np.concatenate([subject.neutral, probe.start, np.zeros(0 if probe.moving else probe.mobility)])
    rng = np.random.default_rng(0)
    took: dict[int, list[float]] = {width: [] for width in WIDTHS}
    for turn in range(1 + RUNS):
        for width in WIDTHS:
            wide, directions = replace(probe, at_once=width), rng.standard_normal((width, x.size))
            wide.__dict__["setting"] = probe.setting
            began = time.process_time()
            wide.along(x, directions)
            took[width].append(time.process_time() - began)
            if turn == 0 and width == WIDTHS[0]:
                print(f"{name}: {len(known.parameters)} numbers, the first program {took[width][0]:.1f} s", flush=True)
    steps = int(np.ceil(probe.duration_s / probe.step_s))
    told = ", ".join(f"{w} directions {1e6 * min(s[1:]) / steps:.0f}" for w, s in took.items())
    print(f"  µs a step of {steps}, with its slopes: {told}; taken here: {probe.at_once}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME")
    for name in parser.parse_args().names:
        report(name)


if __name__ == "__main__":
    main()
