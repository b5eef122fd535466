"""Studies whose truth others held while they were answered, made by simulators of theirs, and what a diagnosis says.

python -m benchmarks.judged [NAME ...]      half a minute to a quarter of an hour each, on one core
"""

import argparse
import json
import time
from pathlib import Path

from backend.commands.terminal import progress
from backend.diagnose.run import diagnose_study
from backend.mechanism.read import read_study
from backend.report.gap_summary import gap_text

FOLDER = Path(__file__).parent / "others"


def truth(folder: Path) -> str:
    """What was amiss, and what else would be a right answer."""
    told = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    effects = told["effects"]
    if effects is None:
        said = "nothing that the library has"
    else:
        said = " and ".join(f"{e['kind']} at {e['on']}: {e['size']}" for e in effects) or "nothing"
    return f"{told['what']}: {said}" + (f" ({told['also']})" if told["also"] else "")


def main() -> None:
    every = sorted(f.name for f in FOLDER.iterdir())
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=every, metavar="NAME", help=", ".join(every))
    for name in parser.parse_args().names:
        study, began = read_study(FOLDER / name / "study.json"), time.perf_counter()
        with progress(name) as advance:
            found = diagnose_study(study, progress=advance)
        print(f"\n{name}: {truth(FOLDER / name)}\n{gap_text(found.report)}", flush=True)
        print(f"seconds   {time.perf_counter() - began:.0f}", flush=True)


if __name__ == "__main__":
    main()
