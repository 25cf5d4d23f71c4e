"""What a mesh file holds and what it can be used as: `softlab inspect`."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model.core.errors import InputError, SoftlabError
from model.geometry.arithmetic.ordered import norm, total
from model.geometry.edges import NonManifold, edge_uses
from model.geometry.measures import triangle_areas
from model.geometry.mending.holes import rims, width
from model.geometry.mending.welding import many, welded, without_flat
from model.geometry.mesh import TriangleMesh, triangle_mesh
from model.geometry.mesh_files import READERS as SURFACES
from model.geometry.mesh_files import MeshArrays, read_arrays
from model.geometry.solid import Solid, solid
from model.geometry.tetrahedra.files import holds_tetrahedra, read_tetrahedra

METRES = (".glb", ".gltf")  # formats whose unit is the metre
LARGEST_IN_METRES, LARGEST_IN_CENTIMETRES, LARGEST_IN_MILLIMETRES = 20.0, 250.0, 20_000.0  # longest sides, guessed
LARGEST_PART = 3.0  # longest side of an STL, which CAD programs write in mm, that is taken for metres
FAR = 1e3  # sizes from the origin: float32 keeps 1e-4 of the size there
SURFACE_ROLES = ("cloth", "soft_body", "rigid_body", "tetrahedral_body", "tetrahedral_body_conforming", "mesh_collider",
                 "distance_field")  # fmt: skip


@dataclass(frozen=True)
class Inspection:
    """A mesh file. Lengths in m: the file's unit times `scale`.

    `volume` [m^3]: None where the mesh encloses none; `widest_rim` [m]: the diagonal of the box around the widest rim;
    `non_manifold_edges`: of more than two triangles; `unit`: a guess; `repairs`: sentences; `roles`: by name, "" where the
    file fits, else the reason why not; `notes`: what to mind.
    """

    file: str
    scale: float
    vertices: int
    triangles: int
    tetrahedra: int
    size: tuple[float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    area: float
    volume: float | None
    pieces: int | None
    rims: int
    widest_rim: float
    non_manifold_edges: int
    unit: str
    repairs: tuple[str, ...]
    roles: dict[str, str]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON: of each role whether it `fits` and the `reason` why not."""
        roles = {name: {"fits": not reason, "reason": reason} for name, reason in self.roles.items()}
        return asdict(self) | {"roles": roles}

    def lines(self) -> list[str]:
        """Return what a user reads."""
        tetrahedra = f", {many(self.tetrahedra, 'tetrahedron', 'tetrahedra')}" if self.tetrahedra else ""
        pieces = "" if self.pieces is None else f", {many(self.pieces, 'piece')}"
        closed = "closed" if not self.rims else f"{many(self.rims, 'rim')}, the widest {self.widest_rim:.4g} m across"
        fins = (
            f", {many(self.non_manifold_edges, 'edge')} of more than two triangles" if self.non_manifold_edges else ""
        )
        volume = "none" if self.volume is None else f"{self.volume:.6g} m^3"
        reasons: dict[str, list[str]] = {}
        for name, reason in self.roles.items():
            reasons.setdefault(reason, []).append(name.replace("_conforming", ' (tetrahedra = "conforming")'))
        return [
            f"{many(self.vertices, 'vertex', 'vertices')}, {many(self.triangles, 'triangle')}{tetrahedra}{pieces}",
            f"size {' x '.join(f'{x:.4g}' for x in self.size)} m, from ({_point(self.low)}) to ({_point(self.high)})",
            f"area {self.area:.6g} m^2, volume {volume}; {closed}{fins}",
            f"unit: {self.unit}",
            *(f"note: {note}" for note in self.notes),
            *(f"repair: {repair}" for repair in self.repairs),
            *(f"fits {', '.join(names)}" for reason, names in reasons.items() if not reason),
            *(f"does not fit {', '.join(names)}: {reason}" for reason, names in reasons.items() if reason),
        ]


def _point(place: tuple[float, ...]) -> str:
    return ", ".join(f"{x:.4g}" for x in place)


def inspected(path: str | Path, scale: float = 1.0) -> Inspection:
    """Return what the file holds. Raises InputError (a file that no role can read) and SceneError (scale)."""
    path = Path(path)
    if holds_tetrahedra(path) and path.suffix.lower() not in SURFACES:
        return _of_tetrahedra(path, scale)
    arrays = read_arrays(path, scale)
    told = list(arrays.notes)
    roles = dict.fromkeys(SURFACE_ROLES, "")
    try:
        _, welded_triangles = welded(arrays.position, arrays.triangles, told)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    fins = int((edge_uses(len(arrays.position), welded_triangles)[1] > 2).sum())
    mesh, roles["cloth"] = _tried(lambda: triangle_mesh(*arrays[:2], list(arrays.notes)))
    inner, reason = (mesh, roles["cloth"])
    if mesh is None:
        inner, reason = _tried(lambda: triangle_mesh(*arrays[:2], list(arrays.notes), inside=True))
    body: Solid | None = None
    if inner is not None:
        body, reason = _tried(lambda: solid(inner, 0.0))
    for name in ("soft_body", "rigid_body", "tetrahedral_body", "distance_field"):
        roles[name] = reason
    if importlib.util.find_spec("wildmeshing") is None:
        roles["tetrahedral_body_conforming"] = 'wildmeshing is not installed: pip install -e ".[tets]"'
    tetrahedra = 0
    if holds_tetrahedra(path):
        whole, roles["tetrahedral_body"] = _tried(lambda: read_tetrahedra(path, scale))
        tetrahedra = len(whole[0].tetrahedra) if whole else 0
    shown = inner or mesh
    repairs = body.told if body else shown.repairs if shown else tuple(told)
    return _made(path, scale, arrays, shown, body, fins, tetrahedra, tuple(repairs), roles)


def _tried(make: Callable[[], Any]) -> tuple[Any, str]:
    """Return (what was made, "") or (None, the reason why not)."""
    try:
        return make(), ""
    except NonManifold as error:
        return None, str(error).split("; a cloth needs")[0] + "; a cloth needs two at most"
    except SoftlabError as error:
        return None, str(error)


def _made(
    path: Path, scale: float, arrays: MeshArrays, mesh: TriangleMesh | None, body: Solid | None, fins: int, tetrahedra: int,
    repairs: tuple[str, ...], roles: dict[str, str],
) -> Inspection:  # fmt: skip
    position = arrays.position if mesh is None else mesh.position
    triangles = without_flat(arrays.position, arrays.triangles, []) if mesh is None else mesh.triangles
    loops = [] if mesh is None else rims(mesh.triangles, mesh.edges.boundary[mesh.edges.sides])
    corners = position[np.unique(triangles)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = high - low
    notes = []
    middle = float(norm((low + high) / 2))
    if middle > FAR * float(size.max()):
        notes.append(
            f"it lies {middle:.3g} m from its origin, {middle / float(size.max()):.3g} times its size: move it to the origin "
            "in the program that made it, or float32 loses its shape"
        )
    return Inspection(
        str(path), scale, len(corners), len(triangles), tetrahedra, _three(size), _three(low), _three(high),
        total(triangle_areas(position, triangles)), body.volume if body else None, mesh.pieces if mesh else None, len(loops),
        max((width(position, loop) for loop in loops), default=0.0), fins, unit(path, float(size.max()) / scale, scale),
        repairs, roles, tuple(notes),
    )  # fmt: skip


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in vector)
    return x, y, z


def _of_tetrahedra(path: Path, scale: float) -> Inspection:
    """Return the inspection of a file of tetrahedra whose surface no other role reads."""
    mesh, told = read_tetrahedra(path, scale)
    surface = triangle_mesh(mesh.position, mesh.surface, inside=True)
    arrays = MeshArrays(mesh.position, mesh.surface.astype(np.int64), told)
    roles = dict.fromkeys(
        SURFACE_ROLES, f"{path.suffix} is read as tetrahedra alone; convert it to .ply, .mesh or .msh"
    )
    roles["tetrahedral_body"] = ""
    body, _ = _tried(lambda: solid(surface, 0.0))
    return _made(path, scale, arrays, surface, body, 0, len(mesh.tetrahedra), told, roles)


def unit(path: Path, longest: float, scale: float) -> str:
    """Return a guess of the file's unit by its longest side, in that unit: what people simulate is 1 mm to 20 m long."""
    if scale != 1:
        return f"given by the scale: {scale:g} m"
    suffix = path.suffix.lower()
    if suffix in METRES:
        return f"m, as {suffix} has it"
    lengths = f"the longest side is {longest:.4g}"
    if longest <= (LARGEST_PART if suffix == ".stl" else LARGEST_IN_METRES):
        small = "; if that is too small, give a scale" if longest < 1e-3 else ""
        return f"probably m ({lengths}{small})"
    if longest <= LARGEST_IN_CENTIMETRES and suffix != ".stl":
        return f"probably cm ({lengths}): scale = 0.01; or mm: scale = 0.001"
    if longest <= LARGEST_IN_MILLIMETRES:
        return f"probably mm ({lengths}): scale = 0.001"
    return f"unknown ({lengths}): give the scale that makes it the size it has in m"
