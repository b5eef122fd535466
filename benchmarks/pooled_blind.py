"""Several folders of the withheld-effect check scored as one.

python -m benchmarks.pooled_blind FOLDER [FOLDER ...]      seconds

Each FOLDER is what `linktwin blind --out FOLDER` wrote and answered. Its labels must be those that were sealed.
"""

import argparse
import json
from itertools import chain
from pathlib import Path

from backend.blind.withheld.run import BASELINES, facts_of
from backend.blind.withheld.score import Scores, scores
from backend.blind.withheld.seal import SEAL


def pooled(folders: list[Path]) -> Scores:
    """Scores of all answers together. The commonest cause is each folder's own."""
    own, *naive = (list(chain(*facts)) for facts in zip(*map(facts_of, folders), strict=True))
    seals = [json.loads((folder / SEAL).read_text()) for folder in folders]
    return Scores(
        seed=seals[-1]["seed"],
        cases=len(own),
        sha256=seals[-1]["sha256"],
        version=seals[-1]["version"],
        scores=scores(own),
        baselines={name: scores(facts) for name, facts in zip(BASELINES, naive, strict=True)},
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    folders = parser.parse_args().folders
    found = pooled(folders)
    print(f"{len(folders)} seeds, {found.cases} studies\n{found.table()}")


if __name__ == "__main__":
    main()
