"""Tetrahedral bodies made from a mesh and parameters, cached on disk, and their file format (`softlab cook`)."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from math import inf
from pathlib import Path
from typing import Any, Literal, get_args
from weakref import WeakValueDictionary

import numpy as np

from softlab.model.assets import tetrahedral_body
from softlab.model.assets.tetrahedral_body import (
    DENSITY,
    CookedBody,
    body_of_surface,
    body_of_tetrahedra,
    body_of_voxels,
    scaled,
)
from softlab.model.base.digest import ROOT, source_digest
from softlab.model.base.disk_cache import cache_folder, load_or_make
from softlab.model.base.errors import InputError, SceneError, SoftlabError
from softlab.model.base.files import check_source, is_there, read_archive
from softlab.model.base.waiting import work
from softlab.model.geometry.mesh import TriangleMesh, mesh_bytes, read_mesh, triangle_mesh
from softlab.model.geometry.mesh_files import FORMATS, read_arrays
from softlab.model.geometry.repair import simplified, united
from softlab.model.geometry.shapes import Shape, ShapeName
from softlab.model.geometry.solid import as_mesh, filled
from softlab.model.geometry.tetrahedra.embedding import Embedding
from softlab.model.geometry.tetrahedra.files import READERS, files_of, holds_tetrahedra, read_tetrahedra, write_arrays
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh, check_density
from softlab.model.geometry.tetrahedra.report import Report
from softlab.model.geometry.tetrahedra.voxels import PerVoxel

VERSION = 2  # of the files: what is in them, and how
SHAPES = tuple(
    name for name in get_args(ShapeName) if name not in ("letters", "sheet", "terrain")
)  # closed, of no text
WHAT = (
    "a body comes from a .obj, .stl or .ply mesh (or .off, .glb, .gltf, .mesh, .msh), a file of tetrahedra (.msh, .mesh, "
    ".vtk, .ele, .node, .npz), or is one of "
)
_in_use: WeakValueDictionary[tuple[str, float], CookedBody] = WeakValueDictionary()  # of the user's cache

Source = Shape | str | Path | TriangleMesh | tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Repair:
    """Preparation of a surface: with `unite` pieces that overlap become one; then at most `simplify` triangles are
    left (geometry/repair.py); `fill_holes`: its holes are closed."""

    unite: bool = False
    simplify: int | None = None
    fill_holes: bool = False

    @property
    def rebuilds(self) -> bool:
        """True if the triangles become others."""
        return self.unite or self.simplify is not None


def cooked(
    source: Source,
    *,
    edge: float | None = None,
    voxels: int | None = None,
    per_voxel: PerVoxel | Literal["conforming"] = 5,
    repair: Repair = Repair(),
    scale: float = 1.0,
    density: float = DENSITY,
    folder: Path | None = None,
    use_cache: bool = True,
) -> CookedBody:
    """Return the tetrahedral body of `source`, from the cache `folder` (the user's by default) if it is there.

    `source`: a closed mesh (a built-in shape, by name or as a Shape, a file, or the mesh itself), or a file of
    tetrahedra, which is taken as it is. `edge`, `voxels`, `per_voxel`: see `voxel_mesh`; "conforming": tetrahedra of
    that edge which follow the surface, closed or not, by `conforming_mesh`. Coordinates of files and shapes are multiplied
    by `scale`. The bits are the same with and without the cache, but for "conforming" bodies, which differ each time.

    `use_cache` False: neither read nor written. Raises SceneError (a parameter) and InputError (the mesh, the file),
    each with a remedy.
    """
    check_density(density)
    source = _named(source, scale)
    file_of_tetrahedra = Path(source) if isinstance(source, str | Path) and holds_tetrahedra(source) else None
    settled = file_of_tetrahedra is not None
    if settled and (edge is not None or voxels is not None):
        field, value = ("edge", edge) if edge is not None else ("voxels", voxels)
        raise SceneError(field, value, "a file of tetrahedra is used unchanged; leave it out")
    if settled and repair.rebuilds:
        raise SceneError(
            *(("--unite", True) if repair.unite else ("--simplify", repair.simplify)),
            "does not apply to a file of tetrahedra; leave it out",
        )

    def make() -> CookedBody:
        if file_of_tetrahedra is not None:
            return _body_of_file(file_of_tetrahedra, scale)
        mesh = _triangles(source, scale, raw=repair.unite or (per_voxel == "conforming" and not repair.rebuilds))
        try:
            if repair.rebuilds:
                mesh = _prepared(mesh, repair.unite, repair.simplify)
            if repair.fill_holes:
                mesh = filled(as_mesh(mesh, inside=True), inf)
            if per_voxel == "conforming":
                with work("filling the surface with tetrahedra, which can take minutes"):
                    return body_of_surface(mesh, edge, voxels)
            with work("cutting the body into voxels"):
                return body_of_voxels(mesh, edge, voxels, per_voxel)
        except InputError as error:
            raise InputError(f"{source}: {error}" if isinstance(source, str | Path) else str(error)) from None

    if not use_cache:
        return make().with_density(density)
    cut = f"{edge!r} {voxels!r} {per_voxel!r}" + (f" {repair.unite!r} {repair.simplify!r}" if repair.rebuilds else "")
    cut += " filled" if repair.fill_holes else ""
    key = body_key(source, scale, "as it is" if settled else cut)
    loaded = _in_use.get((key, density)) if folder is None else None
    if loaded is not None:
        return loaded
    file = (folder or cache_folder("tetrahedra")) / f"body-{key}.npz"
    body = load_or_make(file, key, _unpacked, make, _packed).with_density(density)
    if folder is None:
        _in_use[key, density] = body
    return body


def save(path: Path, body: CookedBody) -> None:
    """Write the body into `path` (.npz), whole or not at all. Raises InputError."""
    write_arrays(path, _packed(body))


def load(path: str | Path) -> CookedBody:
    """Return the body that `save` wrote, or the tetrahedra of any other .npz file. Raises InputError."""
    return _body_of_file(Path(path), 1.0)


def body_key(source: Source, scale: float, parameters: str) -> str:
    """Return 32 hexadecimal digits that identify the source (bytes of a file, fields of a shape, or the arrays), the
    parameters and the code. Raises InputError (a file that cannot be read)."""
    digest = hashlib.sha256(f"{VERSION} {_sources()} {parameters} {scale!r} ".encode())
    if isinstance(source, Shape):
        digest.update(b"shape " + source.model_dump_json().encode())
    elif isinstance(source, str | Path):
        for file in files_of(Path(source)):
            content = _bytes(file)
            digest.update(f"file {file.suffix.lower()} {len(content)} ".encode() + content)
    else:
        digest.update(mesh_bytes(source))
    return digest.hexdigest()[:32]


@cache
def _sources() -> str:
    return source_digest(ROOT / "model" / "geometry", Path(__file__), Path(tetrahedral_body.__file__))


def _bytes(file: Path) -> bytes:
    try:
        return check_source(file, WHAT + ", ".join(SHAPES)).read_bytes()
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from None


def _named(source: Source, scale: float) -> Source:
    """Return the shape of that name, unless there is a file of it. Raises SceneError (scale) and InputError."""
    if not (np.isfinite(scale) and scale > 0):
        raise SceneError("scale", scale, "must be a finite number greater than 0")
    if not isinstance(source, str | Path):
        return source
    name, suffix = str(source), Path(source).suffix.lower()
    if name in SHAPES:
        return Shape.model_validate({"name": name})
    if suffix not in FORMATS and suffix not in READERS:
        if name and not suffix and not is_there(source):
            raise InputError(f"{name}: no such shape; {WHAT}{', '.join(SHAPES)}")
        raise InputError(f"{name}: {WHAT}{', '.join(SHAPES)}")
    return source


def is_settled(source: Source) -> bool:
    """Return True for a file of tetrahedra, which are used unchanged."""
    return isinstance(source, str | Path) and holds_tetrahedra(source)


def _triangles(source: Source, scale: float, raw: bool) -> TriangleMesh | tuple[np.ndarray, np.ndarray]:
    """Return the mesh of `source`. With `raw` the triangles of a file are returned unchecked and unrepaired."""
    if isinstance(source, Shape):
        return source.model_copy(update={"scale": source.scale * scale}).mesh()
    if isinstance(source, str | Path):
        if raw:
            return read_arrays(source, scale)[:2]
        return read_mesh(source, scale, inside=True)
    return source


def _prepared(source: TriangleMesh | tuple[np.ndarray, np.ndarray], unite: bool, simplify: int | None) -> TriangleMesh:
    """Return the mesh united, then simplified, as wanted."""
    position, triangles = source if isinstance(source, tuple) else (source.position, source.triangles)
    if unite:
        mesh = united(np.asarray(position, dtype=np.float64), np.asarray(triangles, dtype=np.int64))
    else:
        mesh = triangle_mesh(position, triangles) if isinstance(source, tuple) else source
    return mesh if simplify is None else simplified(mesh, simplify)


def _body_of_file(path: Path, scale: float) -> CookedBody:
    """Return the body of a file of tetrahedra, which carry their own surface, or of one that `save` wrote. Raises
    InputError."""
    if path.suffix.lower() == ".npz":
        arrays = read_archive(path, "a body is a .npz file by softlab cook")
        if "report" in arrays:
            body = _unpacked(arrays)
            if body is None:
                raise InputError(f"{path} is incomplete or from another version; cook it again")
            return scaled(body, scale)
    return body_of_tetrahedra(*read_tetrahedra(path, scale))


def _packed(body: CookedBody) -> dict[str, np.ndarray]:
    """Return the body as arrays by name, without anything that needs pickling."""
    return {
        "version": np.array(VERSION),
        "report": np.array(json.dumps(asdict(body.report))),
        "position": body.mesh.position,
        "tetrahedra": body.mesh.tetrahedra,
        "voxel": body.voxel,
        "colour": body.colour,
        "starts": body.starts,
        "hull_position": body.hull_position,
        "hull_triangles": body.hull_triangles,
        "embedding_tetrahedron": body.embedding.tetrahedron,
        "embedding_weights": body.embedding.weights,
        "fractions": body.fractions,
    }


def _unpacked(arrays: dict[str, np.ndarray]) -> CookedBody | None:
    """Return the body of a file's arrays; None if they are incomplete or of another version."""
    try:
        if int(arrays["version"]) != VERSION:
            return None
        report_fields = json.loads(str(arrays["report"]))
        fields: dict[str, Any] = {
            name: tuple(one) if isinstance(one, list) else one for name, one in report_fields.items()
        }
        report = Report(**fields)
        mesh = TetrahedralMesh(arrays["position"], arrays["tetrahedra"])
        embedding = Embedding(arrays["embedding_tetrahedron"], arrays["embedding_weights"])
        voxel, colour, starts = arrays["voxel"], arrays["colour"], arrays["starts"]
        hull, triangles, fractions = arrays["hull_position"], arrays["hull_triangles"], arrays["fractions"]
        count, points = len(mesh.tetrahedra), len(hull)
        cells = count if report.voxels else 0
        whole = (
            (report.vertices, report.tetrahedra, report.points) == (len(mesh.position), count, points)
            and (voxel.shape, colour.shape) == ((cells, 3), (cells,))
            and starts.shape == ((report.voxels + 1) if report.voxels else 0,)
            and (not cells or (starts[0] == 0 and starts[-1] == cells and bool((np.diff(starts) > 0).all())))
            and hull.shape == (points, 3)
            and embedding.tetrahedron.shape == (points,)
            and embedding.weights.shape == (points, 4)
            and fractions.shape == (count, 4)
            and bool(np.isfinite(fractions).all() and (fractions > 0).all())
            and bool(np.isfinite(hull).all() and np.isfinite(embedding.weights).all())
            and (triangles.ndim, triangles.shape[1]) == (2, 3)
            and all(array.dtype == np.int32 for array in (voxel, colour, starts, triangles, embedding.tetrahedron))
            and 0 <= embedding.tetrahedron.min() <= embedding.tetrahedron.max() < count
            and 0 <= triangles.min() <= triangles.max() < points
        )
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, SoftlabError):
        return None
    return CookedBody(mesh, voxel, colour, starts, hull, triangles, embedding, report, fractions) if whole else None
