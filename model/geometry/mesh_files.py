"""Files of surfaces as arrays of triangles: OBJ, STL, PLY, OFF, glTF, Medit and Gmsh.

Coordinates and indices are checked here, and polygons are cut into triangles. Further repairs, and their reports:
model/geometry/mesh.py. The readers of the formats: model/geometry/formats.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.waiting import work
from softlab.model.geometry.formats.faces import Faces
from softlab.model.geometry.formats.gltf import read_gltf
from softlab.model.geometry.formats.gmsh import read_gmsh
from softlab.model.geometry.formats.medit import read_medit
from softlab.model.geometry.formats.obj import read_obj
from softlab.model.geometry.formats.off import read_off
from softlab.model.geometry.formats.ply import read_ply
from softlab.model.geometry.formats.polygons import triangulated
from softlab.model.geometry.formats.source import BYTES_PER_FILE_BYTE, read_bytes
from softlab.model.geometry.formats.stl import read_stl
from softlab.model.geometry.mending.welding import many

LARGEST = 1e9  # m: products of four lengths, as in squared areas, stay inside float32
MAX_VERTICES = 2**31 // 6  # indices of half edges are 32-bit

READERS: dict[str, Callable[[bytes, Path], Faces]] = {
    ".obj": lambda data, _: read_obj(data),
    ".stl": lambda data, _: read_stl(data),
    ".ply": lambda data, _: read_ply(data),
    ".off": lambda data, _: read_off(data),
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".mesh": lambda data, _: read_medit(data).surface(),
    ".msh": lambda data, _: read_gmsh(data).surface(),
}
FORMATS = tuple(READERS)
WHAT = "a mesh is a file of triangles that ends in .obj, .stl or .ply (or .off, .glb, .gltf, .mesh, .msh)"
CONVERSIONS = {
    **dict.fromkeys((".step", ".stp", ".iges", ".igs", ".brep"), "mesh the CAD part: gmsh FILE -2 -o part.stl"),
    **dict.fromkeys((".fbx", ".blend", ".dae", ".3ds", ".abc", ".usd", ".usdz", ".usda", ".usdc", ".x3d", ".wrl"),
                    "open it in Blender and export it as .obj or .glb"),
    ".3mf": "python -c \"import trimesh; trimesh.load_mesh('FILE').export('part.stl')\" (pip install lxml networkx)",
    **dict.fromkeys((".vtk", ".vtu", ".vtp", ".med", ".inp", ".xdmf", ".meshb"),
                    "pip install meshio && meshio convert FILE part.ply"),
    **dict.fromkeys((".xyz", ".pts", ".pcd", ".las", ".laz", ".e57"),
                    "it is a cloud of points: make a surface of it (MeshLab: Screened Poisson) and export that"),
    **dict.fromkeys((".3dxml", ".catpart", ".sldprt", ".sldasm", ".ipt", ".prt", ".f3d", ".fcstd", ".x_t", ".jt"),
                    "open it in the CAD program that made it and export it as .stl or .step"),
    **dict.fromkeys((".zae", ".ctm", ".xaml"), "open it in MeshLab or trimesh and export it as .ply"),
    **dict.fromkeys((".gz", ".zip", ".bz2", ".xz", ".7z"), "unpack it first"),
}  # fmt: skip


class MeshArrays(NamedTuple):
    """`position` (vertices, 3) float64 [m], `triangles` (n, 3) int64, `notes`: a sentence for each thing that was decided."""

    position: np.ndarray
    triangles: np.ndarray
    notes: tuple[str, ...]


def read_arrays(path: str | Path, scale: float = 1.0) -> MeshArrays:
    """Return the vertices, times `scale` [m per unit of the file], and triangles of a file, in the file's order.

    Raises InputError: no such file, another format, cut short, no triangle, a coordinate that is not finite or beyond
    LARGEST, an index out of range, each with its line where the file is text; SceneError (scale).
    """
    path = Path(path)
    if not (isfinite(scale) and scale > 0):
        raise SceneError("scale", scale, "must be a finite number greater than 0")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        hint = CONVERSIONS.get(suffix, "export it as one").replace("FILE", path.name)
        raise InputError(f"{path}: {WHAT}; {hint}")
    data = read_bytes(path, WHAT, BYTES_PER_FILE_BYTE)
    if not data.strip():
        raise InputError(f"{path} is empty: it holds no triangle; export the mesh again")
    try:
        with work(f"reading {path.name}"), warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=RuntimeWarning)  # numbers beyond float32 are refused below
            faces = READERS[suffix](data, path)
            return _checked(faces, scale)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except MemoryError:
        raise
    except Exception as error:  # whatever a parser of a foreign file trips over is the file's fault
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {suffix[1:].upper()} ({reason}); it is damaged, cut short or of another format: "
            "export it again"
        ) from None


def _checked(faces: Faces, scale: float) -> MeshArrays:
    if not len(faces.sizes):
        what = f"{many(len(faces.position), 'point')}, but no triangle" if len(faces.position) else "no triangle"
        raise InputError(f"it holds {what}; a mesh needs faces: export it with them")
    with np.errstate(over="ignore"):
        position = faces.position * scale
    beyond = (faces.corners < 0) | (faces.corners >= len(position))
    if beyond.any():
        place = int(np.argmax(beyond))
        face = int(np.searchsorted(np.cumsum(faces.sizes), place, "right"))
        raise InputError(
            f"a face names vertex {faces.corners[place] + faces.first}, counted from {faces.first}, and there are "
            f"{len(position)}{_at(faces.face_line(face))}; the file is damaged or cut short: export it again"
        )
    check_vertices(position, faces.vertex_line)
    triangles, crossing = triangulated(position, faces.corners, faces.sizes)
    notes = list(faces.notes)
    if len(triangles) > len(faces.sizes):
        notes.append(
            f"faces of more than three corners were split: {many(len(faces.sizes), 'face')}, {len(triangles)} triangles"
        )
    if len(crossing):
        first = int(crossing[0])
        where = f"(first face {first}, counted from 0{_at(faces.face_line(first), '; ', '')})"
        notes.append(
            f"1 face crosses itself {where} and has no area of its own: it was split from its first corner"
            if len(crossing) == 1
            else f"{len(crossing)} faces cross themselves {where} and have no areas of their own: they were split from their "
            "first corners"
        )
    return MeshArrays(position, triangles, tuple(notes))


def _at(line: str, before: str = " (", after: str = ")") -> str:
    return f"{before}{line}{after}" if line else ""


def check_vertices(position: np.ndarray, line: Callable[[int], str] = lambda _: "") -> None:
    """Raise InputError for coordinates (vertices, 3) that are not finite or beyond LARGEST, or more than MAX_VERTICES.
    `line`: returns where a vertex stands in its file."""
    if len(position) > MAX_VERTICES:
        raise InputError(f"{len(position)} vertices; at most {MAX_VERTICES} (32-bit indices): decimate the mesh")
    wrong = ~np.isfinite(position).all(axis=1)
    if wrong.any():
        vertex, count = int(np.argmax(wrong)), int(wrong.sum())
        raise InputError(
            f"{many(count, 'vertex', 'vertices')} without finite coordinates, first vertex {vertex} (counted from "
            f"0{_at(line(vertex), '; ', '')}), {position[vertex].tolist()}; export the mesh again"
        )
    size = np.abs(position).max(axis=1, initial=0.0)
    if (size > LARGEST).any():
        vertex = int(np.argmax(size))
        raise InputError(
            f"a coordinate of {size[vertex]:.10g} m{_at(line(vertex))}; at most {LARGEST:g}: move the origin nearer "
            "to 0, or give a scale that turns the file's unit to m"
        )


def rows_of_three(name: str, array: ArrayLike, dtype: type) -> np.ndarray:
    """Return a caller's array as (n, 3); an empty one as (0, 3). Raises InputError for another shape."""
    rows = np.asarray(array)
    if rows.size == 0:
        return np.zeros((0, 3), dtype)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"{name} has the shape {rows.shape}; must be (n, 3)")
    return rows.astype(dtype)


def check_indices(vertices: int, triangles: np.ndarray) -> None:
    """Raise InputError for indices in `triangles` (n, 3) that are not 0 to `vertices` - 1."""
    wrong = ((triangles < 0) | (triangles >= vertices)).any(axis=1)
    if wrong.any():
        triangle = int(np.argmax(wrong))
        raise InputError(
            f"triangle {triangle} (counted from 0) names the vertices {triangles[triangle].tolist()}, and there are "
            f"{vertices}; the mesh is damaged or cut short: export it again"
        )
