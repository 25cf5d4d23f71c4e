"""Files of triangle meshes -> raw arrays, as they stand in the file: OBJ, STL and PLY, through trimesh.

trimesh reads what it can and drops the rest without a word. So what a file promises is counted here, and a file that
yields less is refused. Nothing is mended: that is model/geometry/mesh.py.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from model.core.errors import InputError
from model.core.memory import available_bytes, readable

FORMATS = (".obj", ".stl", ".ply")
BYTES_PER_FILE_BYTE = 25  # of memory while a file is read and mended: 8 to 18 seen, with a million vertices

STL_HEADER, STL_TRIANGLE = 84, 50  # bytes of a binary STL


def read_arrays(path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """(vertices (n, 3) float64, triangles (m, 3) int64, how many more triangles than faces in the file: polygons are split).

    Raises InputError: no such file, no mesh format, cut short, not a mesh, no triangle (a point cloud).
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: a mesh is a file of triangles that ends in .obj, .stl or .ply; export it as one")
    data = _bytes(path)
    read = {".obj": _read_obj, ".stl": _read_stl, ".ply": _read_ply}[suffix]
    try:
        with warnings.catch_warnings():
            # numpy below 2.3 only warns where a number ends in something else
            warnings.filterwarnings("error", message="string or file could not be read")
            warnings.filterwarnings("ignore", category=RuntimeWarning)  # of numbers beyond float32: looked at later
            vertices, triangles, more = read(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # whatever a parser of a foreign file trips over is the file's fault
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {suffix[1:].upper()} ({reason}); it is damaged, cut short or of another format: "
            "export it again"
        ) from None
    if len(triangles) == 0:
        what = f"{len(vertices)} points, but no triangle" if len(vertices) else "no triangle"
        raise InputError(f"{path} holds {what}; a mesh needs faces: export it with them")
    least, most = int(triangles.min()), int(triangles.max())
    if least < 0 or most >= len(vertices):
        raise InputError(f"{path}: {_beyond(least if least < 0 else most, 'from 0', len(vertices))}")
    return vertices, triangles, more


def _beyond(vertex: int, counted: str, there: int) -> str:
    return (
        f"a face names vertex {vertex}, counted {counted}, and there are {there}; the file is damaged or cut short: export "
        "it again"
    )


def _bytes(path: Path) -> bytes:
    try:
        needed, free = path.stat().st_size * BYTES_PER_FILE_BYTE, available_bytes()
        if needed > free:
            raise InputError(
                f"{path} needs about {readable(needed)} of memory, of which {readable(free)} is free; decimate the mesh"
            )
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a directory; a mesh is a .obj, .stl or .ply file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _triangles(faces: Any) -> np.ndarray:
    """(n, 3) int64 of faces with any number of corners, polygons as fans from their first corner."""
    from trimesh.geometry import triangulate_quads

    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.shape[1] == 3:
        return faces.astype(np.int64)
    return np.asarray(triangulate_quads(faces), dtype=np.int64).reshape(-1, 3)


def _read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    """Vertices and faces alone: with texture coordinates or materials trimesh splits and reorders vertices."""
    from trimesh.exchange.obj import load_obj

    data = re.sub(rb"\\\r?\n", b" ", data)
    lines = len(re.findall(rb"^[ \t]*v[ \t]", data, re.MULTILINE))
    points = re.findall(rb"^[ \t]*v[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", data, re.MULTILINE)
    if len(points) != lines:
        raise InputError(f"vertices of fewer than three coordinates: {lines - len(points)}; export it again")
    faces = re.findall(rb"^[ \t]*f[ \t]+(.*)$", data, re.MULTILINE)
    if not faces:
        return np.zeros((lines, 3)), np.zeros((0, 3), dtype=np.int64), 0
    corners = re.sub(rb"/\S*", b"", b"\nf ".join(faces))
    if re.search(rb"(?:^|\s)[-+]?0+(?:\s|$)", corners):
        raise InputError("a face names vertex 0, and OBJ counts from 1; export it again")
    if b"-" in corners:
        _refuse_interleaved(data)
    text = b"v " + b"\nv ".join(points) + b"\nf " + corners
    try:
        loaded = load_obj(io.StringIO(text.decode("latin-1")), maintain_order=True, skip_materials=True)
    except IndexError:  # trimesh looks the vertices up itself, so that no array of faces comes out to be checked
        named = (int(corner) for corner in re.findall(rb"(?<!\S)[-+]?\d+(?!\S)", corners))
        vertex = next((vertex for vertex in named if abs(vertex) > lines), None)
        if vertex is None:
            raise
        raise InputError(_beyond(vertex, "from 1" if vertex > 0 else "from the end", lines)) from None
    (mesh,) = loaded["geometry"].values()
    if len(mesh["vertices"]) != lines:
        raise InputError(f"{lines} vertices, of which {len(mesh['vertices'])} can be read; export it again")
    triangles = _triangles(mesh["faces"])
    return np.asarray(mesh["vertices"], dtype=np.float64), triangles, _more(len(faces), triangles)


def _refuse_interleaved(data: bytes) -> None:
    first_face = re.search(rb"^[ \t]*f[ \t]", data, re.MULTILINE)
    if first_face and re.search(rb"^[ \t]*v[ \t]", data[first_face.end() :], re.MULTILINE):
        raise InputError(
            "faces count vertices backwards (negative indices) and vertices follow them; export it with vertices counted "
            "from the start"
        )


def _read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    """Three vertices of its own for each triangle. Of text, every solid."""
    from trimesh.exchange.stl import load_stl_ascii, load_stl_binary

    promised = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little") if len(data) >= STL_HEADER else 0
    binary = len(data) == STL_HEADER + STL_TRIANGLE * promised
    loaded: dict[str, Any]
    if binary:
        loaded = load_stl_binary(io.BytesIO(data))
    else:  # exporters begin binary files with `solid`, too: the word tells nothing
        facets = len(re.findall(rb"^[ \t]*facet\b", data, re.MULTILINE | re.IGNORECASE))
        if facets == 0 and len(data) >= STL_HEADER:
            raise InputError(
                f"{promised} triangles promised, which take {STL_HEADER + STL_TRIANGLE * promised} bytes, but there are "
                f"{len(data)}: damaged or cut short; export it again"
            )
        promised = facets
        loaded = load_stl_ascii(io.StringIO(data.decode("latin-1").replace("\r\n", "\n")))
    solids = [loaded] if "vertices" in loaded else list(loaded["geometry"].values())
    vertices = np.concatenate([np.zeros((0, 3)), *(solid["vertices"] for solid in solids)]).astype(np.float64)
    if promised * 3 != len(vertices):
        raise InputError(f"{promised} triangles begin, {len(vertices) // 3} are whole: cut short; export it again")
    return vertices, np.arange(len(vertices)).reshape(-1, 3), 0


def _read_ply(data: bytes) -> tuple[np.ndarray, np.ndarray, int]:
    from trimesh.exchange.ply import load_ply

    loaded: dict[str, Any] = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    promised = {name: element["length"] for name, element in loaded["metadata"]["_ply_raw"].items()}
    vertices = np.asarray(loaded.get("vertices", np.zeros((0, 3))), dtype=np.float64)
    faces = loaded.get("faces")
    triangles = np.zeros((0, 3), dtype=np.int64) if faces is None else _triangles(faces)
    if len(vertices) != promised.get("vertex", 0):
        raise InputError(
            f"{promised['vertex']} vertices promised, {len(vertices)} found: it is cut short; export it again"
        )
    return vertices, triangles, _more(promised.get("face", 0), triangles)


def _more(faces: int, found: np.ndarray) -> int:
    """How many triangles came out more than `faces` went in; InputError where it is fewer."""
    if len(found) < faces:
        raise InputError(
            f"{faces} faces, of which {len(found)} can be read: it is cut short, or has faces of fewer than three corners; "
            "export it again"
        )
    return len(found) - faces
