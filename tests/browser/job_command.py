"""What the workers of these tests run: linktwin itself, but for what was prepared once.

`linktwin diagnose samples/pendulum/measured/study.json` takes two minutes of a core and wrote what lies in prepared/
diagnose/ (every third frame of its motions is kept); `linktwin fit --free coulomb_friction:*` of the same study half a
minute, `linktwin jam drawer.json --duration 0.4` as long (every sixth and tenth frame, two charts), `linktwin jam
stuck.json --duration 0.03` eight seconds (whole). LINKTWIN_SLOW=1 asks the tests for the real ones.
"""

import json
import os
import shutil
import sys
import time
from pathlib import Path

PREPARED = Path(__file__).parent / "prepared"
REPORTS = {"diagnose": "gap.json", "fit": "fit.json", "jam": "jam.json"}
STEPS = ("reading the study", "the drawing alone", "one effect at a time", "weighing the explanations")


def prepared(kind: str, arguments: list[str]) -> int:
    """Answer as the command would, after the time that it takes to be seen at work."""
    out = next(Path(word.removeprefix("--out=")) for word in arguments if word.startswith("--out="))
    for number, words in enumerate(STEPS, start=1):
        told = {"part": number / (len(STEPS) + 1), "words": words}
        Path(os.environ["LINKTWIN_PROGRESS"]).write_text(json.dumps(told))
        time.sleep(0.3)  # the work that is left out
    own = PREPARED / f"{kind}_{json.loads(Path(arguments[0]).read_text()).get('name')}"  # of one drawing alone
    found = own if own.exists() else PREPARED / kind
    for file in found.iterdir():
        shutil.copyfile(file, out / file.name)
    print((found / REPORTS[kind]).read_text())
    return 0


if __name__ == "__main__":
    if sys.argv[1] in REPORTS:
        sys.exit(prepared(sys.argv[1], sys.argv[2:]))
    from backend.cli import main

    main()
