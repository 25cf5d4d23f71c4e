"""Meshes of files: what is mended and said, what is refused, and that nothing else comes out of any file."""

import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from meshes import octahedron, sheet

from softlab.model.base.errors import InputError, SceneError, SoftlabError
from softlab.model.geometry.mesh import TriangleMesh, read_mesh

NAN, INF = float("nan"), float("inf")


def obj(position, faces) -> str:
    lines = ["v " + " ".join(repr(float(x)) for x in point) for point in position]
    return "\n".join([*lines, *("f " + " ".join(str(k + 1) for k in face) for face in faces)]) + "\n"


def binary_stl(position, triangles) -> bytes:
    corners = np.asarray(position)[np.asarray(triangles)]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in corners)
    return bytes(80) + struct.pack("<I", len(corners)) + body


def text_stl(position, triangles) -> str:
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex " + " ".join(repr(float(x)) for x in position[k]) + "\n" for k in triangle)
        + "endloop\nendfacet\n"
        for triangle in triangles
    ]
    return "solid sheet\n" + "".join(facets) + "endsolid sheet\n"


def text_ply(position, faces) -> str:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(position)}\nproperty double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join(" ".join(repr(float(x)) for x in point) + "\n" for point in position)
    return head + points + "".join(" ".join(map(str, (len(face), *face))) + "\n" for face in faces)


def binary_ply(position, triangles) -> bytes:
    head = text_ply(position, triangles).split("end_header\n")[0].replace("ascii", "binary_little_endian")
    body = np.asarray(position, dtype="<f8").tobytes()
    return (head + "end_header\n").encode() + body + b"".join(struct.pack("<B3i", 3, *t) for t in triangles)


FORMS = {"a.obj": obj, "binary.stl": binary_stl, "text.STL": text_stl, "text.ply": text_ply, "binary.ply": binary_ply}


def write(folder: Path, name: str, content: str | bytes) -> Path:
    file = folder / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def refused(action) -> str:
    with pytest.raises(InputError) as caught:
        action()
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 400
    return text


def check_sound(mesh: TriangleMesh) -> None:
    """What every mesh keeps: an area each, no copies, edges of two triangles at most that pass them in turn, all used."""
    position, triangles = mesh.position, mesh.triangles
    assert position.dtype == np.float64
    assert triangles.dtype == np.int32
    assert np.isfinite(position).all()
    a, b, c = (position[corner] for corner in triangles.T)
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0).all()
    assert len({frozenset(triangle) for triangle in triangles.tolist()}) == len(triangles)
    passed = Counter((t[k], t[(k + 1) % 3]) for t in triangles.tolist() for k in range(3))
    assert set(passed.values()) == {1}
    assert np.array_equal(np.unique(triangles), np.arange(len(position)))
    apart = any("kept apart" in line for line in mesh.repairs)
    assert len(np.unique(position, axis=0)) == len(position) or apart
    assert np.array_equal(mesh.edges.corners, triangles)
    assert not mesh.edges.alike.any()


# ---------------------------------------------------------------------- files


@pytest.mark.parametrize("name", FORMS)
def test_every_format_gives_the_same_sheet(tmp_path, name):
    """Coordinates that float32 holds exactly, so that STL gives them back; its vertices are merged, and that is said."""
    position, triangles = sheet(4, 5, 0.25)
    mesh = read_mesh(write(tmp_path, name, FORMS[name](position, triangles)), scale=2.0)
    check_sound(mesh)
    order = np.lexsort(mesh.position.T)
    assert np.array_equal(mesh.position[order], 2 * position[np.lexsort(position.T)])
    assert {frozenset(map(tuple, t.tolist())) for t in mesh.position[mesh.triangles]} == {
        frozenset(map(tuple, t.tolist())) for t in 2 * position[triangles]
    }
    assert (mesh.pieces, mesh.boundary_loops) == (1, 1)
    stl = name.lower().endswith("stl")
    merged = 3 * len(triangles) - len(position)
    assert mesh.repairs == ((f"{merged} vertices at the place of another were merged",) if stl else ())
    if not stl:
        assert np.array_equal(mesh.triangles, triangles)
        assert mesh.numbering.tolist() == list(range(20))
    assert mesh.lines()[0] == (
        "20 vertices, 43 edges, 24 triangles (Euler characteristic 1), 1 piece, 1 rim, 2 x 1.5 x 0 m"
    )


def test_an_obj_as_programs_write_it(tmp_path):
    """Materials, texture coordinates, normals, groups, colours, comments, tabs, indices from the end: the vertices stay."""
    text = (
        "# made\nmtllib none.mtl\no sheet\n\tv 0 0 0 1 0 0\nv\t1 0 0 1 0 0\nv 1 1 0 0 0 1\nv 0 1 0 0 1 0\nv 0 2 0 0 1 0\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\ng one\nusemtl red\nf 1/1/1 2/2/1 3/3/1\ng two\nusemtl blue\nf 1//1 3//1 \\\n4//1\n"
        "l 1 2\nf -3 -1 -2\n"
    )
    mesh = read_mesh(write(tmp_path, "a.obj", text))
    assert mesh.position.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 2, 0]]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [2, 4, 3]]
    assert mesh.repairs == ()


@pytest.mark.parametrize("name", ["a.obj", "text.ply"])
@pytest.mark.parametrize("faces", [[(0, 1, 2, 3)], [(0, 1, 2, 3), (3, 2, 4)], [(0, 1, 2, 4, 3)]])
def test_polygons_are_split_and_that_is_said(tmp_path, name, faces):
    position = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]]
    mesh = read_mesh(write(tmp_path, name, FORMS[name](position, faces)))
    triangles = sum(len(face) - 2 for face in faces)
    assert len(mesh.triangles) == triangles
    assert mesh.repairs[0] == (
        f"faces of more than three corners were split: {len(faces)} face{'s' * (len(faces) > 1)}, {triangles} triangles"
    )
    area = (
        np.linalg.norm(np.cross(*(np.diff(mesh.position[mesh.triangles], axis=1).transpose(1, 0, 2))), axis=1).sum() / 2
    )
    assert area == pytest.approx(1.5 if max(max(face) for face in faces) == 4 else 1.0, rel=1e-12)


TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
BAD_FILES = {
    "empty.obj": ("", "no triangle"),
    "empty.stl": ("", "no triangle"),
    "empty.ply": ("", "no triangle"),
    "points.obj": (obj(TRIANGLE, []), "3 points, but no triangle"),
    "points.ply": (text_ply(TRIANGLE, []), "3 points, but no triangle"),
    "zero.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "vertex 0, and OBJ counts from 1"),
    "beyond.obj": (obj(TRIANGLE, [(0, 1, 2), (0, 1, 7)]), "names vertex 8, counted from 1, and there are 3"),
    "before.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -9\n", "names vertex -9, counted from the end"),
    "beyond.ply": (text_ply(TRIANGLE, [(0, 1, 2), (0, 1, 7)]), "names vertex 7"),
    "below.ply": (text_ply(TRIANGLE, [(0, 1, -1)]), "names vertex -1"),
    "words.obj": ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "cannot be read as OBJ"),
    "short.obj": ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "vertices of fewer than three coordinates: 1"),
    "line.obj": (obj(TRIANGLE, [(0, 1, 2), (0, 1)]), "faces"),
    "cut.stl": (
        binary_stl(TRIANGLE, [(0, 1, 2)] * 3)[:-20],
        "3 triangles promised, which take 234 bytes, but there are 214",
    ),
    "cut_text.stl": (text_stl(TRIANGLE, [(0, 1, 2)] * 3)[:-120], "no `endsolid` follows its 2 triangles"),
    "cut_second.stl": (
        text_stl(TRIANGLE, [(0, 1, 2)]) + text_stl(TRIANGLE, [(0, 2, 1)])[:-20],
        "2 triangles begin, 1 are whole",
    ),
    "cut.ply": (binary_ply(TRIANGLE, [(0, 1, 2)] * 3)[:-20], "cannot be read as PLY"),
    "cut_text.ply": (text_ply(TRIANGLE, [(0, 1, 2), (2, 1, 0)])[:-8], "2 faces, of which 1 can be read"),
    "words.stl": ("solid x\n this is no mesh\nendsolid x\n", "no triangle"),
    "words.ply": ("ply\nno header", "cannot be read as PLY"),
    "noise.stl": (bytes(range(256)) * 3, "triangles promised"),
    "mesh.dae": ("<xml/>", "ends in .obj, .stl or .ply"),
    "nan.obj": (
        obj([*TRIANGLE, [0, NAN, 0]], [(0, 1, 2), (0, 1, 3)]),
        "1 vertex without finite coordinates, first vertex 3 .*\\[0.0, nan, 0.0\\]",
    ),
    "inf.ply": (text_ply([*TRIANGLE, [0, INF, 0]], [(0, 1, 2), (0, 1, 3)]), "first vertex 3 .*\\[0.0, inf, 0.0\\]"),
    "line_only.obj": (obj([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [(0, 1, 2)]), "none of its 1 triangles has an area"),
    "far.obj": (obj([[0, 0, 0], [1e10, 0, 0], [0, 1, 0]], [(0, 1, 2)]), "give a scale"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files(tmp_path, name):
    content, words = BAD_FILES[name]
    file = write(tmp_path, name, content)
    text = refused(lambda: read_mesh(file))
    assert str(file) in text
    with pytest.raises(InputError, match=words):
        read_mesh(file)


def test_files_that_are_none(tmp_path):
    (tmp_path / "folder.obj").mkdir()
    assert "no such file" in refused(lambda: read_mesh(tmp_path / "none.obj"))
    assert "directory" in refused(lambda: read_mesh(tmp_path / "folder.obj"))
    assert "cannot be read" in refused(lambda: read_mesh("a\0b.obj"))


def test_larger_than_memory(tmp_path, monkeypatch):
    file = write(tmp_path, "a.obj", obj(TRIANGLE, [(0, 1, 2)]))
    monkeypatch.setattr("softlab.model.geometry.formats.source.available_bytes", lambda: 1000)
    assert "1000 B is free; decimate" in refused(lambda: read_mesh(file))


@pytest.mark.parametrize("scale", [0, -1.0, NAN, INF])
def test_bad_scale(tmp_path, scale):
    file = write(tmp_path, "a.obj", obj(TRIANGLE, [(0, 1, 2)]))
    with pytest.raises(SceneError, match="scale"):
        read_mesh(file, scale)
    assert "give a scale" in refused(lambda: read_mesh(file, 1e300))


def test_a_hundred_and_sixty_thousand_vertices(tmp_path):
    """Read, a third of its triangles turned back, all lists made: V - E + F = 1, with no loop over triangles in the way."""
    side = 400
    position, triangles = sheet(side, side, 0.01)
    turn = np.arange(len(triangles)) % 3 == 0
    triangles[turn] = triangles[turn][:, ::-1]
    faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {side**2}\n"
    head += "property double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    mesh = read_mesh(write(tmp_path, "large.ply", head.encode() + position.astype("<f8").tobytes() + faces.tobytes()))
    assert len(mesh.position) == side**2
    assert len(mesh.edges.edges) == 2 * side * (side - 1) + (side - 1) ** 2
    assert not mesh.edges.alike.any()
    assert (mesh.pieces, mesh.boundary_loops) == (1, 1)
    assert mesh.repairs == (f"{turn.sum()} triangles were turned over to agree with their neighbours",)
    assert mesh.edges.neighbours.lengths.sum() == 2 * len(mesh.edges.edges)


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(list(FORMS)), st.randoms(use_true_random=False), st.integers(1, 6))
def test_any_damaged_file(tmp_path, name, random, wounds):
    """Bytes changed, cut out or doubled in a good file of each format: a sound mesh or one clear line."""
    position, triangles = octahedron()
    content = FORMS[name](position, triangles)
    data = bytearray(content.encode() if isinstance(content, str) else content)
    for _ in range(wounds):
        start = random.randrange(len(data))
        end = min(len(data), start + random.choice([1, 1, 2, 8, 50]))
        piece = random.choice(
            [b"", b"0", b"-", b"nan", b"\n", b"\0", b"\xff\xff", b"9999999999", bytes(data[start:end]) * 2]
        )
        data[start:end] = piece
        if not data:
            break
    try:
        check_sound(read_mesh(write(tmp_path, name, bytes(data))))
    except SoftlabError as error:
        assert "\n" not in str(error)


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([".obj", ".stl", ".ply"]), st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
def test_any_bytes(tmp_path, suffix, data):
    refused(lambda: read_mesh(write(tmp_path, "any" + suffix, data)))
