"""Mesh files as people have them: concave polygons, encodings, line ends, comments, indices, formats, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from closed_meshes import area_of, ball, box, volume_of

from softlab.model.base import waiting
from softlab.model.base.errors import InputError, SceneError
from softlab.model.core.build import masses
from softlab.model.geometry.formats import source
from softlab.model.geometry.formats.polygons import ears, triangulated
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.mesh import read_mesh, triangle_mesh
from softlab.model.geometry.mesh_files import FORMATS, read_arrays
from softlab.model.geometry.tetrahedra.files import holds_tetrahedra, read_tetrahedra
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh
from softlab.model.scene.scene import Scene

DART = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [0.5, 1, 0.0]])  # area 1.5; a fan from corner 0 has 2.5
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2146\nsize 12345\n"


def write(folder: Path, name: str, content: str | bytes) -> Path:
    file = folder / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def polygon_file(name: str, points: np.ndarray, faces: list[list[int]]) -> str | bytes:
    rows = [" ".join(repr(float(x)) for x in point) for point in points]
    kind = name.rpartition(".")[2]
    if kind == "obj":
        return "\n".join([*(f"v {row}" for row in rows), *("f " + " ".join(str(k + 1) for k in f) for f in faces)])
    listed = [" ".join(map(str, (len(f), *f))) for f in faces]
    if kind == "off":
        return "\n".join(["OFF", f"{len(rows)} {len(faces)} 0", *rows, *listed])
    order = {"text.ply": "ascii", "little.ply": "binary_little_endian", "big.ply": "binary_big_endian"}[name]
    head = f"ply\nformat {order} 1.0\nelement vertex {len(rows)}\nproperty double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if order == "ascii":
        return head + "\n".join([*rows, *listed]) + "\n"
    mark = "<" if "little" in order else ">"
    body = b"".join(struct.pack(f"{mark}B{len(f)}i", len(f), *f) for f in faces)
    return head.encode() + np.asarray(points).astype(mark + "f8").tobytes() + body


POLYGON_FILES = ("a.obj", "a.off", "text.ply", "little.ply", "big.ply")


def area(position: np.ndarray, triangles: np.ndarray) -> float:
    return float(triangle_areas(position, triangles).sum())


# ---------------------------------------------------------------------- polygons


@pytest.mark.parametrize("name", POLYGON_FILES)
@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("backwards", [False, True])
def test_a_concave_polygon_has_its_area(tmp_path: Path, name: str, first: int, backwards: bool) -> None:
    corners = np.roll(np.arange(4), first)[:: -1 if backwards else 1].tolist()
    mesh = read_mesh(write(tmp_path, name, polygon_file(name, DART, [corners])))
    assert area(mesh.position, mesh.triangles) == pytest.approx(1.5, rel=1e-12)
    facing = np.cross(*(mesh.position[mesh.triangles[:, k]] - mesh.position[mesh.triangles[:, 0]] for k in (1, 2)))
    assert (facing[:, 2] < 0).all() if backwards else (facing[:, 2] > 0).all()


@pytest.mark.parametrize("name", POLYGON_FILES)
def test_faces_of_several_sizes(tmp_path: Path, name: str) -> None:
    points = np.concatenate([DART, [[3, 3, 0.0], [2, 3, 0]]])
    mesh = read_mesh(write(tmp_path, name, polygon_file(name, points, [[3, 0, 1, 2], [1, 4, 5], [2, 1, 5]])))
    assert len(mesh.triangles) == 4 and mesh.pieces == 1


def star(points: int, turn: float = 0.0) -> np.ndarray:
    """In a plane that is tilted; its corners lie on two circles in turn."""
    angle = 2 * np.pi * np.arange(2 * points) / (2 * points) + turn
    radius = np.where(np.arange(2 * points) % 2, 1.0, 0.3)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return flat @ np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]) + [5.0, -3.0, 1.0]


@pytest.mark.parametrize("points", [3, 4, 7, 40])
@pytest.mark.parametrize("first", [0, 1, 3])
def test_stars_have_their_area(points: int, first: int) -> None:
    """n triangles about the middle for each of the 2 n sides: 0.3 sin(pi / n) / 2 each."""
    position = star(points)
    triangles, crossing = triangulated(position, np.roll(np.arange(2 * points), first), np.array([2 * points]))
    assert not len(crossing)
    assert area(position, triangles) == pytest.approx(points * 0.3 * np.sin(np.pi / points), rel=1e-12)


@pytest.mark.parametrize("first", range(10))
def test_a_polygon_around_a_hole(first: int) -> None:
    """A square of 4 m with a hole of 2 m, as one polygon that goes to the hole and back along one edge."""
    flat = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
    position = np.pad(np.array(flat, dtype=float), ((0, 0), (0, 1)))
    triangles, crossing = triangulated(position, np.roll(np.arange(10), first), np.array([10]))
    assert not len(crossing) and area(position, triangles) == pytest.approx(12.0, rel=1e-12)
    middles = position[triangles].mean(axis=1)
    assert not ((middles > 1) & (middles < 3))[:, :2].all(axis=1).any()


def test_corners_on_an_edge_get_triangles_with_an_area() -> None:
    """A fan from the corner before them has none there, and a neighbour's vertex would hang free."""
    position = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0.0]])
    for first in range(5):
        triangles, _ = triangulated(position, np.roll(np.arange(5), first), np.array([5]))
        assert triangle_areas(position, triangles).min() > 0.1
        assert area(position, triangles) == pytest.approx(4.0, rel=1e-12)


def test_polygons_that_cross_themselves_are_reported(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\n# bow tie\nf 1 2 3 4\n"
    position, triangles, notes = read_arrays(write(tmp_path, "a.obj", text))
    assert "1 face crosses itself (first face 0, counted from 0; line 6)" in notes[-1]
    assert np.array_equal(triangles, [[0, 1, 2], [0, 2, 3]]) and len(position) == 4
    assert ears(np.array([[0, 0], [1, 1], [1, 0], [0, 1.0]])) is None


def test_bent_and_degenerate_polygons() -> None:
    """A bent quadrilateral is cut as its projection; one whose corners lie on a line has no area and no crossing."""
    bent = DART + np.array([[0, 0, 0.1], [0, 0, -0.1], [0, 0, 0.1], [0, 0, -0.1]])
    triangles, crossing = triangulated(bent, np.arange(4), np.array([4]))
    assert not len(crossing) and {1, 3} <= set(triangles[0]) & set(triangles[1])
    line = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3.0]])
    triangles, crossing = triangulated(line, np.arange(4), np.array([4]))
    assert not len(crossing) and len(triangles) == 2


def test_no_vertex_of_a_large_polygon_gets_all_edges() -> None:
    """The lid of a cylinder: a fan's hub would have more constraints than XPBD colours."""
    angle = 2 * np.pi * np.arange(400) / 400
    lid = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    triangles, _ = triangulated(lid, np.arange(400), np.array([400]))
    assert np.bincount(triangles.ravel()).max() < 30
    assert area(lid, triangles) == pytest.approx(200 * np.sin(2 * np.pi / 400), rel=1e-12)


@pytest.mark.parametrize("first", range(4))
def test_roles_see_the_area(tmp_path: Path, first: int) -> None:
    """Cloth of 1 kg/m^2: 1.5 kg; a prism over the dart: 1.5 m^3; its triangles as a collider."""
    corners = np.roll(np.arange(4), first)
    cloth = write(tmp_path, "dart.obj", polygon_file("a.obj", DART, [corners.tolist()]))
    scene = Scene({"mesh": {"file": str(cloth), "density": 1.0}, "structural": {}, "method": {"solver": "xpbd"}})
    assert float(np.sum(masses(scene))) == pytest.approx(1.5, rel=1e-12)
    points = np.concatenate([DART, DART + np.array([0, 0, 1])])
    sides = [[k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4] for k in range(4)]
    faces = [corners[::-1].tolist(), (corners + 4).tolist(), *sides]
    file = write(tmp_path, "prism.obj", polygon_file("a.obj", points, faces))
    found = read_mesh(file)
    assert volume_of((found.position, found.triangles)) == pytest.approx(1.5, rel=1e-12)
    assert area_of((found.position, found.triangles)) == pytest.approx(
        3 + np.linalg.norm(DART - np.roll(DART, 1, axis=0), axis=1).sum(), rel=1e-12
    )
    tables = {
        "cloth": {"rows": 3, "columns": 3, "spacing": 0.1}, "structural": {"stiffness": 10.0},
        "wall": {"kind": "mesh_collider", "file": str(file)},
    }  # fmt: skip
    (wall,) = (collider for _, collider in Scene(tables).colliders)
    assert area(wall.position, wall.triangles) == pytest.approx(area(found.position, found.triangles), rel=1e-12)


# ---------------------------------------------------------------------- text


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("name", ["a.obj", "a.off", "text.ply", "a.stl", "a.mesh"])
def test_marks_and_line_ends(tmp_path: Path, name: str, end: bytes, mark: bytes) -> None:
    points, faces = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0], [9, 9, 9]]), [[0, 1, 2], [0, 2, 3]]
    if name == "a.stl":
        facets = "".join(
            "facet normal 0 0 1\nouter loop\n"
            + "".join("vertex " + " ".join(map(str, points[k])) + "\n" for k in face)
            + "endloop\nendfacet\n"
            for face in faces
        )
        text = f"solid a\n{facets}endsolid a\n"
    elif name == "a.mesh":
        rows = "".join(" ".join(map(str, point)) + " 0\n" for point in points)
        text = f"MeshVersionFormatted 2\nDimension 3\nVertices\n5\n{rows}Triangles\n2\n1 2 3 0\n1 3 4 0\nEnd\n"
    else:
        text = str(polygon_file(name, points, faces))
    mesh = read_mesh(write(tmp_path, name, mark + text.encode().replace(b"\n", end)))
    assert area(mesh.position, mesh.triangles) == pytest.approx(1.0) and len(mesh.position) == 4


@pytest.mark.parametrize(
    "line", ["f 1 2 3 4 # all of it", "f 1 2 \\\n3 4", "f 1 2 \\ \n  3 \\\n 4", "f 1/1 2/2/2 3//3 4#x"]
)
def test_comments_and_continued_lines(tmp_path: Path, line: str) -> None:
    """A comment that ends in a backslash, as paths of Windows do, does not swallow the next line."""
    text = "# made by C:\\tool\\\n" + SQUARE.replace("v 1 0 0\n", "v 1 0 0 # second\n") + line + "\n"
    mesh = read_mesh(write(tmp_path, "a.obj", text))
    assert len(mesh.position) == 4 and area(mesh.position, mesh.triangles) == pytest.approx(1.0)


def test_negative_indices_count_from_the_face(tmp_path: Path) -> None:
    """Back from the last vertex read before the face, also with vertices between faces."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 1 1 0\nf -3 -1 -2\nf 1 2 \\\n-1\n"
    _, triangles, _ = read_arrays(write(tmp_path, "a.obj", text))
    assert triangles.tolist() == [[0, 1, 2], [1, 3, 2], [0, 1, 3]]
    with pytest.raises(InputError, match=r"names vertex -4, counted from the end, and 3 of 4 vertices stand.*line 4"):
        read_mesh(write(tmp_path, "b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -2 -1\nv 1 1 0\n"))


WIDE = {"UTF-16": ("utf-16", "utf-16-le", "utf-16-be"), "UTF-32": ("utf-32", "utf-32-le", "utf-32-be")}


@pytest.mark.parametrize("suffix", [*FORMATS, ".vtk", ".node"])
@pytest.mark.parametrize("content", ["pointer", *(code for codes in WIDE.values() for code in codes)])
def test_pointers_and_wide_encodings_are_named(tmp_path: Path, suffix: str, content: str) -> None:
    file = write(tmp_path, "a" + suffix, POINTER if content == "pointer" else (SQUARE + "f 1 2 3\n").encode(content))
    words = "is a Git LFS pointer, not the mesh: fetch it with `git lfs pull`"
    if content != "pointer":
        words = f"is text in {content[:6].upper()}; save it as UTF-8"
    for read in [read_mesh] * (suffix in FORMATS) + [read_tetrahedra] * (suffix not in FORMATS or suffix == ".msh"):
        with pytest.raises(InputError) as caught:
            read(file)
        assert str(caught.value) == f"{file} {words}"


def test_an_archive_that_is_a_pointer(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a Git LFS pointer"):
        read_tetrahedra(write(tmp_path, "a.npz", POINTER))


ROLES = {
    "cloth": {"mesh": {}, "structural": {}, "method": {"solver": "xpbd"}},
    "soft_body": {"one": {"kind": "soft_body", "particle_spacing": 0.1}, "method": {"solver": "shape-matching"}},
    "tetrahedra": {"one": {"kind": "tetrahedral_body", "voxels": 2}, "method": {"solver": "xpbd"}},
    "collider": {"one": {"kind": "mesh_collider"}},
    "field": {"one": {"kind": "distance_field"}},
}


@pytest.mark.parametrize("role", ROLES)
def test_every_role_names_a_pointer(tmp_path: Path, role: str) -> None:
    tables = {name: dict(table) for name, table in ROLES[role].items()}
    tables["mesh" if role == "cloth" else "one"]["file"] = str(write(tmp_path, "a.obj", POINTER))
    if role in ("collider", "field"):
        tables |= {"cloth": {"rows": 3, "columns": 3, "spacing": 0.1}, "structural": {"stiffness": 10.0}}
    with pytest.raises(InputError, match="is a Git LFS pointer, not the mesh"):
        scene = Scene(tables)
        for _, collider in scene.colliders:
            collider.numbers(np.float64)
        if role == "soft_body":
            scene.parts["one"].baked  # noqa: B018
        if role == "tetrahedra":
            scene.tetrahedra_set  # noqa: B018


# ---------------------------------------------------------------------- what is refused


REFUSED = {
    "empty.obj": ("", "is empty: it holds no triangle; export"),
    "blank.off": (" \n \n", "is empty: it holds no triangle; export"),
    "one.obj": ("v 1 2 3\n", "1 point, but no triangle; a mesh needs faces: export it with them"),
    "word.obj": (SQUARE + "v 1 x 2\nf 1 2 3\n", r"'x' is not a number \(line 5\)"),
    "comma.obj": (SQUARE + "v 1,5 0 2\nf 1 2 3\n", r"'1,5' is not a number; write decimals with a point \(line 5\)"),
    "real.obj": (SQUARE + "f 1 2 3.5\n", r"'3.5' is not a whole number \(line 5\)"),
    "short.obj": ("v 0 0 0\n\nv 1 0\nf 1 2 3\n", "fewer than three coordinates: 1, the first in line 3"),
    "two.obj": (SQUARE + "f 1 2 3\nf 1 2\n", "fewer than three corners: 1, the first in line 6"),
    "nan.obj": (SQUARE + "v 0 nan 0\nf 1 2 3\n", r"first vertex 4 \(counted from 0; line 5\)"),
    "beyond.obj": (SQUARE + "f 1 2 3\nf 1 2 8\n", r"names vertex 8, counted from 1, and there are 4 \(line 6\)"),
    "huge.obj": (
        SQUARE + "v 1e12 0 0\nf 1 2 5\n",
        r"a coordinate of 1e\+12 m \(line 5\); at most 1e\+09: move the origin nearer to 0, or give a scale",
    ),
    "word.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 y 0\n3 0 1 2\n", r"'y' is not a number \(line 5\)"),
    "beyond.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", r"names vertex 3.*\(line 6\)"),
    "cut.off": ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "3 vertices and 2 faces promised, 4 lines found"),
    "lines.off": ("OFF\n2 1 0\n0 0 0\n1 0 0\n2 0 1\n", "line 5 is no face of three corners or more"),
    "other.mesh": ("[MeshSerializer_v1.41]", "no Medit file"),
    "part.step": ("ISO-10303-21;", "gmsh part.step -2 -o part.stl"),
    "scene.fbx": ("Kaydara", "open it in Blender"),
    "bad.glb": ("glTF", "no glTF 2.0 file, or damaged"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_the_file_the_line_and_the_remedy(tmp_path: Path, name: str) -> None:
    content, words = REFUSED[name]
    file = write(tmp_path, name, content)
    with pytest.raises(InputError, match=words) as caught:
        read_mesh(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    "position,triangles,words",
    [
        (np.zeros((4, 2)), [[0, 1, 2]], r"position has the shape \(4, 2\); must be \(n, 3\)"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]] * 3, r"triangles has the shape \(3, 4\); must be \(n, 3\)"),
        (np.eye(3), [[0, 1, 3]], r"triangle 0 \(counted from 0\) names the vertices \[0, 1, 3\], and there are 3"),
        (np.eye(3), [[0, 1, -1]], "names the vertices"),
        (np.zeros((0, 3)), [], "none of its 0 triangles has an area"),
        (np.zeros((1, 3)), [[0, 0, 0]], "none of its 1 triangles has an area"),
    ],
)
def test_arrays_that_are_no_mesh(position: np.ndarray, triangles: list[list[int]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        triangle_mesh(position, np.array(triangles))


def test_a_level_cloth_has_no_top(tmp_path: Path) -> None:
    """Every vertex is as high as the highest."""
    level = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3 4\n"
    mesh = {"file": str(write(tmp_path, "level.obj", level)), "pinned": "top"}
    tables = {"mesh": mesh, "structural": {}, "method": {"solver": "xpbd"}}
    with pytest.raises(SceneError, match=r"the mesh is level .* all 4 vertices would be pinned; give a list") as caught:
        Scene(tables)
    assert caught.value.field == "mesh.pinned"
    mesh["file"] = str(write(tmp_path, "upright.obj", SQUARE + "f 1 2 3 4\n"))
    assert Scene(tables).grid.pinned == "top"


# ---------------------------------------------------------------------- formats


BODY = voxel_mesh(box((0.3, 0.2, 0.1)), edge=0.1).mesh


def gmsh(version: str, order: str, position: np.ndarray, kind: int, corners: np.ndarray) -> bytes:
    """A binary file in that byte order; nodes are numbered from 1, elements from 1."""
    count, each = len(position), corners.shape[1]
    head = f"$MeshFormat\n{version} 1 8\n".encode() + struct.pack(order + "i", 1) + b"\n$EndMeshFormat\n"
    if version == "2.2":
        nodes = f"$Nodes\n{count}\n".encode()
        nodes += b"".join(struct.pack(order + "i3d", k + 1, *point) for k, point in enumerate(position))
        cells = f"$Elements\n{len(corners)}\n".encode() + struct.pack(order + "3i", kind, len(corners), 2)
        cells += b"".join(struct.pack(order + f"{3 + each}i", k + 1, 0, 1, *row + 1) for k, row in enumerate(corners))
    else:
        nodes = b"$Nodes\n" + struct.pack(order + "4Q3iQ", 1, count, 1, count, 3, 1, 0, count)
        nodes += np.arange(1, count + 1).astype(order + "u8").tobytes() + position.astype(order + "f8").tobytes()
        cells = b"$Elements\n" + struct.pack(
            order + "4Q3iQ", 1, len(corners), 1, len(corners), 3, 1, kind, len(corners)
        )
        rows = np.concatenate([np.arange(len(corners))[:, None] + 1, corners + 1], axis=1)
        cells += rows.astype(order + "u8").tobytes()
    return head + nodes + b"\n$EndNodes\n" + cells + b"\n$EndElements\n"


@pytest.mark.parametrize("version", ["2.2", "4.1"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_gmsh(tmp_path: Path, version: str, order: str) -> None:
    """Tetrahedra as they are, their surface as a surface, and triangles."""
    data = gmsh(version, order, BODY.position, 4, BODY.tetrahedra)
    file = write(tmp_path, "a.msh", data)
    found, told = read_tetrahedra(file)
    assert np.array_equal(found.position, BODY.position) and np.array_equal(found.tetrahedra, BODY.tetrahedra)
    assert not told and holds_tetrahedra(file)
    surface = read_mesh(file)
    assert surface.repairs[0] == f"the surface of its 30 tetrahedra was taken: {len(BODY.surface)} triangles"
    assert volume_of((surface.position, surface.triangles)) == pytest.approx(0.006)
    shell = write(tmp_path, "b.msh", gmsh(version, order, ball()[0], 2, ball()[1]))
    assert not holds_tetrahedra(shell)
    assert np.array_equal(read_mesh(shell).triangles, ball()[1])
    for cut in (60, len(data) // 2, len(data) - 40):
        with pytest.raises(InputError, match=r"cut short|not, or is damaged"):
            read_tetrahedra(write(tmp_path, "c.msh", data[:cut]))


def medit(position: np.ndarray, **elements: np.ndarray) -> str:
    text = f"MeshVersionFormatted 2\n\nDimension\n3\n# points\nVertices\n{len(position)}\n"
    text += "".join(" ".join(repr(float(x)) for x in point) + " 1\n" for point in position)
    for name, corners in elements.items():
        text += f"{name}\n{len(corners)}\n" + "".join(" ".join(map(str, row + 1)) + " 7\n" for row in corners)
    return text + "End\n"


def test_medit(tmp_path: Path) -> None:
    file = write(tmp_path, "a.mesh", medit(BODY.position, Triangles=BODY.surface, Tetrahedra=BODY.tetrahedra))
    found, _ = read_tetrahedra(file)
    assert np.array_equal(found.position, BODY.position) and np.array_equal(found.tetrahedra, BODY.tetrahedra)
    assert len(read_mesh(file).triangles) == len(BODY.surface)
    quads = write(tmp_path, "b.mesh", medit(DART, Quadrilaterals=np.array([[0, 1, 2, 3]])))
    assert area(*read_arrays(quads)[:2]) == pytest.approx(1.5) and not holds_tetrahedra(quads)


def test_gltf_nodes_stand_where_they_are(tmp_path: Path) -> None:
    """Two nodes of one mesh, one of them a mirror image three metres away and twice as large."""
    import trimesh

    mesh = trimesh.Trimesh(*ball(), process=False)
    scene = trimesh.Scene([mesh])
    matrix = np.diag([-2.0, 2.0, 2.0, 1.0])
    matrix[0, 3] = 3.0
    scene.add_geometry(mesh, transform=matrix)
    file = write(tmp_path, "a.glb", scene.export(file_type="glb"))
    found = read_mesh(file)
    assert found.pieces == 2 and found.boundary_loops == 0
    np.testing.assert_allclose([found.position.min(axis=0)[0], found.position.max(axis=0)[0]], [-0.5, 4.0], atol=1e-6)
    assert volume_of((found.position, found.triangles)) == pytest.approx(9 * volume_of(ball()), rel=1e-5)
    assert "2 meshes of the file were joined" in found.repairs
    for name, content in scene.export(file_type="gltf").items():
        write(tmp_path, name, content)
    assert len(read_mesh(tmp_path / "model.gltf").triangles) == 2 * len(ball()[1])
    (tmp_path / "gltf_buffer_0.bin").unlink()
    with pytest.raises(InputError, match=r"its buffer gltf_buffer_0.bin is not beside it"):
        read_mesh(tmp_path / "model.gltf")


@pytest.mark.parametrize(
    "head", ["OFF\n4 1 0\n", "OFF4 1 0\n", "# a\nOFF # b\n# c\n4 1 0 # d\n", "COFF 4 1 0\n", "4OFF\n4 1 0\n"]
)
def test_off_heads(tmp_path: Path, head: str) -> None:
    rows = "".join(" ".join(map(str, point)) + " 255 0 0 255\n" for point in DART)
    file = write(tmp_path, "a.off", head + rows + "4 0 1 2 3  0.5 0.5 0.5\n")
    if head.startswith("4"):
        with pytest.raises(InputError, match="does not begin with OFF"):
            read_mesh(file)
        return
    assert area(*read_arrays(file)[:2]) == pytest.approx(1.5)


def test_strips_of_ply(tmp_path: Path) -> None:
    """As in scans of the Stanford repository: strips that -1 separates, every second triangle the other way round."""
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    text = head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n8 0 1 2 3 -1 2 3 4\n"
    _, triangles, _ = read_arrays(write(tmp_path, "a.ply", text))
    assert triangles.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4]]


# ---------------------------------------------------------------------- long texts


@pytest.mark.parametrize("name", ["a.obj", "a.stl", "a.ply", "a.off"])
@pytest.mark.parametrize("mixed", [False, True])
def test_long_texts_are_read_in_blocks_that_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, mixed: bool
) -> None:
    """Of one line each: the same bits as at once; also where faces have three corners and four, and lines more numbers."""
    position = np.array([[0.1, 0, 0], [1 / 3, 0, 1e-7], [1, 1.7, 0], [0, 1, 0.1], [2.5, 2, 0]])
    faces = [[0, 1, 2, 3], [3, 2, 4]] if mixed and name != "a.stl" else [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    rows = [" ".join(map(repr, point)) for point in position.tolist()]
    lists = [" ".join(map(str, [len(face), *face])) + (" 7 7" if mixed else "") for face in faces]
    text = {
        "a.obj": "".join(f"v {row}\n" for row in rows)
        + "".join("f " + " ".join(f"{k + 1}/1" for k in face) + "\n" for face in faces),
        "a.stl": "solid a\n"
        + "".join(
            "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {rows[k]}\n" for k in face) + "endloop\nendfacet\n"
            for face in faces
        )
        + "endsolid a\n",
        "a.ply": "ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n" + "\n".join([*rows, *lists]),
        "a.off": f"OFF 5 {len(faces)} 0\n" + "\n".join([*rows, *lists]),
    }[name]
    file = write(tmp_path, name, text)
    whole = read_arrays(file)
    seen: list[str] = []
    monkeypatch.setattr(source, "LINES", 1)
    monkeypatch.setattr(waiting, "INTERVAL", -1.0)
    with waiting.waiting_watched(lambda label, _: seen.append(label)):
        again = read_arrays(file)
    assert set(seen) == {f"reading {name}", "reading the mesh"}
    assert np.array_equal(whole.position, again.position) and np.array_equal(whole.triangles, again.triangles)
    corners = whole.position[whole.triangles]
    assert len(corners) == 3 and set(map(tuple, corners.reshape(-1, 3))) == set(map(tuple, position))
