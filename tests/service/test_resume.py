"""Real work whose worker is killed goes on from its last step or chunk, ends once, and ends where it would have."""

import json
import math
import os
import signal
from pathlib import Path

import pytest

from backend.diagnose.library import families
from backend.mechanism.read import write_mechanism
from backend.service.service import open_service
from backend.service.settings import Settings
from backend.service.things import CHECKPOINT, files_of
from tests.jam.weak import DRIVE, DRY, RUN, weak_bar
from tests.service.serving import pendulum, serving, settings_in, until

pytestmark = pytest.mark.nightly
LIBRARY = {"coulomb_friction", "viscous_friction"}  # what the diagnosis may call upon


def test_a_real_fit_whose_worker_is_killed_goes_on_where_it_was(tmp_path):
    settings = settings_in(tmp_path, workers=1, checkpoint_s=0.1, job_command=Settings().job_command)
    with serving(tmp_path, settings) as served:
        records = open_service(settings)
        study = served.store_study(pendulum("low"))
        asked = {"kind": "fit", "study": study, "free": ["coulomb_friction:pivot"]}

        def kept(id: str) -> list:
            files = [file for file in files_of(records, CHECKPOINT + id) if file.path == "fit.checkpoint.json"]
            stages = json.loads(records.storage.read(files[0].key))["stages"] if files else []
            return [step for stage in stages for step in stage["history"]]

        whole, cut = served.ask(asked), served.ask(asked)
        assert served.finished(whole)["attempt"] == 1
        until("some steps are kept", lambda: len(kept(cut)) >= 3)
        (worker,) = served.processes("backend.service.jobs")
        os.kill(worker, signal.SIGKILL)
        steps = kept(cut)
        assert "--resume" in until("it is begun again", lambda: _command_after(served, worker, cut))
        job = served.finished(cut)
        assert (job["state"], job["attempt"]) == ("succeeded", 2), job
        first, second = (served.client.get(f"/api/v1/jobs/{id}/files/fit.json").json() for id in (whole, cut))
        assert [step["objective"] for step in second["history"]][: len(steps)] == [
            objective for objective, _, _ in steps
        ]
        (one,), (other,) = first["parameters"], second["parameters"]
        assert abs(one["value"] - other["value"]) < 0.01 * one["sd"]
        assert abs(one["sd"] / other["sd"] - 1) < 1e-3
        records.close()


def test_a_real_diagnosis_whose_worker_is_killed_ends_with_the_gap_of_one_left_alone(tmp_path):
    settings = settings_in(tmp_path, workers=1, checkpoint_s=0.1, job_command=Settings().job_command)
    with serving(tmp_path, settings) as served:
        records = open_service(settings)
        study = served.store_study(pendulum("low"))
        left_out = [kind for kinds in families().values() for kind in kinds if kind not in LIBRARY]
        asked = {"kind": "diagnose", "study": study, "without": left_out}

        def kept(id: str) -> int:
            files = [file for file in files_of(records, CHECKPOINT + id) if file.path == "diagnosis.kept.jsonl"]
            try:
                return len(records.storage.read(files[0].key).splitlines()) - 1 if files else 0
            except FileNotFoundError:  # a longer one took its place meanwhile
                return kept(id)

        whole, cut = served.ask(asked), served.ask(asked)
        assert served.finished(whole)["attempt"] == 1
        until("some fits are kept", lambda: kept(cut) >= 3)
        (worker,) = served.processes("backend.service.jobs")
        os.kill(worker, signal.SIGKILL)
        assert "--resume" in until("it is begun again", lambda: _command_after(served, worker, cut))
        job = served.finished(cut)
        assert (job["state"], job["attempt"]) == ("succeeded", 2), job
        first, second = (served.client.get(f"/api/v1/jobs/{id}/files/gap.json").json() for id in (whole, cut))
        records.close()
    assert first.pop("wall_s") > 0.0
    assert second.pop("wall_s") > 0.0
    assert first == second


def test_a_real_ensemble_whose_worker_is_killed_keeps_its_finished_chunks(tmp_path):
    settings = settings_in(tmp_path, workers=1, checkpoint_s=0.1, job_command=Settings().job_command)
    specs, samples = [f"{DRIVE}=uniform(0.005,0.015)", f"{DRY}=uniform(0.005,0.015)"], 1500
    write_mechanism(weak_bar(), tmp_path / "weak.json")
    with serving(tmp_path, settings) as served:
        records = open_service(settings)
        asked = {"kind": "jam", "mechanism": served.store(tmp_path / "weak.json"), "samples": samples, "vary": specs}
        cut = served.ask({**asked, "duration_s": RUN["duration_s"], "step_s": RUN["step_s"]})

        def kept() -> int:
            files = [file for file in files_of(records, CHECKPOINT + cut) if file.path == "jam.kept.jsonl"]
            try:
                return len(records.storage.read(files[0].key).splitlines()) - 1 if files else 0
            except FileNotFoundError:  # a longer one took its place meanwhile
                return kept()

        until("some chunks are kept", lambda: kept() >= 3)
        (worker,) = served.processes("backend.service.jobs")
        os.kill(worker, signal.SIGKILL)
        before = kept()
        job = served.finished(cut)
        assert (job["state"], job["attempt"]) == ("succeeded", 2), job
        report = served.client.get(f"/api/v1/jobs/{cut}/result").json()["report"]
        records.close()
    assert report["throughput"]["chunks"] <= math.ceil(samples / 64) - before  # the others were not done again
    assert report["samples"] == samples
    # Half by theory, to 3 sd.  That it is the report of an ensemble left alone is seen in tests/jam/test_ensemble.py.
    assert abs(report["probability"] - 0.5) < 3 * 0.5 / math.sqrt(report["independent"])


def _command_after(served, killed: int, id: str) -> list[str] | None:
    """The command line of a job's process under another worker."""
    for worker in served.processes("backend.service.jobs"):
        for task in Path(f"/proc/{worker}/task").glob("*/children"):
            for child in task.read_text().split():
                words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
                if worker != killed and any(id in word for word in words):
                    return words
    return None
