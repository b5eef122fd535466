"""Frames a second of the page's playback: a scissor of 23 cells, its twin, the drawing and 71 measured dots at once.

python -m benchmarks.page_playback [SECONDS]

A frame's cost is the browser's processor time, by its processes: it is the same however busy the machine is. Bodies
stand where a sine of their drawn pose puts them; drawing them costs what it costs for a real motion.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import read_mechanism
from backend.report.evidence import Motion, Overlay
from backend.report.pictures import Pictures, write_pictures
from cad_export import export_script
from tests.browser.conftest import CHROMIUM, FLAGS
from tests.browser.cost import spent_s
from tests.service.serving import ROOT, Served, serving, settings_in

CELLS, FRAMES, LENGTH_S = 23, 720, 4.0
DRAWN = "document.querySelector('.stage').drawn"
SETTLED_S = 3.0  # until it is as coarse as the machine needs
FREE = """async (ms) => {
  let frames = 0, on = true; const began = performance.now();
  const step = () => { frames++; if (on) requestAnimationFrame(step); };
  requestAnimationFrame(step); await new Promise((done) => setTimeout(done, ms)); on = false;
  return 1000 * frames / (performance.now() - began);
}"""


def main(play_s: float) -> None:
    """Serve it, play it, count."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "drawn"
        export_script(ROOT / "samples" / "scissor" / "design.py", drawn, {"cells": CELLS})
        mechanism = read_mechanism(drawn / "mechanism.json")
        write_pictures(pictures(mechanism), drawn / "pictures.json")
        job = (sys.executable, "-m", "benchmarks.page_playback", "--as-job", str(drawn / "pictures.json"))
        with serving(Path(folder), settings_in(Path(folder), workers=1, job_command=job)) as service:
            id = service.start(_stored(service, drawn))
            assert service.finished(id)["state"] == "succeeded"
            measured(f"{service.client.base_url}/ui/jobs/{id}", play_s)


def _stored(service: Served, drawn: Path) -> str:
    files = [drawn / "mechanism.json", *drawn.glob("meshes/*.stl")]
    sent = [("files", (str(file.relative_to(drawn)), file.read_bytes())) for file in files]
    answer = service.client.post("/api/v1/mechanisms", files=sent)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def measured(address: str, play_s: float) -> None:
    """Print what each layer costs."""
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(address.replace("//ui", "/ui"))
        page.wait_for_selector(".stage[data-replay]", timeout=120_000)
        print(f"a page that draws nothing: {page.evaluate(FREE, 1e3 * play_s):.0f} frames a second on this machine")
        for left_out in ("nothing", "as drawn", "measured"):
            if left_out != "nothing":
                page.get_by_label(left_out, exact=True).uncheck()
            page.locator(".stage-play").click()
            time.sleep(SETTLED_S)
            frames, spent, began = page.evaluate(DRAWN), spent_s(), time.monotonic()
            time.sleep(play_s)
            frames, took_s = page.evaluate(DRAWN) - frames, time.monotonic() - began
            cost = ", ".join(f"{1e3 * (s - spent[role]) / frames:.1f} ms {role}" for role, s in spent_s().items())
            page.locator(".stage-play").click()
            print(f"without {left_out:9s} {frames / took_s:3.0f} frames a second; of processor time a frame {cost}")
        browser.close()


def pictures(mechanism: Mechanism) -> Pictures:
    """Twin, drawing and dots, each a little apart."""
    time_s = np.linspace(0.0, LENGTH_S, FRAMES)
    sway = 0.05 * np.sin(2 * np.pi * time_s / LENGTH_S)
    after, before = _moved(mechanism, sway, time_s), _moved(mechanism, 1.2 * sway, time_s)
    seen = {m.id: after.position_m[m.body] + np.array(m.position_m) for m in mechanism.markers}
    overlay = Overlay("swing", after, before, time_s, seen)
    return Pictures("simulate", (overlay,), story={"result": "done"})


def _moved(mechanism: Mechanism, sway: np.ndarray, time_s: np.ndarray) -> Motion:
    bodies = mechanism.moving_bodies()
    p = {b.id: np.array(b.pose.position_m) * (1 + sway)[:, None] for b in bodies}
    q = {b.id: np.tile(b.pose.quaternion_wxyz, (len(time_s), 1)) for b in bodies}
    return Motion(time_s, p, q)


def as_job(pictures_json: str, arguments: list[str]) -> None:
    """What the worker runs in place of a simulation."""
    out = next(word.removeprefix("--out=") for word in arguments if word.startswith("--out="))
    Path(out, "pictures.json").write_bytes(Path(pictures_json).read_bytes())
    print(json.dumps({}))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--as-job"]:
        as_job(sys.argv[2], sys.argv[3:])
    else:
        main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0)
