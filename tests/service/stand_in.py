"""Stands in for `linktwin` as a job's program: as long as it is told, no longer to start than Python itself.

LEDGER, then the arguments of `linktwin`.  Each start and each end is one line of the ledger.  What it does, the options
of `simulate` say: --duration seconds of work in steps that are told and shown; --solve=reduced fails; --threshold=0.5
dies of a signal once; --threshold=0.25 leaves a process of its own behind; --threshold=0.125 takes 100 MB;
--threshold=0.75 takes its time only once, and no more when it is begun again.  `fit` keeps a checkpoint, dies of a
signal, and goes on from it.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

ledger, command, subject, *rest = sys.argv[1:]
options = dict(word.lstrip("-").partition("=")[::2] for word in rest)
out = Path(options["out"])
progress = os.environ["LINKTWIN_PROGRESS"]


def note(what):
    with open(ledger, "a") as file:
        file.write(f"{what} {out.parent.parent.name} {os.getpid()}\n")


note("start")
began = Path(ledger).read_text().count(f"start {out.parent.parent.name} ")
if options.get("threshold") == "0.5" and began == 1:
    os.kill(os.getpid(), signal.SIGKILL)
if options.get("threshold") == "0.25":
    left = subprocess.Popen([sys.executable, "-I", "-S", "-c", "import time; time.sleep(600)"])
    Path(f"{ledger}.left").write_text(str(left.pid))
if options.get("threshold") == "0.125":
    much = b"x" * 100_000_000
if command == "fit":
    checkpoint = out / "fit.checkpoint.json"
    if "resume" not in options:
        checkpoint.write_text("as far as the first half")
        time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGKILL)
    print(json.dumps({"went on from": checkpoint.read_text()}))
    sys.exit(0)
drawn = json.loads(Path(subject).read_text())["name"]
print("words on the way", file=sys.stderr)
for tenth in range(10):
    Path(f"{progress}.part").write_text(json.dumps({"part": tenth / 10, "words": "standing in"}))
    os.replace(f"{progress}.part", progress)
    (out / "watching.jpg").write_text(f"tenth {tenth}")
    time.sleep(0.01 if options.get("threshold") == "0.75" and began > 1 else float(options["duration"]) / 10)
(out / "inner").mkdir()
(out / "inner" / "motion.csv").write_text("time_s\n0\n")
note("end")
if options.get("solve") == "reduced":
    print(f"error: {subject}: it did not succeed; try another way", file=sys.stderr)
    sys.exit(1)
print(json.dumps({"mechanism": drawn, "files": {"motion": str(out)}}))
