"""Files of tetrahedra: Gmsh .msh (2.2 and 4.1), Medit .mesh, legacy .vtk (text), .node with .ele beside it, and .npz.

Of the elements of a file only tetrahedra are taken (of those of second order their corners). Counts in a file are
checked, and a file with fewer entries is refused. Formats: model/geometry/formats for .msh and .mesh; the VTK user's
guide, "VTK File Formats"; the .node and .ele files of Triangle and TetGen, as their manuals describe them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path

import numpy as np

from softlab.model.base.disk_cache import save_arrays
from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.files import read_archive, replacing
from softlab.model.geometry.formats.elements import Elements
from softlab.model.geometry.formats.gmsh import read_gmsh
from softlab.model.geometry.formats.medit import read_medit
from softlab.model.geometry.formats.source import plain, read_bytes, without_comments
from softlab.model.geometry.formats.words import Words
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh

WHAT = "tetrahedra come in a .msh, .mesh, .vtk, .ele and .node, or .npz file"
VTK_TETRAHEDRA = (10, 24)  # of first and second order: their first four nodes are the corners


def read_tetrahedra(path: str | Path, scale: float = 1.0) -> tuple[TetrahedralMesh, tuple[str, ...]]:
    """Return (the mesh in a file, coordinates times `scale` [m per unit of the file]; what was left out). Vertices and
    tetrahedra keep the file's order. Raises InputError (unreadable, cut short, no tetrahedron, what TetrahedralMesh
    refuses: no volume, inside out) and SceneError (scale)."""
    path = Path(path)
    if not (isfinite(scale) and scale > 0):
        raise SceneError("scale", scale, "must be a finite number greater than 0")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(f"{path}: {WHAT}")
    reader = READERS[suffix]
    contents = [read_archive(path, WHAT)] if suffix == ".npz" else [read_bytes(file, WHAT) for file in files_of(path)]
    try:
        return _mesh(reader(*contents), scale)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # whatever a parser of a foreign file trips over is the file's fault
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {suffix[1:]} ({reason}); it is damaged, cut short or of another format: export it "
            "again"
        ) from None


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files to read for a mesh: `path`, or of a .node and .ele both, whichever is named."""
    if path.suffix.lower() in (".node", ".ele"):
        return path.with_suffix(".node"), path.with_suffix(".ele")
    return (path,)


def write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write the arrays by name into `path`, an .npz file, completely or not at all. Raises InputError."""
    with replacing(path) as temporary, open(temporary, "wb") as opened:
        save_arrays(opened, arrays)


def holds_tetrahedra(path: str | Path) -> bool:
    """Return True if a file contains tetrahedra: by its name or, for .msh and .mesh, which may contain a surface, by
    its content. Raises InputError."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".msh", ".mesh"):
        return suffix in READERS
    data = read_bytes(path, WHAT)
    try:
        return len(READERS[suffix](data).tetrahedra) > 0
    except Exception:
        return True  # the reader says what is wrong


def _mesh(raw: Elements, scale: float) -> tuple[TetrahedralMesh, tuple[str, ...]]:
    if not len(raw.tetrahedra):
        raise InputError("it holds no tetrahedron; export the mesh with its volume elements, not its surface alone")
    corners = raw.places(raw.tetrahedra, "tetrahedron")
    used = np.zeros(len(raw.name), dtype=bool)
    used[corners] = True
    unused = int((~used).sum())
    notes: tuple[str, ...] = ()
    if unused:
        notes = (f"{unused} {'vertex' if unused == 1 else 'vertices'} of no tetrahedron left out",)
    with np.errstate(over="ignore"):
        return TetrahedralMesh(raw.position[used] * scale, (np.cumsum(used) - 1)[corners]), notes


def _read_npz(arrays: dict[str, np.ndarray]) -> Elements:
    if not {"position", "tetrahedra"} <= set(arrays):
        raise InputError("it has no arrays `position` and `tetrahedra`; make it by softlab cook")
    position, corners = arrays["position"], arrays["tetrahedra"]
    if position.ndim != 2 or position.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 4:
        raise InputError(
            f"`position` is {position.shape}, `tetrahedra` {corners.shape}; they must be (n, 3) and (m, 4)"
        )
    if position.dtype.kind not in "fiu" or corners.dtype.kind not in "iu":
        raise InputError("`position` must hold numbers and `tetrahedra` whole ones")
    return Elements(np.arange(len(position)), position.astype(np.float64), tetrahedra=corners.astype(np.int64))


def _read_vtk(data: bytes) -> Elements:
    head = plain(data).decode("latin-1").split("\n", 3)
    if not head[0].startswith("# vtk DataFile") or len(head) < 4:
        raise InputError("it does not begin with `# vtk DataFile Version`; export it as legacy VTK (.vtk, not .vtu)")
    if head[2].strip().upper() != "ASCII":
        raise InputError("it is binary; export it as text (ASCII)")
    words = Words(head[3])
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
    return Elements(np.arange(count), position, tetrahedra=nodes[start[taken][:, None] + np.arange(4)])


def _read_ele(node: bytes, ele: bytes) -> Elements:
    words, other = (Words(without_comments(plain(data)).decode("latin-1")) for data in (node, ele))
    count, dimension, attributes, markers = words.counts(4, "the .node file")
    if dimension != 3:
        raise InputError(f"its vertices have {dimension} coordinates, not 3; export it again")
    name, position = _numbered(words, count, 3, attributes + markers)
    count, corners, attributes = other.counts(3, "the .ele file")
    if corners < 4:
        raise InputError(f"its elements have {corners} corners: they are no tetrahedra; export it again")
    width = 1 + corners + attributes
    rows = other.real(count * width, "tetrahedra").reshape(count, width)
    return Elements(name, position, tetrahedra=rows[:, 1:5].astype(np.int64))


def _numbered(words: Words, count: int, width: int, more: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a number, `width` coordinates and `more` numbers that are ignored."""
    rows = words.real(count * (1 + width + more), "vertices").reshape(count, 1 + width + more)
    return rows[:, 0].astype(np.int64), rows[:, 1 : 1 + width]


READERS: dict[str, Callable[..., Elements]] = {
    ".msh": read_gmsh,
    ".mesh": read_medit,
    ".vtk": _read_vtk,
    ".ele": _read_ele,
    ".node": _read_ele,
    ".npz": _read_npz,
}
