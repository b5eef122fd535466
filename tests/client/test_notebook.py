"""The notebook-style sample: solids, a proposed joint, and a gap report over REST."""

import json
import os
import subprocess
import sys

from backend.mechanism.read import read_mechanism
from tests.client.test_command_line import served  # noqa: F401
from tests.service.serving import ROOT

NOTEBOOK = ROOT / "samples" / "pendulum" / "notebook.py"


def run(out, url, key=""):
    environment = {**os.environ, "LINKTWIN_OUT": str(out), "LINKTWIN_URL": str(url), "LINKTWIN_KEY": key}
    return subprocess.run(
        [sys.executable, str(NOTEBOOK)], cwd=ROOT, capture_output=True, text=True, timeout=240,
        env={**environment, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def test_the_notebook_goes_from_solids_to_a_gap_report(served, tmp_path):  # noqa: F811
    running, key = served
    done = run(tmp_path, running.client.base_url, key)
    assert done.returncode == 0, done.stderr
    gap = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert gap["sentence"] in done.stdout
    assert "proposed  frame-link: revolute, pin 8 mm" in done.stdout
    assert (tmp_path / "proposal.svg").is_file()


def test_without_a_service_it_draws_the_sample_and_says_what_to_do(tmp_path):
    done = run(tmp_path, "http://127.0.0.1:9")
    assert done.returncode == 1
    assert "linktwin serve" in done.stderr
    assert f"linktwin diagnose {tmp_path / 'study.json'}" in done.stderr
    drawn, sample = read_mechanism(tmp_path / "mechanism.json"), read_mechanism(NOTEBOOK.with_name("mechanism.json"))
    assert (drawn.bodies, drawn.joints, drawn.markers) == (sample.bodies, sample.joints, sample.markers)
