"""The gaps of the five measured rigs, diagnosed, with a picture each.

python -m benchmarks.diagnosed_rigs [RIG ...] [--pictures DIR] [--kept DIR]      two to forty minutes a rig

A RIG is a study below the folder of measurements (LINKTWIN_DATA, or ../shared/data), as `emps/study`; all of them by
default. A run that was cut off goes on from the ends of fits that --kept holds. Skipped, with a sentence, where there
are no measurements.
"""

import argparse
import textwrap
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from backend.commands.terminal import progress
from backend.diagnose.diagnosis import Diagnosis
from backend.diagnose.kept import FILE, Kept
from backend.diagnose.run import diagnose_study
from backend.mechanism.read import read_study
from backend.mechanism.study import Study
from backend.report.evidence import GapEvidence
from backend.report.gap_summary import gap_evidence, gap_text
from backend.report.gap_words import cause_name
from benchmarks.real_studies import FOLDER

RIGS = (
    "multiarm_single/study",
    "schmidt_lipson_pendulum/study",
    "emps/study",
    "ibm_double_pendulum/study",
    "ibm_double_pendulum/study_uniform_bars",
    "dfki_double_pendulum/study",
)
MOST, FAINT = 5, 0.01  # causes that are shown, and a probability that no bar shows


def picture(study: Study, found: Diagnosis, path: Path) -> None:
    """The experiment explained worst under both models; what is missing against time; what may be the cause."""
    evidence = gap_evidence(study, found)
    figure, (motion, force, causes) = plt.subplots(
        1, 3, figsize=(13, 3.6), width_ratios=(4, 3, 4), layout="constrained"
    )
    _motion(motion, evidence)
    if evidence.missing:
        first = evidence.missing[0]
        force.plot(first.time_s, first.mean, color="tab:red", lw=1)
        force.fill_between(
            first.time_s, first.mean - 2 * first.sd, first.mean + 2 * first.sd, color="tab:red", alpha=0.2
        )
        force.axhline(0.0, color="k", lw=0.5)
    force.set(xlabel="time since release, s", ylabel=evidence.missing_unit)
    force.set_title(f"missing at {evidence.missing_at}, {evidence.missing[0].experiment}" if evidence.missing else "")
    report = evidence.report
    shown = [c for c in report.causes[:MOST] if c is report.causes[0] or c.probability > FAINT]
    bars = [(cause_name(c), c.probability) for c in shown] + [("unknown", report.probability_unknown)]
    names = ["\n".join(textwrap.wrap(name, 38)) for name, _ in bars]
    causes.barh(names[::-1], [p for _, p in bars][::-1], color=["0.6"] + ["tab:blue"] * (len(bars) - 1))
    causes.set(xlim=(0, 1), xlabel="probability", title=report.verdict)
    causes.tick_params(axis="y", labelsize=7)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _motion(axes: Axes, evidence: GapEvidence) -> None:
    channel = evidence.channels[0]
    for values, style, label in (
        (channel.measured, "k.", "measured"), (channel.before, "tab:orange", "as drawn"),
        (channel.after, "tab:blue", "with the best cause"),
    ):  # fmt: skip
        if values is not None:
            axes.plot(channel.time_s, values, style, ms=2, lw=1, label=label)
    seen = channel.measured[np.isfinite(channel.measured)]
    room = 0.3 * np.ptp(seen)
    axes.set(
        xlabel="time, s", ylabel=f"{channel.at} {channel.component}, {channel.unit}", title=f"{channel.experiment}"
    )
    axes.set(ylim=(seen.min() - room, seen.max() + room))
    axes.legend(fontsize=7)


def _kept(folder: Path | None, rig: str, study: Study) -> Kept | None:
    if folder is None:
        return None
    path = folder / f"{rig.replace('/', '_')}.{FILE}"
    return Kept.of(path, study, frozenset(), resume=path.exists())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("rigs", nargs="*", default=RIGS)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--kept", type=Path)
    asked = parser.parse_args()
    if not FOLDER.is_dir():
        print(f"Skipped: no measurements at {FOLDER}. Set LINKTWIN_DATA to the folder of the real studies.")
        return
    for rig in asked.rigs:
        study, began = read_study(FOLDER / f"{rig}.json"), time.perf_counter()
        with progress(rig) as advance:
            found = diagnose_study(study, progress=advance, kept=_kept(asked.kept, rig, study))
        print(f"\n{rig}: {time.perf_counter() - began:.0f} s\n{gap_text(found.report)}", flush=True)
        held = found.report.shrink.held_out
        if held is not None and held.explained_fraction is not None:
            print(f"explained {held.explained_fraction:.3%} of the held-out gap", flush=True)
        if asked.pictures:
            asked.pictures.mkdir(parents=True, exist_ok=True)
            picture(study, found, asked.pictures / f"gap_{rig.replace('/', '_')}.png")


if __name__ == "__main__":
    main()
