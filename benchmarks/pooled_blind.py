"""Several folders of the withheld-effect check scored as one.

python -m benchmarks.pooled_blind FOLDER [FOLDER ...] [--newest N] [--keep DIR]      seconds

Each FOLDER is what `linktwin blind --out FOLDER` wrote and answered, or what --keep kept of one: seal, labels and, of
the answers, what scores are counted from, under DIR/SEED. `benchmarks/sealed` has the newest test seeds so. --newest:
of the folders the last seeds that hold N studies together. Labels must be those that were sealed.
"""

import argparse
import json
import shutil
from itertools import accumulate, chain
from pathlib import Path
from typing import Any

from backend.blind.withheld.run import ANSWERS, BASELINES, NAIVE, facts_of
from backend.blind.withheld.score import Scores, scores
from backend.blind.withheld.seal import SEAL

TOLD = 1e-6  # probability of a cause that is worth keeping


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


def newest(folders: list[Path], studies: int) -> list[Path]:
    """The last seeds that hold so many studies together, all where they are fewer."""
    last = sorted(folders, key=lambda f: json.loads((f / SEAL).read_text())["seed"], reverse=True)
    held = accumulate(json.loads((f / SEAL).read_text())["cases"] for f in last)
    enough = next((k for k, count in enumerate(held, 1) if count >= studies), len(last))
    return last[:enough][::-1]


def keep(folder: Path, into: Path) -> None:
    """Copy a seal, its labels and what its answers are scored by."""
    kept = into / str(json.loads((folder / SEAL).read_text())["seed"])
    kept.mkdir(parents=True, exist_ok=True)
    for name in (SEAL, "labels.json", NAIVE):
        shutil.copyfile(folder / name, kept / name)
    entries = (json.loads(line) for line in (folder / ANSWERS).read_text().splitlines())
    (kept / ANSWERS).write_text("".join(json.dumps(entry | {"gap": _told(entry["gap"])}) + "\n" for entry in entries))


def _told(gap: dict[str, Any]) -> dict[str, Any]:
    """Of gap.json's content what scores are counted from."""
    causes = [
        {"probability": c["probability"], "effects": [_named(e) for e in c["effects"]]}
        for c in gap["causes"]
        if c["probability"] > TOLD
    ]
    rest = {name: gap[name] for name in ("verdict", "sentence", "probability_none", "probability_unknown", "shrink")}
    return rest | {"where": {"locations": gap["where"].get("locations", [])}, "causes": causes}


def _named(effect: dict[str, Any]) -> dict[str, Any]:
    return {name: effect[name] for name in ("kind", "on", "parameters") if name in effect}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--newest", type=int, metavar="N")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    folders = newest(asked.folders, asked.newest) if asked.newest else asked.folders
    found = pooled(folders)
    for folder in folders if asked.keep else ():
        keep(folder, asked.keep)
    print(f"{len(folders)} seeds, {found.cases} studies\n{found.table()}")


if __name__ == "__main__":
    main()
