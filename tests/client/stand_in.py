"""Stands in for `linktwin` as a job's program: hands in what was prepared for the command; simulations are real.

REPORTS, then the arguments of `linktwin`.  REPORTS/COMMAND is what it writes, COMMAND.json what it prints.  Of the
options, --duration=600 takes as long; --free=slow:* does not converge, --free=wrong:* is refused.
"""

import os
import shutil
import sys
import time
from pathlib import Path

reports, command, *rest = sys.argv[1:]
options = dict(word.lstrip("-").partition("=")[::2] for word in rest)
if command == "simulate":
    from backend.cli import main

    sys.argv[1:] = sys.argv[2:]
    main()
Path(os.environ["LINKTWIN_PROGRESS"]).write_text('{"part": 0.5, "words": "standing in"}')
if options.get("duration") == "600.0":
    time.sleep(600)
if options.get("free") == "wrong:*":
    print("error: there is no effect of kind wrong", file=sys.stderr)
    sys.exit(2)
prepared = Path(reports)
shutil.copytree(prepared / command, options["out"], dirs_exist_ok=True)
print((prepared / f"{command}.json").read_text())
if options.get("free") == "slow:*":
    print("error: the fit did not converge", file=sys.stderr)
    sys.exit(1)
