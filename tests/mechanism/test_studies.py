"""Studies: good ones are read with their tables, bad ones refused by file, row and remedy."""

import json
import time
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.fit_report import FitReport
from backend.mechanism.jam_report import run_folder
from backend.mechanism.joint import JointType
from backend.mechanism.read import parse, parse_mechanism, parse_study, read_study
from backend.mechanism.study import ExperimentFile, Release, StudyFile, Tolerance, study_problems
from backend.mechanism.tracks import read_table
from tests.mechanisms import bead_on_bar, document, effect, fourbar, pendulum

TRACKS = "time_s,marker,x_m,y_m,z_m,sigma_m\n0,tip,0.1,,0.2,\n0.01,tip,0.1,,0.2,0.001\n0.02,tip,,,,\n"
JOINTS = "time_s,joint,q,sigma\n0,j1,0.1,0.001\n0.01,j1,0.2,\n"
INPUTS = "time_s,effect,parameter,value\n0,s1,stiffness_n_per_m,2870\n0.01,s1,stiffness_n_per_m,0\n"
EFFORTS = "time_s,joint,effort,sigma\n0,j1,0.1,0.001\n0.01,j1,0.2,0.002\n"


@pytest.fixture
def study(tmp_path, drawings):
    """Writes a study with every kind of table and returns a function that spoils and reads it."""
    document = {
        "schema_version": "1.0",
        "mechanism": "mechanism.json",
        "experiments": [
            {
                "id": "e1",
                "tracks": "t.csv",
                "joint_positions": "q.csv",
                "inputs": "u.csv",
                "joint_efforts": "f.csv",
                "video": None,
                "release": {"time_s": 0.005, "at_rest": True},
                "overrides": {"s1": {"free_length_m": 0.04}},
            }
        ],
        "tolerances": [{"kind": "mass_error", "on": ["link1"], "sd": 0.02}],
    }
    tables = {"t.csv": TRACKS, "q.csv": JOINTS, "u.csv": INPUTS, "f.csv": EFFORTS}

    def read(spoil=None, **kwargs):
        if spoil:
            spoil(document, tables)
        (tmp_path / "mechanism.json").write_text(json.dumps(drawings.pendulum()))
        (tmp_path / "study.json").write_text(json.dumps(document))
        for file, text in tables.items():
            (tmp_path / file).write_text(text)
        return read_study(tmp_path / "study.json", **kwargs)

    return read


def test_a_study_is_read_with_all_its_tables(study):
    found = study()
    (e1,) = found.experiments
    assert found.mechanism.name == "pendulum"
    assert found.fit == (e1,)
    assert found.held_out == ()
    assert list(e1.tracks.columns) == ["time_s", "marker", "x_m", "y_m", "z_m", "sigma_m"]
    assert e1.tracks["x_m"].tolist()[:2] == [0.1, 0.1]
    assert np.isnan(e1.tracks["x_m"][2])  # an empty coordinate was not measured
    assert e1.tracks["y_m"].isna().all()
    assert e1.joint_positions["q"].tolist() == [0.1, 0.2]
    assert e1.inputs["value"].tolist() == [2870, 0]
    assert e1.joint_efforts["sigma"].tolist() == [0.001, 0.002]
    assert e1.release.window_s == 0.3
    assert e1.overrides == {"s1": {"free_length_m": 0.04}}
    assert found.tolerances[0].sd == 0.02
    assert found.experiment("e1") is e1
    with pytest.raises(DrawingError, match=r'no experiment "e7".*"e1"'):
        found.experiment("e7")


def test_null_says_as_much_as_leaving_an_optional_field_out(study):
    def nulled(document, tables):
        document["experiments"][0] |= {"use": None, "overrides": None, "video": None, "release": {"time_s": 0.0,
                                       "at_rest": None, "window_s": None}}  # fmt: skip
        document["tolerances"] = None

    found = study(nulled)
    assert found.experiments[0].use == "fit"
    assert found.experiments[0].overrides == {}
    assert found.experiments[0].release.window_s == 0.3
    assert found.tolerances == ()


@pytest.mark.parametrize(("parameters", "faults"), [({"restitution": 0.5}, 0), ({"shape": "rectangle"}, 1)])
def test_an_experiment_may_change_a_value_but_not_how_an_effect_is_built(parameters, faults):
    drawn = fourbar([effect("play", "clearance", "all", radial_m=1e-4)])
    entry = {"id": "e1", "tracks": "t.csv", "release": {"time_s": 0.0}, "overrides": {"play": parameters}}
    file = StudyFile.model_validate({"mechanism": "mechanism.json", "experiments": [entry]})
    problems = list(study_problems(file, drawn))
    assert len(problems) == faults
    assert all("draw it so" in problem for problem in problems)


@pytest.mark.parametrize(
    ("on", "drawn", "override", "faults"),
    [
        (["pin", "rail"], {"friction_torque_n_m": 0.1, "friction_force_n": 1.0}, "friction_torque_n_m", 0),
        ("all", {"friction_torque_n_m": 0.1, "friction_force_n": 1.0}, "friction_torque_n_m", 0),
        ("all", {"friction_force_n": 1.0}, "friction_torque_n_m", 1),
        ("all", {}, "friction_torque_n_m", 0),
        (["rail"], {"friction_force_n": 1.0}, "friction_torque_n_m", 1),
    ],
)
def test_an_override_means_something_where_its_effect_stands(on, drawn, override, faults):
    rub = bead_on_bar([effect("rub", "coulomb_friction", on, **drawn)])
    entry = {"id": "e1", "tracks": "t.csv", "release": {"time_s": 0.0}, "overrides": {"rub": {override: 0.2}}}
    file = StudyFile.model_validate({"mechanism": "mechanism.json", "experiments": [entry]})
    problems = list(study_problems(file, rub))
    assert len(problems) == faults
    assert all('joint "rail", which is prismatic; use friction_force_n' in problem for problem in problems)


def test_a_recorded_force_means_something_where_its_effect_stands(tmp_path):
    (tmp_path / "u.csv").write_text("time_s,effect,parameter,value\n0,motor,force_n,1\n")
    for on in (["rail"], "all"):
        read_table("inputs", tmp_path / "u.csv", bead_on_bar([effect("motor", "effort_offset", on)]))
    with pytest.raises(DrawingError, match=r'row 2: force_n does not suit joint "pin", which is revolute; use torque'):
        read_table("inputs", tmp_path / "u.csv", bead_on_bar([effect("motor", "effort_offset", ["pin"])]))


def test_an_override_of_a_bodys_effect_asks_no_joint_of_the_bodys_name():
    parts = document(pendulum(effects=[effect("wind", "air_drag", ["link"], drag_area_m2=1e-3)]))
    parts["joints"][0] |= {"id": "link", "type": "spherical"}
    entry = {"id": "e1", "tracks": "t.csv", "release": {"time_s": 0.0}, "overrides": {"wind": {"drag_area_m2": 2e-3}}}
    file = StudyFile.model_validate({"mechanism": "mechanism.json", "experiments": [entry]})
    assert list(study_problems(file, parse_mechanism(parts))) == []


def test_the_trackers_own_columns_and_statuses_are_kept(study):
    table = (
        "time_s,marker,x_m,y_m,z_m,sigma_m,frame,x_px,y_px,cov_xx_px2,cov_xy_px2,cov_yy_px2,status\n"
        "0,tip,0,0,0,,0,1,2,.1,0,.1,ok\n.01,tip,0,0,0,,1,1,2,.1,0,.1,occluded\n.02,tip,,,,,2,,,,,,predicted\n"
    )
    tracks = study(lambda document, tables: tables.update({"t.csv": table})).experiments[0].tracks
    assert tracks["status"].tolist() == ["ok", "occluded", "predicted"]
    assert tracks["frame"].tolist() == [0, 1, 2]


PIXELS = "time_s,marker,x_px,y_px,cov_xx_px2,cov_xy_px2,cov_yy_px2\n0,tip,10,20,.01,0,.01\n.01,tip,11,21,.01,0,.01\n"


def test_tracks_in_pixels_alone_are_read_where_their_camera_is_named(study, tmp_path):
    (tmp_path / "camera.json").write_text("{}")

    def spoil(document, tables):
        tables["t.csv"] = PIXELS
        document["experiments"][0]["camera"] = "camera.json"

    (e1,) = study(spoil).experiments
    assert e1.camera == tmp_path / "camera.json"
    assert e1.tracks["x_px"].tolist() == [10, 11]
    assert e1.tracks[["x_m", "y_m", "z_m", "sigma_m"]].isna().all(axis=None)


def test_blanks_after_commas_say_nothing(study):
    close = study().experiments[0]
    apart = study(lambda document, tables: tables.update({f: t.replace(",", ", ") for f, t in tables.items()}))
    for name in ("tracks", "joint_positions", "inputs", "joint_efforts"):
        pd.testing.assert_frame_equal(getattr(apart.experiments[0], name), getattr(close, name))


def test_each_row_of_a_file_that_was_appended_to_itself_is_a_repeat(study):
    with pytest.raises(DrawingError) as refusal:
        study(lambda document, tables: tables.update({"t.csv": TRACKS + TRACKS.split("\n", 1)[1]}))
    assert [p.split("is repeated from ")[1][:5] for p in refusal.value.problems] == ["row 2", "row 3", "row 4"]


def test_a_tolerance_of_all_may_be_narrowed_part_by_part(study):
    wide = {"kind": "mass_error", "on": "all", "sd": 0.05}
    assert len(study(lambda document, tables: document["tolerances"].insert(0, wide)).tolerances) == 2


def test_a_table_without_a_column_of_noise_leaves_it_to_be_estimated(study):
    table = "time_s,joint,q\n0,j1,0.1\n0.01,j1,0.2\n"
    found = study(lambda document, tables: tables.update({"q.csv": table}))
    assert found.experiments[0].joint_positions["sigma"].isna().all()


def test_parquet_and_csv_tell_the_same(study, tmp_path):
    def as_parquet(document, tables):
        frame = pd.DataFrame({"time_s": [0.0, 0.01], "joint": ["j1", "j1"], "q": [0.1, 0.2], "sigma": [0.001, None]})
        frame.to_parquet(tmp_path / "q.parquet")
        document["experiments"][0]["joint_positions"] = "q.parquet"

    csv, parquet = study().experiments[0].joint_positions, study(as_parquet).experiments[0].joint_positions
    pd.testing.assert_frame_equal(csv, parquet)


def table(file, text):
    return lambda document, tables: tables.update({file: text})


def row(file, text):
    return lambda document, tables: tables.update({file: tables[file] + text})


def experiment(**fields):
    return lambda document, tables: document["experiments"][0].update(fields)


def tolerance(**fields):
    return lambda document, tables: document["tolerances"][0].update(fields)


def both(one, other):
    return lambda document, tables: (one(document, tables), other(document, tables))


def without_time(document, tables):
    tables["t.csv"] = TRACKS.replace("0.01,tip", "inf,tip")


FAULTS = {
    "no such table": (
        experiment(tracks="gone.csv"),
        ['experiment "e1": gone.csv: does not exist; correct the path, which counts from study.json'],
    ),
    "empty table": (table("t.csv", ""), ["t.csv", "is empty", "names the columns"]),
    "only a header": (table("q.csv", "time_s,joint,q,sigma\n"), ["q.csv", "no rows", "record"]),
    "missing column": (table("q.csv", "time_s,joint\n0,j1\n"), ["q.csv", "lacks column q", "time_s,joint"]),
    "unknown column": (
        table("q.csv", "time_s,joint,q,speed\n0,j1,0,1\n"),
        ["q.csv", "'speed'", "remove it", '"sigma"'],
    ),
    "column twice": (table("q.csv", "time_s,joint,q,q\n0,j1,0,1\n"), ["q.csv", "column q stands twice"]),
    "cut off in the last row": (row("t.csv", "0.03,tip,0.1"), ["t.csv", "row 5 has 3 values", "cut off"]),
    "short row in the middle": (
        table("q.csv", "time_s,joint,q,sigma\n0,j1\n1,j1,0,\n"),
        ["q.csv", "row 2 has 2 values", "header names 4", "correct it"],
    ),
    "unknown marker": (row("t.csv", "0,toe,0,0,0,\n"), ["t.csv", "row 5", 'marker "toe"', 'Known: "tip"']),
    "unknown joint": (row("q.csv", "0,j7,0,\n"), ["q.csv", "row 4", 'joint "j7"', 'Known: "j1"']),
    "unknown joint with a sensor": (
        row("f.csv", "0,j7,0,\n"),
        ["f.csv", "row 4", 'joint "j7"', 'Known: "j1"'],
    ),
    "unknown driven effect": (row("u.csv", "0,motor,force_n,0\n"), ["u.csv", "row 4", '"motor"', '"s1"']),
    "unknown driven parameter": (
        row("u.csv", "0,s1,force,0\n"),
        ["u.csv", "row 4", '"force"', "free_length_m"],
    ),
    "driven list": (row("u.csv", "0,s1,anchor_a_m,0\n"), ["u.csv", "row 4", "anchor_a_m", "list of 3"]),
    "driven beyond its bound": (
        row("u.csv", "0.02,s1,stiffness_n_per_m,-5\n"),
        ["u.csv", "row 4", "-5", "outside its bounds 0", "correct"],
    ),
    "driven by nothing": (
        row("u.csv", "0.02,s1,stiffness_n_per_m,\n"),
        ["u.csv", "row 4", "value is empty", "finite"],
    ),
    "infinite time": (without_time, ["t.csv", "row 3", "time_s is inf", "finite"]),
    "no time": (row("q.csv", ",j1,0,\n"), ["q.csv", "row 4", "time_s is empty", "finite"]),
    "infinite coordinate": (
        row("t.csv", "1,tip,inf,0,0,\n"),
        ["t.csv", "row 5", "x_m is inf", "leave it empty"],
    ),
    "text for a number": (row("q.csv", "1,j1,fast,\n"), ["q.csv", "row 4", "'fast'", "write a number"]),
    "underscore in a number": (row("q.csv", "1,j1,1_0,\n"), ["q.csv", "row 4", "'1_0'", "write a number"]),
    "rows out of order": (
        row("t.csv", "0.015,tip,0,0,0,\n"),
        ["t.csv", 'row 5 is out of order: time_s 0.015 s of marker "tip" stands below 0.02 s in row 4', "sort"],
    ),
    "time repeated": (
        row("q.csv", "0.01,j1,0,\n"),
        ["q.csv", 'row 4: time_s 0.01 s of joint "j1" is repeated from row 3', "keep one"],
    ),
    "time repeated far below": (
        row("t.csv", "0.03,tip,0,0,0,\n0.01,tip,0,0,0,\n"),
        ["t.csv", 'row 6: time_s 0.01 s of marker "tip" is repeated from row 3', "keep one"],
    ),
    "drive repeated": (
        row("u.csv", "0,s1,stiffness_n_per_m,1\n"),
        ["u.csv", 'row 4: time_s 0 s of effect "s1" parameter "stiffness_n_per_m" is repeated from row 2'],
    ),
    "negative sigma": (
        row("q.csv", "0.02,j1,0,-0.1\n"),
        ["q.csv", "row 4", "sigma is -0.1", "leave it empty"],
    ),
    "zero sigma": (row("t.csv", "0.03,tip,0,0,0,0\n"), ["t.csv", "row 5", "sigma_m is 0", "above zero"]),
    "unknown status": (
        table("t.csv", "time_s,marker,x_m,y_m,z_m,sigma_m,status\n0,tip,0,0,0,,lost\n"),
        ["t.csv", "row 2", '"lost"', "occluded"],
    ),
    "broken parquet": (
        both(experiment(tracks="t.parquet"), table("t.parquet", "no")),
        ["t.parquet", "cannot be read as Parquet", "check"],
    ),
    "release after the last sample": (
        experiment(release={"time_s": 9.0}),
        ["release.time_s is 9 s", "last sample is at 0.02 s", "check the clock"],
    ),
    "no release": (
        lambda document, tables: document["experiments"][0].pop("release"),
        ['experiment "e1": release is missing'],
    ),
    "negative window": (
        experiment(release={"time_s": 0.0, "window_s": -1}),
        ['experiment "e1": release.window_s', "-1", "above 0"],
    ),
    "nothing measured": (
        experiment(tracks=None, joint_positions=None, joint_efforts=None),
        ['experiment "e1"', "0 tables of measurements", "name its tracks"],
    ),
    "unknown use": (experiment(use="test"), ['experiment "e1": use', "'test'", "'held_out'"]),
    "override of no effect": (experiment(overrides={"s9": {"x": 1}}), ['"e1"', '"s9"', 'Known: "f1", "s1"']),
    "override of no parameter": (
        experiment(overrides={"s1": {"stiffness": 1}}),
        ['"e1"', '"s1"', '"stiffness" is unknown', "stiffness_n_per_m"],
    ),
    "override of what is recorded": (
        experiment(overrides={"s1": {"stiffness_n_per_m": 3000}}),
        ['"e1": effect "s1": stiffness_n_per_m is set in overrides and recorded in u.csv', "remove the override"],
    ),
    "override beyond its bound": (
        experiment(overrides={"s1": {"stiffness_n_per_m": -1}}),
        ['"s1"', "-1 N/m", "lower bound 0"],
    ),
    "unknown field": (experiment(note="x"), ['experiment "e1": note', "'x'", "remove it"]),
    "no experiments": (
        lambda document, tables: document.update(experiments=[]),
        ["experiments has 0 entries", "at least 1"],
    ),
    "experiment twice": (
        lambda document, tables: document["experiments"].append(document["experiments"][0]),
        ['experiment "e1" stands 2 times', "rename"],
    ),
    "tolerance of no kind": (tolerance(kind="weight"), ['tolerance 1 ("weight")', "unknown", "mass_error"]),
    "tolerance of no body": (tolerance(on=["arm"]), ['tolerance 1 ("mass_error")', '"arm"', '"link1"']),
    "tolerance without width": (tolerance(sd=0), ["tolerance 1: sd is 0", "above 0"]),
    "tolerance stated again": (
        lambda document, tables: document["tolerances"].append({"kind": "mass_error", "on": ["link1"], "sd": 0.05}),
        ['tolerance 2 ("mass_error"): "link1" has sd 0.05 here and 0.02 in tolerance 1', "keep one"],
    ),
    "tolerance of all below one of a part": (
        lambda document, tables: document["tolerances"].append({"kind": "mass_error", "on": "all", "sd": 0.05}),
        ['tolerance 2 ("mass_error"): "link1" has sd 0.05 here and 0.02 in tolerance 1', "keep one"],
    ),
    "tracks in millimetres": (
        table("t.csv", "time_s,marker,x_m,y_m,z_m\n0,tip,95,10,0\n0.01,tip,96,9,\n0.02,tip,95,10,\n"),
        ['t.csv: marker "tip" is seen 95', "from where it is drawn", "places are in m (1 mm is 0.001)"],
    ),
    "no such mechanism": (
        lambda document, tables: document.update(mechanism="m.json"),
        ["m.json", "No such file"],
    ),
    "pixels without a camera": (table("t.csv", PIXELS), ["t.csv: holds no place in metres", "camera.json"]),
    "a camera that is no file": (experiment(camera="lens.json"), ["lens.json: is no file", "linktwin track"]),
    "another version": (
        lambda document, tables: document.update(schema_version="3.0"),
        ["3.0 is not supported"],
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_study_is_refused_with_part_number_and_remedy(study, fault):
    spoil, terms = FAULTS[fault]
    with pytest.raises(DrawingError) as refusal:
        study(spoil)
    for term in terms:
        assert term in str(refusal.value)


@pytest.mark.parametrize("spoilt", [{"use": "test"}, {"overrides": {"s1": {"stiffness_n_per_m": True}}}])
def test_the_fault_of_the_only_experiment_is_told_alone(study, spoilt):
    with pytest.raises(DrawingError) as refusal:
        study(experiment(**spoilt))
    (problem,) = refusal.value.problems
    assert 'experiment "e1"' in problem
    with pytest.raises(DrawingError, match="experiments has 0 entries; it takes at least 1"):
        study(lambda document, tables: document.update(experiments=[]))


def test_faults_of_several_tables_are_listed_together(study):
    def spoil(document, tables):
        tables["t.csv"] += "0,toe,0,0,0,\n"
        tables["q.csv"] += "0,j7,0,\n"
        document["tolerances"][0]["on"] = ["arm"]

    with pytest.raises(DrawingError) as refusal:
        study(spoil)
    assert len(refusal.value.problems) == 3


def test_a_column_of_nonsense_is_told_in_a_few_lines(study):
    rows = "".join(f"{t},j1,x,\n" for t in range(1000))
    with pytest.raises(DrawingError) as refusal:
        study(table("q.csv", "time_s,joint,q,sigma\n" + rows))
    assert len(refusal.value.problems) == 6
    assert "995 more" in refusal.value.problems[-1]


@pytest.mark.parametrize("uri", ["../outside.csv", "/etc/hostname", "a/../../outside.csv", "link/outside.csv"])
def test_a_root_keeps_a_study_inside_its_folder(study, tmp_path, uri):
    (tmp_path / "link").symlink_to(tmp_path.parent)
    with pytest.raises(DrawingError, match="leaves the folder"):
        study(experiment(tracks=uri), root=tmp_path)


def test_without_a_root_a_table_may_lie_elsewhere(study, tmp_path):
    (tmp_path / "deep").mkdir()
    found = study()
    document = json.loads((tmp_path / "study.json").read_text())
    document["mechanism"] = "../mechanism.json"
    for name in ("tracks", "joint_positions", "inputs", "joint_efforts"):
        document["experiments"][0][name] = "../" + document["experiments"][0][name]
    assert parse_study(document, tmp_path / "deep").mechanism == found.mechanism


def test_a_path_that_is_none_is_refused(study, tmp_path):
    with pytest.raises(DrawingError):
        study(experiment(tracks="a\0b"))


def test_the_studies_of_real_rigs_are_read(real_data):
    files = sorted(real_data.glob("*/study*.json"))
    assert len({file.parent for file in files}) == 5
    for file in files:
        found = read_study(file)
        assert found.fit
        assert found.held_out
        for experiment in found.experiments:
            seen = experiment.tracks if experiment.tracks is not None else experiment.joint_positions
            assert seen is not None
            assert len(seen) > 100


def test_a_fit_report_says_what_the_data_do_not_bound():
    document = {
        "schema_version": "1.0",
        "parameters": [
            {
                "name": "coulomb_friction:j1.friction_torque_n_m",
                "kind": "coulomb_friction",
                "on": ["j1"],
                "parameter": "friction_torque_n_m",
                "value": 0.011,
                "sd": None,
                "ci95": [0.0, None],
                "unit": "N m",
                "at_bound": True,
            }
        ],
        "correlation": [[1.0]],
        "converged": True,
        "wall_s": 3.2,
    }
    report = parse(FitReport, document, "fit.json")
    assert report.parameters[0].ci95 == (0.0, None)
    with pytest.raises(DrawingError, match="wall_s is -1"):
        parse(FitReport, {**document, "wall_s": -1}, "fit.json")


def test_every_experiment_has_a_folder_of_its_own_among_the_files_of_its_study():
    ids = ["run 1", "run_1", "r#1", "r 1", "report.json", "jam.json", "jam.html", ".", "..", "../..", "###", "ä" * 300]
    folders = [run_folder(id) for id in ids]
    assert len(set(folders)) == len(ids)
    assert folders[1] == "run_1"  # a plain name stays as it is
    for folder in folders:
        assert folder
        assert "/" not in folder
        assert not folder.startswith(".")
        assert not folder.endswith((".json", ".html"))
        assert len(folder.encode()) < 200


def test_a_table_of_many_repeated_columns_is_refused_at_once(study):
    names = ",".join(f"c{number}" for number in range(100_000))
    began = time.process_time()
    with pytest.raises(DrawingError, match="column c0, c1, c10, c100, c1000 and 99995 more stands twice"):
        study(table("q.csv", f"{names},{names}\n"))
    assert time.process_time() - began < 5.0  # counted one by one: an hour


def test_the_page_names_every_field_of_an_experiment_every_joint_type_and_the_list_of_effects():
    page = (Path(__file__).parents[2] / "docs" / "mechanism.md").read_text("utf-8")
    fields = [*ExperimentFile.model_fields, *Release.model_fields, *Tolerance.model_fields]
    assert [name for name in fields if f"`{name}`" not in page and f'"{name}"' not in page] == []
    assert [name for name in get_args(JointType) if f"\n| {name} |" not in page] == []
    assert "[effects.md](effects.md)" in page  # written from the declarations, all parameters of all kinds
