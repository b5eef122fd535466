"""The add-in runs in Fusion's own Python: 3.9 or later, the standard library and adsk, nothing of ours."""

import ast
import json
import re
import struct
import sys
from pathlib import Path

import pytest

from tests.plugin_fusion.addin import ROOT

FILES = sorted(ROOT.rglob("*.py"))
PURE = sorted((ROOT / "lib").glob("*.py"))
NEWER_THAN_3_9 = {"tomllib", "_colorize"}


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_is_written_in_the_grammar_of_python_3_9(path):
    ast.parse(path.read_text(encoding="utf-8"), str(path), feature_version=(3, 9))


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_imports_the_standard_library_adsk_and_the_addin_only(path):
    allowed = (sys.stdlib_module_names - NEWER_THAN_3_9) | {"adsk"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert {alias.name.split(".")[0] for alias in node.names} <= allowed
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert str(node.module).split(".")[0] in allowed
        elif isinstance(node, ast.ImportFrom):
            above = path.parent
            for _ in range(node.level - 1):
                above = above.parent
            assert above == ROOT or ROOT in above.parents, "an import that leaves the add-in"


@pytest.mark.parametrize("path", FILES, ids=name)
def test_no_annotation_is_evaluated_that_python_3_9_cannot(path):
    """`X | None` is text under `from __future__ import annotations`; elsewhere 3.9 would fail on it."""
    text = path.read_text(encoding="utf-8")
    annotated = any(
        isinstance(node, (ast.FunctionDef, ast.AnnAssign)) and _annotations(node) for node in ast.walk(ast.parse(text))
    )
    assert not annotated or "from __future__ import annotations" in text


def _annotations(node) -> bool:
    if isinstance(node, ast.AnnAssign):
        return True
    arguments = [*node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
    return node.returns is not None or any(argument and argument.annotation for argument in arguments)


def test_nothing_newer_than_python_3_9_is_called():
    newer = re.compile(
        r"strict=(True|False)|\bdatetime\.UTC\b|from datetime import UTC|slots=True|kw_only=True|itertools\.pairwise"
    )
    for path in FILES:
        assert not newer.search(path.read_text(encoding="utf-8")), name(path)


def test_only_the_buttons_and_their_handlers_import_fusion():
    touching = {name(path) for path in FILES if "import adsk" in path.read_text(encoding="utf-8")}
    assert touching == {
        "LinkTwin.py",
        "commands/button.py",
        "commands/export/entry.py",
        "commands/export/palette.py",
        "commands/settings/entry.py",
        "lib/handlers.py",
    }


def test_the_manifest_is_named_as_its_folder_and_tells_what_fusion_asks():
    manifest = json.loads((ROOT / f"{ROOT.name}.manifest").read_text(encoding="utf-8"))
    assert (ROOT / f"{ROOT.name}.py").is_file()
    assert set(manifest) == {
        "autodeskProduct",
        "type",
        "id",
        "author",
        "description",
        "version",
        "runOnStartup",
        "supportedOS",
        "editEnabled",
    }
    assert manifest["type"] == "addin"


def test_the_versions_of_addin_and_exporter_agree():
    from tests.plugin_fusion.addin import room

    manifest = json.loads((ROOT / "LinkTwin.manifest").read_text(encoding="utf-8"))
    assert manifest["version"] == room("lib.mechanism").EXPORTER_VERSION


def test_the_addin_speaks_the_schema_of_the_backend():
    from backend.mechanism.read import VERSION
    from tests.plugin_fusion.addin import room

    assert room("lib.mechanism").SCHEMA_VERSION == VERSION


def test_joint_types_are_those_that_the_format_knows():
    from typing import get_args

    from backend.mechanism.joint import JointType
    from tests.plugin_fusion.addin import room

    assert set(room("lib.joints").HELD.values()) <= set(get_args(JointType))


def test_a_mesh_is_a_binary_stl_that_others_read(tmp_path):
    from tests.plugin_fusion.addin import room
    from tests.plugin_fusion.snapshots import box_mesh

    stl = room("lib.stl")
    stl.write(tmp_path / "box.stl", [(box_mesh((0, 0, 0), (1, 2, 3)), 1.0, room("lib.placement").Placement())])
    data = (tmp_path / "box.stl").read_bytes()
    assert struct.unpack("<I", data[80:84]) == (12,)
    assert len(data) == 84 + 12 * 50
    assert not data.startswith(b"solid"), "a binary file that begins so is taken for text"
