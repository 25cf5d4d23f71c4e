"""The meshes that a scene names: their files, and derived quantities; also sheets of triangles."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Protocol

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.memory import require_sheet
from softlab.model.base.pins import MeshPins
from softlab.model.geometry.arithmetic.ordered import mean
from softlab.model.geometry.measures import edge_lengths, triangle_areas
from softlab.model.geometry.mesh import TriangleMesh, read_mesh, triangle_mesh
from softlab.model.geometry.sheets import sheet_positions, sheet_triangles

SHEET_BYTES = 600  # of a vertex while a sheet's triangles and edges are made
FINEST, WIDEST = 1e-150, 1e150  # m: spacings of a sheet whose squares float64 can hold
TOP = 0.1  # of the mean edge: what lies so near to the highest vertex counts as high


class MeshPart(Protocol):
    """A scene's description of a mesh (model/tables/mesh.py has the part itself): a file, or rows and columns."""

    file: str | None
    scale: float
    digest: str | None
    rows: int
    columns: int
    spacing: float
    density: float | None
    mass: float
    pinned: MeshPins

    @property
    def diagonals(self) -> str: ...
    @property
    def placement(self) -> str: ...


def bundled_meshes() -> dict[str, Path]:
    """Return the meshes that come with the lab, by the name that a scene gives them."""
    folder = Path(str(resources.files("softlab.model"))) / "catalogue" / "meshes"
    return {path.name: path for path in sorted(folder.iterdir())}


def is_file(path: Path) -> bool:
    """Return True if there is such a file, for any name, however odd."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def mesh_path(file: str) -> Path:
    """Return the file that a part names: a bundled mesh, or else a path from the current folder. Raises InputError.

    A name in a scene file was searched for beside that file before, see model/scene/reader.py.
    """
    bundled = bundled_meshes()
    path = bundled.get(file) or Path(file)
    if not is_file(path):
        raise InputError(
            f"file = {file}: no such file ({path.absolute()}); a path from the current folder, or one of the lab's own: "
            f"{', '.join(bundled)}"
        )
    return path


def file_digest(path: Path) -> str:
    """Return 16 hexadecimal digits of a file's bytes, by which a scene identifies it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def mesh_of(part: MeshPart) -> TriangleMesh:
    """Return the mesh of the part relative to its origin. The last few meshes are cached. Raises InputError."""
    if part.file is None:
        return _sheet(part.rows, part.columns, part.spacing, part.diagonals, part.placement)
    path = mesh_path(part.file)
    stamp = path.stat()
    try:
        return _read(path, part.scale, stamp.st_mtime_ns, stamp.st_size)[0]
    except InputError as error:
        at = "" if part.scale == 1 else f" (at scale = {part.scale:g})"
        raise InputError(f"{error}{at}") from None


@lru_cache(maxsize=8)
def _read(path: Path, scale: float, changed: int, size: int) -> tuple[TriangleMesh, str]:
    return read_mesh(path, scale), file_digest(path)


@lru_cache(maxsize=8)
def _sheet(rows: int, columns: int, spacing: float, diagonals: str, placement: str) -> TriangleMesh:
    require_sheet(rows, columns, SHEET_BYTES, "mesh")
    position = sheet_positions(rows, columns, spacing, flat=placement == "flat")
    return triangle_mesh(position.reshape(-1, 3), sheet_triangles(rows, columns, diagonals))


def describe(part: MeshPart) -> dict[str, object]:
    """Return the fields of a part that follow from its mesh. Raises InputError (the file), SceneError (not that file,
    pins)."""
    derived: dict[str, object] = {}
    if part.file is not None:
        mesh, path = mesh_of(part), mesh_path(part.file)
        stamp = path.stat()
        digest = _read(path, part.scale, stamp.st_mtime_ns, stamp.st_size)[1]
        if part.digest not in (None, digest):
            raise SceneError("mesh.digest", part.digest, f"{part.file} is another file by now ({digest}); leave it out")
        derived |= {"digest": digest, "columns": len(mesh.position), "spacing": _mean_edge(mesh)}
        pinned_vertices(part)
    elif min(part.rows, part.columns) < 2:
        raise SceneError(
            "mesh.rows x mesh.columns", f"{part.rows} x {part.columns}", "at least 2 x 2: a mesh has triangles"
        )
    elif not FINEST <= part.spacing <= WIDEST:
        allowed = f"gives triangles whose area float64 cannot hold; use a spacing of {FINEST:g} to {WIDEST:g} m"
        raise SceneError("mesh.spacing", part.spacing, allowed)
    if part.density is not None:
        derived["mass"] = mean(vertex_masses(part))
    return derived


def _mean_edge(mesh: TriangleMesh) -> float:
    return mean(edge_lengths(mesh.position, mesh.edges.edges))


def vertex_masses(part: MeshPart) -> np.ndarray:
    """Return (vertices,) float64 [kg]: a third of each triangle for each of its corners, or the same for all."""
    mesh = mesh_of(part)
    if part.density is None:
        return np.full(len(mesh.position), part.mass)
    thirds = np.repeat(triangle_areas(mesh.position, mesh.triangles) / 3, 3)
    return part.density * np.bincount(mesh.triangles.ravel(), thirds, len(mesh.position))


def pinned_vertices(part: MeshPart) -> np.ndarray:
    """Return (pins,) int64, ascending: of a mesh from a file. Raises SceneError for vertices that it does not have."""
    mesh = mesh_of(part)
    if part.pinned == "top":
        height = mesh.position[:, 1]
        pins = np.flatnonzero(height >= height.max() - TOP * _mean_edge(mesh))
        if len(pins) == len(height):
            raise SceneError(
                "mesh.pinned", "top",
                f"the mesh is level (its heights differ by {np.ptp(height):.3g} m), so that all {len(height)} vertices "
                "would be pinned; give a list of vertices, or turn the mesh until y points up",
            )  # fmt: skip
        return pins
    if part.pinned == "none":
        return np.zeros(0, np.int64)
    listed = np.array(part.pinned, dtype=np.int64)
    outside = (listed < 0) | (listed >= len(mesh.numbering))
    if outside.any():
        raise SceneError(
            "mesh.pinned", int(listed[outside][0]), f"the file has vertices 0 to {len(mesh.numbering) - 1}"
        )  # fmt: skip
    pins = mesh.numbering[listed].astype(np.int64)
    if (pins < 0).any():
        raise SceneError("mesh.pinned", int(listed[pins < 0][0]), "this vertex belongs to no triangle and was left out")
    return np.unique(pins)
