"""From solids to a gap report, cell by cell: an editor that knows `# %%` runs each on its own, `python` runs them all.

Where a service listens (`linktwin serve`; LINKTWIN_URL names another, LINKTWIN_KEY its key) the last cells ask it.
"""

# %% The solids: a plate with a pin, and a bar with a hole and a bob [mm]
import json
import os
import shutil
import sys
from pathlib import Path

import cadquery as cq

from cad_export import Drawing, bar, propose

HERE = Path(__file__).parent
OUT = Path(os.environ.get("LINKTWIN_OUT", "out/notebook"))

plate = cq.Workplane("XY").box(60, 60, 10, centered=(True, True, False)).translate((0, 0, -10))
frame = plate.union(cq.Workplane("XY").circle(4).extrude(5.5))
link = bar((0, "hole"), (200, "plain")).union(cq.Workplane("XY").center(200, 0).circle(20).extrude(5))

assembly = cq.Assembly(name="pendulum", loc=cq.Location((0, 0, 0), (1, 0, 0), 90))
assembly.add(frame, name="frame")
assembly.add(link, name="link", loc=cq.Location((0, 0, 0.5), (0, 0, 1), 30 - 90))

# %% What they suggest: a joint, its play, and a picture to look at
drawing = Drawing(assembly)
drawing.ground("frame")
drawing.material(density_kg_per_m3=2700)  # aluminium
print(propose(drawing, OUT).text())

# %% Confirmed under a name of one's own; declare `drawing.revolute(...)` instead where a proposal is wrong
drawing.confirm("frame-link", "pivot", drawn_at_deg=30)
drawing.marker("middle", "link", (100, 0, 5))
drawing.marker("bob", "link", (200, 0, 5))
mechanism = drawing.write(OUT)

# %% What was measured on the real one: four releases, one of them kept aside
study = json.loads((HERE / "measured" / "study.json").read_text()) | {"mechanism": mechanism.name}
for experiment in study["experiments"]:
    shutil.copy(HERE / "measured" / experiment["tracks"], OUT)
(OUT / "study.json").write_text(json.dumps(study, indent=1))

# %% Why does it differ? A service finds out
from backend.client import Linktwin, ServiceProblem  # noqa: E402

try:
    with Linktwin(os.environ.get("LINKTWIN_URL", "http://127.0.0.1:8000"), os.environ.get("LINKTWIN_KEY")) as there:
        job = there.diagnose(there.store_study(OUT / "study.json"), tolerance_mm=1.0)
        print("watch", there.page(job))
        job = there.wait(job, told=lambda now: print(f"{now.part:4.0%}  {now.words}"))
        print(there.result(job).report["sentence"])
        there.download(job, OUT / "gap")
except ServiceProblem as problem:
    sys.exit(f"{problem}\nHere, without a service: linktwin diagnose {OUT / 'study.json'}")
