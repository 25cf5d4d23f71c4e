"""Files of tetrahedra -> a mesh: .msh of gmsh (2.2 and 4.1, text), legacy .vtk (text), .node with .ele beside it, and .npz.

Of the elements of a file only tetrahedra are taken (of those of second order their corners). What a file promises is counted,
and one that holds less is refused. Formats: the gmsh reference manual, section 10; the VTK user's guide, "VTK File
Formats"; the .node and .ele files of Triangle and TetGen, as their manuals describe them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path

import numpy as np

from model.core.errors import InputError, SceneError
from model.core.files import check_source, read_archive, replacing
from model.core.memory import available_bytes, readable
from model.geometry.tetrahedra.mesh import TetrahedralMesh

WHAT = "tetrahedra come in a .msh, .vtk, .ele and .node, or .npz file"
BYTES_PER_FILE_BYTE = 25  # of memory while a text is read
MSH_TETRAHEDRA, VTK_TETRAHEDRA = (4, 11), (10, 24)  # of first and second order: their first four nodes are the corners

Raw = tuple[
    np.ndarray, np.ndarray, np.ndarray
]  # names of the vertices (n,), coordinates (n, 3), corners by name (m, 4)


def read_tetrahedra(path: str | Path, scale: float = 1.0) -> tuple[TetrahedralMesh, tuple[str, ...]]:
    """(the mesh in a file, coordinates times `scale` [m per unit of the file]; what was left out). Vertices and tetrahedra
    keep the file's order. Raises InputError (unreadable, cut short, no tetrahedron, what TetrahedralMesh refuses: no volume,
    inside out) and SceneError (scale)."""
    path = Path(path)
    if not (isfinite(scale) and scale > 0):
        raise SceneError("scale", scale, "must be a finite number greater than 0")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(f"{path}: {WHAT}")
    reader = READERS[suffix]
    held = [read_archive(path, WHAT)] if suffix == ".npz" else [_text(file) for file in files_of(path)]
    try:
        return _mesh(reader(*held), scale)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # whatever a parser of a foreign file trips over is the file's fault
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {suffix[1:]} ({reason}); it is damaged, cut short or of another format: export it "
            "again"
        ) from None


def files_of(path: Path) -> tuple[Path, ...]:
    """What has to be read for a mesh: `path`, or of a .node and .ele both, whichever is named."""
    if path.suffix.lower() in (".node", ".ele"):
        return path.with_suffix(".node"), path.with_suffix(".ele")
    return (path,)


def write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """The arrays by name into `path`, an .npz file, written whole or not at all. Raises InputError."""
    with replacing(path) as temporary, open(temporary, "wb") as opened:
        np.savez(opened, **arrays)  # type: ignore[arg-type]


def _mesh(raw: Raw, scale: float) -> tuple[TetrahedralMesh, tuple[str, ...]]:
    name, position, corners = raw
    if not len(corners):
        raise InputError("it holds no tetrahedron; export the mesh with its volume elements, not its surface alone")
    order = np.argsort(name, kind="stable")
    if (np.diff(name[order]) == 0).any():
        raise InputError(
            f"two vertices have the number {name[order][:-1][np.diff(name[order]) == 0][0]}; export it again"
        )
    place = np.minimum(np.searchsorted(name[order], corners), len(name) - 1)
    missing = name[order][place] != corners if len(name) else np.ones(corners.shape, dtype=bool)
    if missing.any():
        raise InputError(
            f"a tetrahedron names vertex {corners[missing][0]}, and there is none of that number; the file is damaged or cut "
            "short: export it again"
        )
    corners = order[place]
    used = np.zeros(len(name), dtype=bool)
    used[corners] = True
    unused = int((~used).sum())
    told: tuple[str, ...] = ()
    if unused:
        told = (f"{unused} {'vertex' if unused == 1 else 'vertices'} of no tetrahedron left out",)
    with np.errstate(over="ignore"):
        return TetrahedralMesh(position[used] * scale, (np.cumsum(used) - 1)[corners]), told


def _text(path: Path) -> str:
    check_source(path, WHAT)
    needed, free = path.stat().st_size * BYTES_PER_FILE_BYTE, available_bytes()
    if needed > free:
        raise InputError(
            f"{path} needs about {readable(needed)} of memory, of which {readable(free)} is free; take a coarser mesh"
        )
    return path.read_bytes().decode("latin-1")


class _Words:
    """The words of a text one after the other, some at a time."""

    def __init__(self, text: str) -> None:
        self.words, self.at = text.split(), 0

    def take(self, count: int, what: str) -> list[str]:
        if not 0 <= count <= len(self.words) - self.at:
            raise InputError(
                f"{count} numbers of {what} promised, {len(self.words) - self.at} found: cut short or damaged; export it "
                "again"
            )
        self.at += count
        return self.words[self.at - count : self.at]

    def counts(self, count: int, what: str) -> list[int]:
        return [int(word) for word in self.take(count, what)]

    def whole(self, count: int, what: str) -> np.ndarray:
        return np.array(self.take(count, what), dtype=np.int64)

    def real(self, count: int, what: str) -> np.ndarray:
        return np.array(self.take(count, what), dtype=np.float64)

    def upto(self, word: str) -> bool:
        """Go behind the next `word`; whether there is one."""
        try:
            self.at = self.words.index(word, self.at) + 1
        except ValueError:
            return False
        return True


def _read_npz(held: dict[str, np.ndarray]) -> Raw:
    if not {"position", "tetrahedra"} <= set(held):
        raise InputError("it has no arrays `position` and `tetrahedra`; make it by softlab cook")
    position, corners = held["position"], held["tetrahedra"]
    if position.ndim != 2 or position.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 4:
        raise InputError(
            f"`position` is {position.shape}, `tetrahedra` {corners.shape}; they must be (n, 3) and (m, 4)"
        )
    if position.dtype.kind not in "fiu" or corners.dtype.kind not in "iu":
        raise InputError("`position` must hold numbers and `tetrahedra` whole ones")
    return np.arange(len(position)), position.astype(np.float64), corners.astype(np.int64)


def _read_msh(text: str) -> Raw:
    words = _Words(text)
    if not words.upto("$MeshFormat"):
        raise InputError("it has no $MeshFormat; export it from gmsh as version 2.2 or 4.1")
    version, binary, _ = words.take(3, "its format")
    if binary != "0":
        raise InputError("it is binary; export it as text (in gmsh: Mesh.Binary = 0)")
    if version not in ("2", "2.2", "4.1"):
        raise InputError(f"it is of version {version[:20]}; export it as 2.2 or 4.1 (in gmsh: Mesh.MshFileVersion)")
    if not words.upto("$Nodes"):
        raise InputError("it has no $Nodes: cut short; export it again")
    modern = version == "4.1"
    name, position = _msh_nodes(words) if modern else _numbered(words, int(words.take(1, "nodes")[0]), 3)
    if not words.upto("$Elements"):
        raise InputError("it has no $Elements: cut short; export it again")
    return name, position, _msh_blocks(words) if modern else _msh_lines(text)


def _msh_nodes(words: _Words) -> tuple[np.ndarray, np.ndarray]:
    names, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    blocks, total, _, _ = words.counts(4, "nodes")
    for _ in range(blocks):
        dimension, _, parametric, count = words.counts(4, "nodes")
        width = 3 + (dimension if parametric else 0)
        names.append(words.whole(count, "nodes"))
        places.append(words.real(count * width, "nodes").reshape(count, width)[:, :3])
    name = np.concatenate(names)
    if len(name) != total:
        raise InputError(f"{total} nodes promised, {len(name)} found: cut short or damaged; export it again")
    return name, np.concatenate(places)


def _msh_blocks(words: _Words) -> np.ndarray:
    """Nodes of the elements of version 4.1; how many an element has is told by where the words of a block end."""
    found = [np.zeros((0, 4), dtype=np.int64)]
    nodes = {
        1: 2,
        2: 3,
        3: 4,
        4: 4,
        5: 8,
        6: 6,
        7: 5,
        8: 3,
        9: 6,
        10: 9,
        11: 10,
        12: 27,
        13: 18,
        14: 14,
        15: 1,
        16: 8,
        17: 20,
    }
    blocks, _, _, _ = words.counts(4, "elements")
    for _ in range(blocks):
        _, _, kind, count = words.counts(4, "elements")
        if kind not in nodes:
            raise InputError(f"its elements of type {kind} are not known here; export tetrahedra alone")
        width = 1 + nodes[kind]
        each = words.whole(count * width, "elements").reshape(count, width)
        if kind in MSH_TETRAHEDRA:
            found.append(each[:, 1:5])
    return np.concatenate(found)


def _msh_lines(text: str) -> np.ndarray:
    """Nodes of the elements of version 2.2, a line each: number, type, how many tags, tags, nodes."""
    lines = text[text.index("$Elements") :].splitlines()[1:]
    count = int(lines[0])
    rows = [line.split() for line in lines[1 : count + 1]]
    if count < 0 or len(rows) < count or any(len(row) < 4 for row in rows):
        raise InputError(f"{count} elements promised, {len(rows)} lines found: cut short or damaged; export it again")
    kinds = {str(kind) for kind in MSH_TETRAHEDRA}
    corners = [row[3 + int(row[2]) :][:4] for row in rows if row[1] in kinds]
    return np.array(corners, dtype=np.int64).reshape(len(corners), 4)


def _read_vtk(text: str) -> Raw:
    head = text.split("\n", 3)
    if not head[0].startswith("# vtk DataFile") or len(head) < 4:
        raise InputError("it does not begin with `# vtk DataFile Version`; export it as legacy VTK (.vtk, not .vtu)")
    if head[2].strip().upper() != "ASCII":
        raise InputError("it is binary; export it as text (ASCII)")
    words = _Words(head[3])
    if not words.upto("UNSTRUCTURED_GRID") or not words.upto("POINTS"):
        raise InputError("it holds no UNSTRUCTURED_GRID with POINTS; export the tetrahedra as one")
    count = int(words.take(2, "points")[0])
    position = words.real(3 * count, "points").reshape(count, 3)
    if not words.upto("CELLS"):
        raise InputError("it has no CELLS: cut short; export it again")
    cells, size = words.counts(2, "cells")
    if words.words[words.at : words.at + 1] == ["OFFSETS"]:  # since version 5.1
        words.take(2, "cells")
        start = words.whole(cells, "cells")
        words.upto("CONNECTIVITY")
        words.take(1, "cells")
        nodes, kinds = words.whole(size, "cells"), cells - 1
        start, lengths = start[:-1], np.diff(start)
    else:
        nodes, kinds = words.whole(size, "cells"), cells
        begins = [0]
        for _ in range(cells - 1):
            begins.append(begins[-1] + 1 + int(nodes[begins[-1]]))
        start, lengths = np.array(begins)[:cells] + 1, nodes[np.array(begins)[:cells]]
    if not words.upto("CELL_TYPES"):
        raise InputError("it has no CELL_TYPES: cut short; export it again")
    words.take(1, "cells")
    taken = np.isin(words.whole(kinds, "cells"), VTK_TETRAHEDRA)
    if (lengths[taken] < 4).any():
        raise InputError("a tetrahedron has fewer than four corners: damaged; export it again")
    return np.arange(count), position, nodes[start[taken][:, None] + np.arange(4)]


def _read_ele(node: str, ele: str) -> Raw:
    words, other = (_Words("\n".join(line.partition("#")[0] for line in text.splitlines())) for text in (node, ele))
    count, dimension, attributes, markers = words.counts(4, "the .node file")
    if dimension != 3:
        raise InputError(f"its vertices have {dimension} coordinates, not 3; export it again")
    name, position = _numbered(words, count, 3, attributes + markers)
    count, corners, attributes = other.counts(3, "the .ele file")
    if corners < 4:
        raise InputError(f"its elements have {corners} corners: they are no tetrahedra; export it again")
    width = 1 + corners + attributes
    rows = np.array(other.take(count * width, "tetrahedra")).reshape(count, width)
    return name, position, rows[:, 1:5].astype(np.int64)


def _numbered(words: _Words, count: int, width: int, more: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a number, `width` coordinates and `more` that are not asked for."""
    rows = np.array(words.take(count * (1 + width + more), "vertices")).reshape(count, 1 + width + more)
    return rows[:, 0].astype(np.int64), rows[:, 1 : 1 + width].astype(np.float64)


READERS: dict[str, Callable[..., Raw]] = {
    ".msh": _read_msh,
    ".vtk": _read_vtk,
    ".ele": _read_ele,
    ".node": _read_ele,
    ".npz": _read_npz,
}
