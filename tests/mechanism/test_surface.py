"""A surface is the same whichever kind of file it came in; what is none is refused in a sentence."""

import json
import struct

import numpy as np
import pytest
import trimesh

from backend.mechanism import surface
from backend.mechanism.surface import facets, write_stl

SIZE = np.array([80.0, 20.0, 6.0])  # mm; the number of its kind decides nothing


def volume(corners):
    """Of what the facets enclose; negative where they are seen from inside."""
    a, b, c = corners.transpose(1, 0, 2)
    return np.sum(a * np.cross(b, c)) / 6


def placed(turn):
    """A bar whose own axes were turned before it was written."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(SIZE), transform=turn)
    return scene


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb"])
def test_a_bar_has_its_numbers_whichever_kind_it_came_in(tmp_path, kind):
    bar = trimesh.creation.box(SIZE)
    bar.apply_translation([40.0, 0.0, 3.0])
    bar.export(tmp_path / f"bar.{kind}")
    found = facets(tmp_path / f"bar.{kind}")
    assert found.shape == (12, 3, 3)
    np.testing.assert_allclose(found.min((0, 1)), [0.0, -10.0, 0.0], atol=1e-5)  # float32
    np.testing.assert_allclose(found.max((0, 1)), [80.0, 10.0, 6.0], atol=1e-5)
    assert volume(found) == pytest.approx(np.prod(SIZE), rel=1e-6)
    write_stl(tmp_path / "again.stl", found)
    np.testing.assert_allclose(facets(tmp_path / "again.stl"), found, atol=1e-5)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_nodes_of_a_glb_are_placed_and_mirrors_keep_the_outside_out(tmp_path, mirrored):
    turn = np.diag([1.0, 1.0, -1.0 if mirrored else 1.0, 1.0])
    turn[:3, 3] = [0.0, 0.0, 100.0]
    placed(turn).export(tmp_path / "bar.glb")
    found = facets(tmp_path / "bar.glb")
    np.testing.assert_allclose(found.mean((0, 1)), [0.0, 0.0, 100.0], atol=1e-5)
    assert volume(found - [0.0, 0.0, 100.0]) == pytest.approx(np.prod(SIZE), rel=1e-6)


def test_what_lies_beside_a_mesh_is_not_opened(tmp_path):
    (tmp_path / "bar.mtl").write_text("newmtl steel\n")
    (tmp_path / "bar.obj").write_text("mtllib bar.mtl\nusemtl steel\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    (tmp_path / "bar.mtl").chmod(0)
    assert len(facets(tmp_path / "bar.obj")) == 2  # a quad


def glb(document, binary=b""):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def packed(count, extra=None):
    """A GLB whose corners are claimed and not there to be read, as a compressed one's are."""
    accessors = [
        {"componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
        {"componentType": 5125, "count": count, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, **(extra or {})}
    return glb(
        {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [primitive]}], "accessors": accessors,
            "buffers": [{"byteLength": 8}], "bufferViews": [{"buffer": 0, "byteLength": 8}],
        },
        b"\1" * 8,
    )  # fmt: skip


DRACO = {"extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}}


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("bar.glb", b"glTF\2\0\0\0\x10\0\0\0half", "cannot be read as GLB"),
        ("bar.glb", packed(6), "without compression"),
        ("bar.glb", packed(6, DRACO), "without compression"),
        ("bar.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n", "cannot be read as PLY"),
        (
            "dots.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n0 0 0\n",
            "holds no facets",
        ),
        ("bar.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "nowhere"),
        ("bar.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "cannot be read as OBJ"),
        ("bar.obj", b"", "holds no facets|cannot be read"),
        ("bar.step", b"ISO-10303-21;", "none of .stl, .obj, .ply, .glb"),
    ],
)
def test_what_cannot_be_shown_is_said_with_what_to_do(tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=says) as found:
        facets(path)
    assert str(found.value).startswith(str(path))


def test_a_mesh_that_no_browser_draws_in_time_is_refused_before_it_is_placed(tmp_path, monkeypatch):
    monkeypatch.setattr(surface, "MOST_FACETS", 20)
    scene = placed(np.eye(4))
    scene.add_geometry(next(iter(scene.geometry.values())), transform=np.diag([2.0, 2.0, 2.0, 1.0]))
    scene.export(tmp_path / "two.glb")
    with pytest.raises(ValueError, match="24 facets, above the limit of 20; export it coarser"):
        facets(tmp_path / "two.glb")
