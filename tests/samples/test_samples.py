"""The committed samples are what their scripts draw, and they are sound mechanisms."""

import itertools
import json
import time
from pathlib import Path

import numpy as np
import pytest

from backend.mechanism.graph import describe
from backend.mechanism.read import read_mechanism
from cad_export.script import draw, export_script

SAMPLES = Path(__file__).parents[2] / "samples"
MOBILITY = {"pendulum": 1, "double_pendulum": 2, "fourbar": 1, "slider_crank": 1, "scissor": 1, "bennett": 1}
LOOPS = {"pendulum": 0, "double_pendulum": 0, "fourbar": 1, "slider_crank": 1, "scissor": 10, "bennett": 1}


def test_every_sample_is_tested():
    assert {path.parent.name for path in SAMPLES.glob("*/design.py")} == set(MOBILITY)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    made = {}

    def export(name):
        if name not in made:
            made[name] = export_script(SAMPLES / name / "design.py", tmp_path_factory.mktemp(name))
        return made[name]

    return export


def differences(a, b, where=""):
    """Paths at which two JSON documents differ by more than 1e-12, relative to the larger of the numbers and 1."""
    if isinstance(a, dict) and isinstance(b, dict):
        if a.keys() != b.keys():
            yield f"{where}: {sorted(a)} against {sorted(b)}"
        else:
            for key in a:
                yield from differences(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for index, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from differences(x, y, f"{where}[{index}]")
    elif isinstance(a, float) and isinstance(b, float):
        # Lengths and quaternions are of order 1; an inertia is compared on its own scale.
        scale = max(abs(a), abs(b)) if "inertia" in where else max(1.0, abs(a))
        if abs(a - b) > 1e-12 * scale:
            yield f"{where}: {a!r} against {b!r}"
    elif a != b:
        yield f"{where}: {a!r} against {b!r}"


@pytest.mark.parametrize("name", MOBILITY)
def test_the_committed_file_is_what_the_script_draws(name, fresh):
    documents = [json.loads(path.read_text("utf-8")) for path in (SAMPLES / name / "mechanism.json", fresh(name))]
    for document in documents:
        for stamp in ("created", "tool_version", "exporter_version"):
            document["provenance"].pop(stamp)
    remedy = f"run: SOURCE_DATE_EPOCH=1795219200 python samples/{name}/design.py"
    assert list(differences(*documents)) == [], remedy


def test_the_comparison_of_files_sees_a_changed_digit():
    assert list(differences({"a": [1.0, 2.0]}, {"a": [1.0, 2.0 + 1e-11]}))
    assert list(differences({"inertia": 1e-9}, {"inertia": 1e-9 * (1 + 1e-11)}))
    assert not list(differences({"a": [1.0]}, {"a": [1.0 + 1e-14]}))


@pytest.mark.parametrize("name", MOBILITY)
def test_a_sample_moves_as_its_readme_says_and_its_loops_close(name):
    report = describe(read_mechanism(SAMPLES / name / "mechanism.json"))
    assert report.ok, report.errors
    assert report.warnings == ()
    assert report.mobility.by_rank == MOBILITY[name]
    assert len(report.loops) == LOOPS[name]
    assert max(joint.gap_mm for joint in report.closure) < 1e-6  # far inside any reader's tolerance
    # The pages say it too.
    assert f"Degrees of freedom: {MOBILITY[name]}" in (SAMPLES / name / "README.md").read_text("utf-8")


@pytest.mark.parametrize("name", MOBILITY)
def test_a_sample_can_be_weighed_and_followed(name):
    mechanism = read_mechanism(SAMPLES / name / "mechanism.json")
    least = 1 if name == "scissor" else 2  # a scissor has a dot at every pin; the slider's pin is B0's
    for body in mechanism.moving_bodies():
        assert body.inertial.mass_kg > 1e-3
        followed = sum(marker.body == body.id for marker in mechanism.markers)
        assert followed >= least or body.id == "slider", body.id


@pytest.mark.parametrize("name", MOBILITY)
def test_every_pin_of_a_sample_sits_loosely_in_its_hole(name):
    for joint in read_mechanism(SAMPLES / name / "mechanism.json").joints:
        if joint.type == "revolute":
            assert joint.fit.radial_clearance_m == pytest.approx(5e-5, abs=1e-12)
            assert joint.fit.bearing_length_m >= 0.005 - 1e-12


@pytest.mark.parametrize("name", MOBILITY)
def test_no_two_parts_of_a_sample_share_volume(name):
    parts = draw(SAMPLES / name / "design.py", {"cells": 2} if name == "scissor" else {}).parts.values()
    placed = {part.path: part.shape.moved(part.X_WP.location()) for part in parts}
    for (a, solid_a), (b, solid_b) in itertools.combinations(placed.items(), 2):
        assert solid_a.intersect(solid_b).Volume() < 1e-6, (a, b)


def test_bennetts_loop_closes_exactly(fresh):
    report = describe(read_mechanism(fresh("bennett")))
    assert max(joint.gap_mm for joint in report.closure) < 1e-9
    assert report.mobility.redundant_rows == 3  # counting says -2, yet it moves


@pytest.mark.parametrize("turn_deg", [100.0, 120.0])
def test_bennetts_loop_closes_at_other_turns_too(turn_deg):
    mechanism = draw(SAMPLES / "bennett" / "design.py", {"turn_deg": turn_deg}).mechanism()
    assert max(joint.gap_mm for joint in describe(mechanism).closure) < 1e-9


def test_a_scissor_of_23_cells_is_exported_in_seconds(tmp_path):
    start = time.perf_counter()
    path = export_script(SAMPLES / "scissor" / "design.py", tmp_path, {"cells": "23"})
    assert time.perf_counter() - start < 10.0  # about 1 s on two cores: each bar is weighed and meshed once
    mechanism = read_mechanism(path)
    assert len(mechanism.moving_bodies()) == 2 * 23 + 1
    assert len(mechanism.joints) == 23 + 2 * 22 + 3
    assert len(list((tmp_path / "meshes").iterdir())) == 4
    assert describe(mechanism).mobility.by_rank == 1


def test_the_scissors_springs_are_stretched_so_that_they_open_it():
    mechanism = read_mechanism(SAMPLES / "scissor" / "mechanism.json")
    for spring in mechanism.effects:
        ends = []
        for body, anchor in zip(spring.on, ("anchor_a_m", "anchor_b_m"), strict=True):
            pose = mechanism.body(body).pose
            ends.append(np.array(pose.position_m) + pose.rotation() @ np.array(spring.parameters[anchor]))
        length = np.linalg.norm(ends[0] - ends[1])
        assert spring.parameters["free_length_m"] == pytest.approx(0.7 * length, rel=1e-12)
    assert [effect.id for effect in mechanism.effects] == ["start_spring", "end_spring"]
    bare = draw(SAMPLES / "scissor" / "design.py", {"cells": 1, "spring_n_per_m": 0}).mechanism()
    assert bare.effects == ()
