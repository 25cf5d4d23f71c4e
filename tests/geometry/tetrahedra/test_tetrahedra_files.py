"""Files of tetrahedra: every format gives the same mesh; whatever is damaged is refused in a line."""

import random

import numpy as np
import pytest
from closed_meshes import box

from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.tetrahedra.files import read_tetrahedra, write_arrays
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh

MESH = voxel_mesh(box((0.3, 0.2, 0.1)), edge=0.1).mesh
COUNT, CELLS = len(MESH.position), len(MESH.tetrahedra)
X = str(MESH.position[0, 0])


def rows(*columns):
    return "\n".join(" ".join(str(x) for x in row) for row in zip(*columns, strict=True)) + "\n"


def xyz():
    return MESH.position.T.tolist()


def corners(base):
    return (MESH.tetrahedra + base).T.tolist()


def msh2(mesh_corners=None):
    tetra = rows(range(7, CELLS + 7), [4] * CELLS, [2] * CELLS, [0] * CELLS, [1] * CELLS, *(mesh_corners or corners(1)))
    surface = "1 15 2 0 1 1\n2 2 2 0 1 1 2 3\n"  # a point, a triangle
    nodes = rows(range(1, COUNT + 1), *xyz())
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{COUNT}\n{nodes}$EndNodes\n"
    return f"{head}$Elements\n{CELLS + 2}\n{surface}{tetra}$EndElements\n"


def msh4():
    half = COUNT // 2
    places = [rows(*(column[some] for column in xyz())) for some in (slice(half), slice(half, None))]
    names = rows(range(11, half + 11)), rows(range(half + 11, COUNT + 11))
    nodes = f"2 {COUNT} 11 {COUNT + 10}\n2 1 0 {half}\n{names[0]}{places[0]}3 1 0 {COUNT - half}\n{names[1]}{places[1]}"
    tetra = rows(range(CELLS), *corners(11))
    elements = f"2 {CELLS + 1} 1 {CELLS + 1}\n2 1 2 1\n9 11 12 13\n3 1 4 {CELLS}\n{tetra}"
    head = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 0\n$EndEntities\n"
    return f"{head}$Nodes\n{nodes}$EndNodes\n$Elements\n{elements}$EndElements\n"


def vtk(modern=False):
    head = f"# vtk DataFile Version {'5.1' if modern else '3.0'}\na title\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    points = f"POINTS {COUNT} double\n{rows(*xyz())}"
    kinds = f"CELL_TYPES {CELLS + 1}\n5\n{rows([10] * CELLS)}"
    if modern:
        offsets = rows([0, *range(3, 4 * CELLS + 4, 4)])
        nodes = f"CONNECTIVITY vtktypeint64\n0 1 2\n{rows(*corners(0))}"
        cells = f"CELLS {CELLS + 2} {4 * CELLS + 3}\nOFFSETS vtktypeint64\n{offsets}{nodes}"
    else:
        cells = f"CELLS {CELLS + 1} {5 * CELLS + 4}\n3 0 1 2\n{rows([4] * CELLS, *corners(0))}"
    return head + points + cells + kinds


def node(base):
    points = rows(range(base, COUNT + base), *xyz(), [0.5] * COUNT, [1] * COUNT)
    return f"# a comment\n{COUNT} 3 1 1\n{points}# made by hand\n"


def ele(base):
    return f"{CELLS} 4 1\n{rows(range(base, CELLS + base), *corners(base), [2.5] * CELLS)}"


def write(folder, name):
    """The file of that kind of MESH."""
    kind, base = name.split(".")[1], int("one" in name)
    if kind == "npz":
        write_arrays(folder / name, {"position": MESH.position, "tetrahedra": MESH.tetrahedra})
    elif kind in ("node", "ele"):
        for suffix, text in ((".node", node(base)), (".ele", ele(base))):
            (folder / name).with_suffix(suffix).write_text(text)
    else:
        text = {"two.msh": msh2, "four.msh": msh4, "old.vtk": vtk, "new.vtk": lambda: vtk(True)}[name]()
        (folder / name).write_text(text)
    return folder / name


NAMES = ("two.msh", "four.msh", "old.vtk", "new.vtk", "zero.node", "one.ele", "one.node", "body.npz")


@pytest.mark.parametrize("name", NAMES)
def test_every_format_gives_the_same_mesh(tmp_path, name):
    mesh, told = read_tetrahedra(write(tmp_path, name))
    assert (
        np.array_equal(mesh.tetrahedra, MESH.tetrahedra) and np.array_equal(mesh.position, MESH.position) and not told
    )
    assert np.array_equal(read_tetrahedra(tmp_path / name, 1000.0)[0].position, MESH.position * 1000)


def test_vertices_of_no_tetrahedron_are_left_out_and_told(tmp_path):
    position = np.concatenate([[[9.0, 9, 9]], MESH.position])
    write_arrays(tmp_path / "a.npz", {"position": position, "tetrahedra": MESH.tetrahedra + 1})
    mesh, told = read_tetrahedra(tmp_path / "a.npz")
    assert told == ("1 vertex of no tetrahedron left out",) and np.array_equal(mesh.position, MESH.position)


def test_inverted_ones_are_refused_by_number(tmp_path):
    wrong = MESH.tetrahedra.copy()
    wrong[3] = wrong[3, [1, 0, 2, 3]]
    (tmp_path / "a.msh").write_text(msh2((wrong + 1).T.tolist()))
    with pytest.raises(
        InputError, match=r"a.msh: 1 of 30 tetrahedra .* first tetrahedron 3 .*inside out.*swap two corners"
    ):
        read_tetrahedra(tmp_path / "a.msh")


def test_what_is_refused(tmp_path):
    texts = {
        "two.msh": (
            ("2.2 0 8", "2.2 1 8", "it is declared as binary"),
            ("2.2 0 8", "4.0 0 8", "version 4.0; export it as 2.2 or 4.1"),
            ("$MeshFormat", "$Format", "no .MeshFormat"),
            ("$Nodes\n", "$Nodes\n9", "promised"),
            ("$Elements\n", "$Elements\n9", "promised"),
            (" 4 2 0 1 ", " 3 2 0 1 ", "no tetrahedron; export the mesh with its volume elements"),
            (f"\n1 {X}", f"\n77 {X}", "names vertex 1, and there is none"),
            (f"\n2 {X}", f"\n1 {X}", "two vertices have the number 1"),
        ),
        "old.vtk": (
            ("ASCII", "BINARY", "it is binary"),
            ("# vtk", "#", "does not begin"),
            ("UNSTRUCTURED_GRID", "POLYDATA", "no UNSTRUCTURED_GRID"),
            ("CELL_TYPES", "CELL_DATA", "no CELL_TYPES"),
            (X, "nan", "no finite coordinates"),
            (X, "1e300", "give a scale"),
            (X, "x", "'x' is not a number"),
        ),
        "four.msh": (("\n3 1 4 ", "\n3 1 99 ", "elements of type 99"),),
    }
    for name, changes in texts.items():
        for old, new, words in changes:
            text = write(tmp_path, name).read_text()
            assert old in text
            (tmp_path / name).write_text(text.replace(old, new))
            with pytest.raises(InputError, match=words):
                read_tetrahedra(tmp_path / name)
    write(tmp_path, "one.node")
    (tmp_path / "one.ele").unlink()
    for path, words in (
        (tmp_path / "one.node", "one.ele: no such file"),
        (tmp_path / "none.msh", "no such file"),
        (tmp_path / "mesh.obj", "tetrahedra come in a .msh"),
    ):
        with pytest.raises(InputError, match=words):
            read_tetrahedra(path)
    write_arrays(tmp_path / "b.npz", {"position": MESH.position})
    with pytest.raises(InputError, match="no arrays `position` and `tetrahedra`"):
        read_tetrahedra(tmp_path / "b.npz")
    write_arrays(tmp_path / "b.npz", {"position": MESH.position, "tetrahedra": MESH.tetrahedra * 1.0})
    with pytest.raises(InputError, match="whole ones"):
        read_tetrahedra(tmp_path / "b.npz")
    with pytest.raises(SceneError, match=r"scale = 0"):
        read_tetrahedra(tmp_path / "b.npz", 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_damaged_files_make_no_traceback(tmp_path, name):
    """Cut short, words replaced, bytes changed: a mesh or one line."""
    chance = random.Random(name)
    whole = write(tmp_path, name).read_bytes()
    odd = [
        b"-1",
        b"0",
        b"nan",
        b"inf",
        b"1e999",
        b"99999999999999999999",
        b"9223372036854775807",
        b"x",
        b"",
        b"4 4 4",
        b"-7",
    ]
    for _ in range(150):
        data = whole
        for _ in range(chance.choice((1, 1, 3))):
            what, at = chance.random(), chance.randrange(1, max(2, len(data)))
            if what < 0.2:
                data = data[:at]
            elif what < 0.6 and b" " in data:
                words = data.split(b" ")
                words[chance.randrange(len(words))] = chance.choice(odd)
                data = b" ".join(words)
            else:
                data = data[:at] + bytes([chance.randrange(256)]) + data[at + chance.choice((0, 1, 9)) :]
        (tmp_path / name).write_bytes(data)
        try:
            assert read_tetrahedra(tmp_path / name)[0].volumes.min() > 0
        except InputError as error:
            assert "\n" not in str(error) and len(str(error)) < 700
