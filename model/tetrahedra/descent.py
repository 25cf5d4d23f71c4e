"""Tables of vertex block descent: the free vertices of each material, by colour, and their tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.formulas.elastic import chebyshev, descent
from softlab.model.geometry.lists import grouped, offsets_of
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.position_based.mesh_plan import PROJECT_CONTACTS, constrained_plan
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS
from softlab.model.tetrahedra.constraints import DAMPED, tetrahedra_parts
from softlab.model.tetrahedra.material import material_of, stiffnesses
from softlab.model.tetrahedra.springs import PARTS, springs, supported_particles

CORNERS = 4
CHEBYSHEV = "chebyshev"  # a part of a plan
STRAIN, START, DESCEND, ACCELERATE = (
    "strain",
    "start",
    "descend",
    "accelerate",
)  # stages, all but the last of a material
SCALE, RATE = "elastic_scale", "inverse_substep"  # of the record: h^2 / m, 1 / h
_known: WeakKeyDictionary[TetrahedraSet, tuple[Descent, ...]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Descent:
    """The vertices and tetrahedra of one material.

    `order` (vertices,) int32: particles, of colour c from `starts[c]` to before `starts[c + 1]`, ascending; pinned ones
    after the last colour. Vertex k of them is a corner of the tetrahedra `entries[offsets[k]:offsets[k + 1]]`, each 4 x
    the tetrahedron + its corner, ascending; none for a pinned one. `falls` (vertices,) int32: 1 in a body without pins
    or attachments. `corners` (tetrahedra, 4) int32: particles; `values` (tetrahedra, COUNT) float64, as the formula
    takes them.
    """

    material: str
    order: np.ndarray
    starts: np.ndarray
    offsets: np.ndarray
    entries: np.ndarray
    falls: np.ndarray
    corners: np.ndarray
    values: np.ndarray

    def some(self, particles: np.ndarray) -> Descent:
        """Return the tables of `particles` (n,), ascending, renumbered from 0, and of the tetrahedra with only these
        corners."""
        here = np.isin(self.order, particles)
        inside = np.flatnonzero(np.isin(self.corners, particles).all(axis=1))
        vertex = np.repeat(np.arange(len(self.order)), np.diff(self.offsets))
        selected = here[vertex] & np.isin(self.entries // CORNERS, inside)
        entries, before = self.entries[selected], np.concatenate([[0], np.cumsum(here)])
        return replace(
            self,
            order=np.searchsorted(particles, self.order[here]).astype(np.int32),
            starts=np.unique(before[self.starts]).astype(np.int32),
            offsets=offsets_of(np.bincount(vertex[selected], minlength=len(self.order))[here]),
            entries=(CORNERS * np.searchsorted(inside, entries // CORNERS) + entries % CORNERS).astype(np.int32),
            falls=self.falls[here],
            corners=np.searchsorted(particles, self.corners[inside]).astype(np.int32),
            values=self.values[inside],
        )

    @property
    def colours(self) -> int:
        """Number of colours."""
        return len(self.starts) - 1

    @property
    def free(self) -> int:
        """Number of free vertices."""
        return int(self.starts[-1])

    @property
    def number(self) -> int:
        """Index of the material."""
        return MATERIALS.index(self.material)


def descents(scene: Scene) -> tuple[Descent, ...]:
    """Return the tables of each material of the scene, in the order of MATERIALS, cached with the bodies."""
    return _descents(scene.tetrahedra_set)


def _descents(body_set: TetrahedraSet) -> tuple[Descent, ...]:
    """Return the tables; for a part those of the whole set, in its colours and order."""
    if body_set not in _known and body_set.whole is not None:
        some = (one.some(body_set.of_whole[0]) for one in _descents(body_set.whole))
        _known[body_set] = tuple(one for one in some if len(one.corners))
    elif body_set not in _known:
        materials = material_of(body_set)
        together = np.concatenate([body_set.tetrahedra, springs(body_set, "vbd").fours])
        colours = vertex_colours(together, body_set.particle_count)
        _known[body_set] = tuple(
            _of_material(body_set, colours, np.flatnonzero(materials == kind)) for kind in np.unique(materials)
        )
    return _known[body_set]


def _of_material(body_set: TetrahedraSet, colours: np.ndarray, chosen: np.ndarray) -> Descent:
    """Return the tables of the `chosen` tetrahedra (n,), ascending, with the `colours` of all vertices; larger colours
    first."""
    corners = np.ascontiguousarray(body_set.tetrahedra[chosen])
    here = np.unique(corners)
    pinned = np.isin(here, body_set.pinned_vertices)
    free, fixed = here[~pinned], here[pinned]
    sizes = np.bincount(colours[free])
    rank = np.empty(len(sizes), np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    free = free[np.argsort(rank[colours[free]], kind="stable")]
    order = np.concatenate([free, fixed]).astype(np.int32)
    place = np.full(body_set.particle_count, len(order), np.int64)
    place[free] = np.arange(len(free))
    at = grouped(place[corners.ravel()], np.arange(corners.size), len(order) + 1)
    offsets = at.offsets[: len(order) + 1]
    sizes = np.sort(sizes[sizes > 0])[::-1]
    values = descent_values(body_set, chosen)
    material = body_set.parts[body_set.body[chosen[0]]].material
    falls = (~supported_particles(body_set)[order]).astype(np.int32)
    return Descent(material, order, offsets_of(sizes), offsets, at.indices[: offsets[-1]], falls, corners, values)


def descent_values(body_set: TetrahedraSet, chosen: np.ndarray) -> np.ndarray:
    """Return the values of the two constraints, (n, COUNT) float64, with stiffnesses in place of compliances."""
    values = np.column_stack([body_set.rest_inverse[chosen].reshape(-1, 9), stiffnesses(body_set, chosen)])
    assert values.shape[1] == descent.COUNT
    return values


def vertex_colours(tetrahedra: np.ndarray, count: int) -> np.ndarray:
    """Return colours of which no two vertices share one of `tetrahedra` (n, 4), (count,) int64; 0 for vertices in none.

    In the order of decreasing numbers of neighbours, each vertex takes the lowest free colour (D. J. A. Welsh, M. B.
    Powell, "An upper bound for the chromatic number of a graph", Comput. J. 10 (1967)); of equal ones the first comes
    first.
    """
    near = neighbours(tetrahedra, count)
    offsets, others = near.offsets.tolist(), near.indices.tolist()
    bits = [0] * count  # 1 << its colour, 0 without
    colours = np.zeros(count, np.int64)
    for vertex in np.argsort(-near.lengths, kind="stable").tolist():
        taken = 0
        for other in others[offsets[vertex] : offsets[vertex + 1]]:
            taken |= bits[other]
        bits[vertex] = ~taken & (taken + 1)
        colours[vertex] = bits[vertex].bit_length() - 1
    return colours


def visited(parts: frozenset[str]) -> frozenset[str]:
    """Return the parts of a plan on which a visit depends."""
    return parts & (PARTS | frozenset(COLLIDER_KINDS) | {"friction", "restitution"})


def stage_name(work: str, material: str, colour: int | None = None) -> str:
    """Return the name of a plan's stage: STRAIN, START or DESCEND of a material."""
    return f"{work} {material}" + ("" if colour is None else f" {colour}")


def vbd_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan: substeps and iterations as in model/position_based/plan.py.

    A substep has the prediction, the initial strains for dampers and the starting points of vertices; an iteration the
    vertices of each material, colour by colour.
    """
    accelerated = {CHEBYSHEV} if scene.method.chebyshev > 0 else set()
    parts = tetrahedra_parts(scene, live) | accelerated
    bare, method, particles = constrained_plan(scene, parts, []), scene.method, scene.grid.particle_count
    damped, item = DAMPED in parts, np.dtype(np.float32).itemsize
    begin: list[Stage] = []
    colours: list[Stage] = []
    for table in descents(scene):
        each = descent.operations(table.number, item, damped)
        each += descent.OPERATIONS_TURNING * (table.material == "corotated")
        if damped:
            begin.append(Stage(stage_name(STRAIN, table.material), 1, 2, round(each * len(table.corners) / particles)))
        begin.append(Stage(stage_name(START, table.material), 3, 1, descent.OPERATIONS_START))
        for colour in range(table.colours):
            first, last = table.starts[colour], table.starts[colour + 1]
            visits = table.offsets[last] - table.offsets[first]
            operations = (each * visits + descent.OPERATIONS_MOVE * (last - first)) / particles
            colours.append(Stage(stage_name(DESCEND, table.material, colour), 2, 1, round(float(operations))))
    (predict, *rest), sweep, end = bare.substep_parts
    if accelerated:
        colours.append(Stage(ACCELERATE, 3, 3, 3 * chebyshev.OPERATIONS))
    colours += [one for one in sweep if isinstance(one, Stage) and one.name == PROJECT_CONTACTS]
    steps = predict, *begin, *rest, Node("iteration", tuple(colours), method.iterations), *end
    return Plan(Node("step", (Node("substep", steps, method.substeps),)), bare.fused_scalars, parts, dimensions=3)
