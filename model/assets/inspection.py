"""Contents of a mesh file and the roles that it can be used in: `softlab inspect`."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from softlab.model.base.errors import InputError, SoftlabError
from softlab.model.base.waiting import report
from softlab.model.geometry.arithmetic.ordered import norm, total
from softlab.model.geometry.edges import NonManifold, components, edge_uses
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.mending.holes import rims, width
from softlab.model.geometry.mending.welding import many, welded
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh
from softlab.model.geometry.mesh_files import READERS as SURFACES
from softlab.model.geometry.mesh_files import read_arrays
from softlab.model.geometry.solid import Solid, solid
from softlab.model.geometry.tetrahedra.files import holds_tetrahedra, read_tetrahedra

T = TypeVar("T")
METRES = (".glb", ".gltf")  # formats whose unit is the metre
LARGEST_IN_METRES, LARGEST_IN_CENTIMETRES, LARGEST_IN_MILLIMETRES = 20.0, 250.0, 20_000.0  # longest sides, guessed
LARGEST_PART = 3.0  # longest side of an STL, which CAD programs write in mm, that is taken for metres
LARGEST_IN_INCHES = 100.0  # longest side of an STL that may be in inches
NOTHING = 1e-9  # of the area: rounding
HALF = 0.5  # of the area: where less than it bounds a volume, a note says so
FAR = 1e3  # sizes from the origin: float32 keeps 1e-4 of the size there
BODIES = ("soft_body", "rigid_body", "tetrahedral_body", "distance_field")  # roles that need an inside
INSPECTING = "inspecting the mesh"  # shown while it takes long
FILLED = "with fill_holes"
SURFACE_ROLES = ("cloth", "soft_body", "rigid_body", "tetrahedral_body", "tetrahedral_body_conforming", "mesh_collider",
                 "distance_field")  # fmt: skip


@dataclass(frozen=True)
class Inspection:
    """A mesh file. Lengths in m: the file's unit times `scale`. Counts, sizes and area are those of all of its triangles.

    `volume` [m^3]: None where the mesh encloses none; `filled_volume` [m^3]: with all holes closed (`fill_holes = true`),
    None where it has none, or no volume then either; `widest_rim` [m]: the diagonal of the box around the widest rim, 0 of
    slits; `non_manifold_edges`: of more than two triangles; `unit`: a guess, and `unit_scale` [m] the scale that goes with
    it, None where none can be guessed; `repairs`: sentences; `roles`: by name, "" where the file fits, else the reason why
    not; `notes`: what to mind.
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
    filled_volume: float | None
    pieces: int
    rims: int
    widest_rim: float
    non_manifold_edges: int
    unit: str
    unit_scale: float | None
    repairs: tuple[str, ...]
    roles: dict[str, str]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Return the fields for JSON: of each role whether it `fits` and the `reason` why not; which roles the file
        `fits_with_fill_holes`."""
        roles = {name: {"fits": not reason, "reason": reason} for name, reason in self.roles.items()}
        return asdict(self) | {"roles": roles, "fits_with_fill_holes": self._filled()}

    def lines(self) -> list[str]:
        """Return the report as lines of text."""
        tetrahedra = f", {many(self.tetrahedra, 'tetrahedron', 'tetrahedra')}" if self.tetrahedra else ""
        widest = f"the widest {self.widest_rim:.4g} m across" if self.widest_rim else "slits without a width"
        closed = f"{many(self.rims, 'rim')}, {widest}" if self.rims else "closed"
        fins = (
            f", {many(self.non_manifold_edges, 'edge')} of more than two triangles" if self.non_manifold_edges else ""
        )
        volume = "none" if self.volume is None else f"{self.volume:.6g} m^3"
        reasons: dict[str, list[str]] = {}
        for name, reason in self.roles.items():
            if reason and name in self._filled():
                reason = FILLED
            reasons.setdefault(reason, []).append(name.replace("_conforming", ' (tetrahedra = "conforming")'))
        return [
            f"{many(self.vertices, 'vertex', 'vertices')}, {many(self.triangles, 'triangle')}{tetrahedra}, "
            f"{many(self.pieces, 'piece')}",
            f"size {_size(self.size)}{self._guessed_size()}, from ({_point(self.low)}) to ({_point(self.high)})",
            f"area {self.area:.6g} m^2, volume {volume}; {closed}{fins}",
            f"unit: {self.unit}",
            *(f"note: {note}" for note in self.notes),
            *(f"repair: {repair}" for repair in self.repairs),
            *(f"fits {', '.join(names)}" for reason, names in reasons.items() if not reason),
            *(
                f"fits {', '.join(names)} with fill_holes = true, which closes {many(self.rims, 'hole')} (volume "
                f"{self.filled_volume:.6g} m^3)"
                for reason, names in reasons.items()
                if reason == FILLED
            ),
            *(
                f"does not fit {', '.join(names)}: {reason}"
                for reason, names in reasons.items()
                if reason not in ("", FILLED)
            ),
        ]

    def _filled(self) -> tuple[str, ...]:
        """Return the roles that the file fits with its holes filled."""
        return () if self.filled_volume is None else tuple(name for name in BODIES if self.roles[name])

    def _guessed_size(self) -> str:
        """Return the size with the guessed scale, if that is not 1."""
        if self.scale != 1 or self.unit_scale in (None, 1.0):
            return ""
        sides = tuple(side * self.unit_scale for side in self.size)
        return f" as it is ({_size(sides)} with scale = {self.unit_scale:g})"


def _size(sides: tuple[float, ...]) -> str:
    return " x ".join(f"{side:.4g}" for side in sides) + " m"


def _point(place: tuple[float, ...]) -> str:
    return ", ".join(f"{x:.4g}" for x in place)


def inspected(path: str | Path, scale: float = 1.0) -> Inspection:
    """Return the content of the file. Raises InputError (a file that no role can read) and SceneError (scale)."""
    path = Path(path)
    if holds_tetrahedra(path) and path.suffix.lower() not in SURFACES:
        return _of_tetrahedra(path, scale)
    arrays = read_arrays(path, scale)
    notes = list(arrays.notes)
    roles = dict.fromkeys(SURFACE_ROLES, "")
    try:
        _, triangles = welded(arrays.position, arrays.triangles, notes)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    report(INSPECTING, 0.2)
    fins = int((edge_uses(len(arrays.position), triangles)[1] > 2).sum())
    mesh, roles["cloth"] = _tried(lambda: triangle_mesh(*arrays[:2], list(arrays.notes)))
    inner, reason = (mesh, roles["cloth"])
    if mesh is None:
        inner, reason = _tried(lambda: triangle_mesh(*arrays[:2], list(arrays.notes), inside=True))
    report(INSPECTING, 0.5)
    body, filled = None, None
    if inner is not None:
        body, reason = _tried(lambda: solid(inner, 0.0))
        if body is None and inner.boundary_loops:
            filled, without = _tried(lambda: solid(inner, 0.0, fill_holes=True))
            reason = without or reason
    roles |= dict.fromkeys(BODIES, reason)
    if importlib.util.find_spec("wildmeshing") is None:
        roles["tetrahedral_body_conforming"] = 'wildmeshing is not installed: pip install -e ".[tets]"'
    tetrahedra = 0
    if holds_tetrahedra(path):
        whole, roles["tetrahedral_body"] = _tried(lambda: read_tetrahedra(path, scale))
        tetrahedra = len(whole[0].tetrahedra) if whole else 0
    report(INSPECTING, 1.0)
    repairs = body.notes if body else inner.repairs if inner else tuple(notes)
    surface = mesh or (arrays.position, triangles)
    return _inspection(path, scale, surface, inner, (body, filled), fins, tetrahedra, tuple(repairs), roles)


def _tried(make: Callable[[], T]) -> tuple[T | None, str]:
    """Return (the result, "") or (None, the reason why there is none)."""
    try:
        return make(), ""
    except NonManifold as error:
        return None, str(error).split("; a cloth needs")[0] + "; a cloth needs two at most"
    except SoftlabError as error:
        return None, str(error)


def _inspection(
    path: Path, scale: float, surface: TriangleMesh | tuple[np.ndarray, np.ndarray], inner: TriangleMesh | None,
    bodies: tuple[Solid | None, Solid | None], fins: int, tetrahedra: int, repairs: tuple[str, ...], roles: dict[str, str],
) -> Inspection:  # fmt: skip
    """`surface`: all triangles of the file; `inner`: those that bound a volume; `bodies`: without and with filled holes."""
    position, triangles = surface if isinstance(surface, tuple) else (surface.position, surface.triangles)
    corners = position[np.unique(triangles)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    size, area = high - low, total(triangle_areas(position, triangles))
    bounding = area if inner is None else total(triangle_areas(inner.position, inner.triangles))
    mesh = inner if bounding > (1 - NOTHING) * area else None  # nothing was left out of it
    pieces, loops = _connected(position, triangles, mesh)
    points = position if mesh is None else mesh.position
    widest = max((width(points, loop) for loop in loops), default=0.0)
    guess, guessed_scale = guessed_unit(path, float(size.max()) / scale, scale)
    volume, filled_volume = (None if body is None else body.volume for body in bodies)
    return Inspection(
        str(path), scale, len(corners), len(triangles), tetrahedra, _three(size), _three(low), _three(high), area, volume,
        filled_volume, pieces, len(loops), widest, fins, guess,
        guessed_scale, repairs, roles, tuple(_notes(low, high, bounding / area)),
    )  # fmt: skip


def _connected(position: np.ndarray, triangles: np.ndarray, mesh: TriangleMesh | None) -> tuple[int, list[np.ndarray]]:
    """Return (pieces, rims: vertices of each) of `mesh`, or of triangles that are none, where rims that share a vertex are
    one."""
    if mesh is not None:
        return mesh.pieces, rims(mesh.triangles, mesh.edges.boundary[mesh.edges.sides])
    ends, uses = edge_uses(len(position), triangles)
    label = components(len(position), ends[uses == 1])
    vertices = np.unique(ends[uses == 1])
    groups = [vertices[label[vertices] == one] for one in np.unique(label[vertices])]
    return len(np.unique(components(len(position), ends)[triangles])), groups


def _notes(low: np.ndarray, high: np.ndarray, bounding: float) -> Iterator[str]:
    """Yield what to mind; `bounding`: fraction of the area that bounds a volume."""
    middle, longest = float(norm((low + high) / 2)), float((high - low).max())
    if middle > FAR * longest:
        yield (
            f"it lies {middle:.3g} m from its origin, {middle / longest:.3g} times its size: move it to the origin "
            "in the program that made it, or float32 loses its shape"
        )
    if bounding < HALF:
        yield (
            f"only {100 * bounding:.2g} % of its area bounds a volume, which is what a body would be made of: give the "
            "sheets a thickness (Blender: Solidify), or make it a mesh_collider"
        )


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in vector)
    return x, y, z


def _of_tetrahedra(path: Path, scale: float) -> Inspection:
    """Return the inspection of a file of tetrahedra whose surface no other role reads."""
    mesh, notes = read_tetrahedra(path, scale)
    surface = triangle_mesh(mesh.position, mesh.surface, inside=True)
    roles = dict.fromkeys(
        SURFACE_ROLES, f"{path.suffix} is read as tetrahedra alone; convert it to .ply, .mesh or .msh"
    )
    roles["tetrahedral_body"] = ""
    body, _ = _tried(lambda: solid(surface, 0.0))
    return _inspection(path, scale, surface, surface, (body, None), 0, len(mesh.tetrahedra), notes, roles)


def guessed_unit(path: Path, longest: float, scale: float) -> tuple[str, float | None]:
    """Return a guess of the file's unit by its longest side, in that unit, and the scale [m] that goes with it:
    simulated objects are usually 1 mm to 20 m long."""
    if scale != 1:
        return f"given by the scale: {scale:g} m", scale
    suffix = path.suffix.lower()
    lengths = f"the longest side is {longest:.4g}"
    if suffix in METRES:
        large = f" ({lengths}; if that is too large, its program meant mm: scale = 0.001)"
        return f"m, as {suffix} has it{large if longest > LARGEST_IN_METRES else ''}", 1.0
    part = suffix == ".stl"
    if longest < 1e-3:
        return f"probably m ({lengths}; if that is too small, give a scale)", 1.0
    if longest <= (LARGEST_PART if part else LARGEST_IN_METRES):
        hint = f"; if it is a CAD part in mm: scale = 0.001{_inches(longest) if part else ''}" if longest >= 1 else ""
        return f"probably m ({lengths}){hint}", 1.0
    if longest <= LARGEST_IN_CENTIMETRES and not part:
        return f"probably cm ({lengths}): scale = 0.01; or, as most CAD parts, mm: scale = 0.001", 0.01
    if longest <= LARGEST_IN_MILLIMETRES:
        return f"probably mm ({lengths}): scale = 0.001{_inches(longest) if part else ''}", 1e-3
    return f"unknown ({lengths}): give the scale that makes it the size it has in m", None


def _inches(longest: float) -> str:
    return ", or in inches: scale = 0.0254" if longest <= LARGEST_IN_INCHES else ""
