"""Running a design script with settings."""

import json
import re
from pathlib import Path
from textwrap import dedent

import pytest

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.read import read_mechanism
from cad_export.__main__ import main
from cad_export.script import export_script

SCRIPT = """\
from __future__ import annotations
import cadquery as cq
from cad_export import Drawing
print("a script may talk")

def design(length_mm: float = 40.0, cells: int = 2, heavy: bool = False, name: str = "rig", width_mm=10.0) -> Drawing:
    assembly = cq.Assembly(name=name)
    for i in range(cells):
        assembly.add(cq.Workplane().box(length_mm, width_mm, 10), name=f"b{i}")
    drawing = Drawing(assembly)
    drawing.ground("b0")
    drawing.material(density_kg_per_m3=7850 if heavy else 1000)
    return drawing
"""


@pytest.fixture
def script(tmp_path):
    def write(text=SCRIPT):
        path = tmp_path / "design.py"
        path.write_text(dedent(text), "utf-8")
        return path

    return write


def test_settings_reach_the_design_as_the_types_it_declares(script, tmp_path):
    settings = {"cells": "3", "length_mm": "20", "heavy": "true", "name": "übung", "width_mm": "5"}
    mechanism = read_mechanism(export_script(script(), tmp_path / "out", settings))
    assert mechanism.name == "übung"
    assert len(mechanism.bodies) == 3
    assert mechanism.body("b1").inertial.mass_kg == pytest.approx(20 * 5 * 10e-9 * 7850, rel=1e-12)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"cell": "3"}, r'setting "cell" is unknown to design. Known: "cells", "heavy"'),
        ({"cells": "3.5"}, r"setting \"cells\" is '3.5'; write a whole number. Known: .*cells: int = 2"),
        ({"cells": True}, r"whole number|declare settings"),
        ({"heavy": "maybe"}, r"write true or false"),
        ({"length_mm": "long"}, r"setting \"length_mm\" is 'long'; write a number"),
    ],
)
def test_unsuitable_settings_are_refused_listing_the_known_ones(script, tmp_path, settings, sentence):
    with pytest.raises(DrawingError, match=sentence):
        export_script(script(), tmp_path / "out", settings)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("def design():\n    return 1 / 0\n", r"design.py, line 2: ZeroDivisionError: division by zero; correct"),
        ("import nonsense_module\n", r"line 1: ModuleNotFoundError"),
        ("x = 1\ndef design(:\n", r"line 2: SyntaxError"),
        ("x = 1\nraise SystemExit(3)\n", r"line 2: SystemExit: 3"),
        ("x = 1\n", r"defines no design\(\.\.\.\)"),
        ("def design():\n    return 3\n", r"returned int; return the Drawing"),
        ("def design(*more, **others):\n    return 3\n", r"returned int; return the Drawing"),
        ("def design(cells: int):\n    return 3\n", r'setting "cells" has no default; give it: --set cells='),
        ("def design(cells: list = ()):\n    return 3\n", None),
        (
            "import cadquery as cq\nfrom cad_export import Drawing\n"
            "def design():\n    d = Drawing(cq.Assembly(cq.Workplane().box(1, 1, 1), name='a'))\n"
            "    d.ground('b')\n    return d\n",
            r'line 5: there is no part "b" in the assembly. Known: "a"',
        ),
    ],
)
def test_a_failing_script_is_blamed_by_line(script, tmp_path, text, sentence):
    settings = {} if sentence else {"cells": "3"}
    with pytest.raises(DrawingError, match=sentence or "declare settings as int, float, bool or str"):
        export_script(script(text), tmp_path / "out", settings)


def test_a_missing_script_is_named(tmp_path):
    with pytest.raises(DrawingError, match=r"nowhere.py: is not a file; check the path"):
        export_script(tmp_path / "nowhere.py", tmp_path)


def test_a_script_may_import_what_lies_beside_it(script, tmp_path):
    (tmp_path / "sizes_beside_the_script.py").write_text("LENGTH = 30.0\n")
    text = SCRIPT.replace("import cadquery", "from sizes_beside_the_script import LENGTH\nimport cadquery")
    assert export_script(script(text), tmp_path / "out").is_file()


def test_the_command_reports_on_stdout_and_leaves_the_scripts_talk_to_stderr(script, tmp_path, capsys):
    code = main([str(script()), "--set", "cells=4", "--out", str(tmp_path / "out"), "--json"])
    captured = capsys.readouterr()
    assert code == 0
    assert json.loads(captured.out)["bodies"] == 4
    assert "a script may talk" in captured.err


def test_the_command_fails_with_a_sentence(script, tmp_path, capsys):
    assert main([str(script()), "--set", "cell=4", "--out", str(tmp_path / "out")]) == 1
    assert 'setting "cell" is unknown' in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main([str(script()), "--set", "cells"])


def test_the_command_says_where_it_could_not_write(script, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main([str(script()), "--out", str(tmp_path / "taken" / "inside")]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert str(tmp_path / "taken") in said
    assert "choose another --out" in said


def test_the_example_of_the_page_runs(script, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "cad_export.md").read_text("utf-8")
    example = re.search(r"```python\n(.*?)```", page, re.DOTALL).group(1)
    mechanism = read_mechanism(export_script(script(example), tmp_path / "out", {"length_mm": "150"}))
    assert mechanism.joint("pivot").fit.radial_clearance_m == 5e-5
    assert mechanism.marker("tip").position_m[0] == pytest.approx(0.15, abs=1e-15)
