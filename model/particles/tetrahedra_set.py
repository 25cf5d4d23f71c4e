"""All tetrahedral bodies of a scene, and its cloth, as one set of particles: the initial state of its solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.memory import MAX_PARTICLES, available_bytes, require
from softlab.model.geometry.arithmetic.ordered import mean, total
from softlab.model.geometry.lists import Lists, grouped
from softlab.model.geometry.measures import edge_lengths
from softlab.model.geometry.normals import mesh_normals
from softlab.model.geometry.particle_row import ParticleRow
from softlab.model.geometry.tetrahedra.mesh import rest_inverse
from softlab.model.particles.tetrahedra.matter import Matter, joined
from softlab.model.particles.tetrahedra.placed import PlacedBody, placed_body
from softlab.model.particles.tetrahedra.sheet import Sheet, sheet_of
from softlab.model.particles.tetrahedra.skin import Skin, plain_skin, skin_of
from softlab.model.particles.tetrahedra.topology import PAIRS
from softlab.model.tables.attachment import Attachment, pins
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.motion import Motion
from softlab.model.tables.regions import Region
from softlab.model.tables.selection import body_numbers, check_word, motion_numbers, vertices_of
from softlab.model.tables.tetrahedra import Material, TetrahedralBody

ELEMENT_BYTES = (
    400  # on the host, per tetrahedron: corners, values in float64 and in the kernels' arithmetic, multipliers
)
NO_REGIONS: Mapping[str, Region] = {}
NO_ATTACHMENTS: Mapping[str, Attachment] = {}
ONE_MATERIAL: Mapping[str, Material] = {}
NO_CLOTH: Mapping[str, Mesh] = {}
NONE = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class TetrahedraSet(ParticleRow):
    """The particles and tetrahedra of all bodies, one body after the other, in the order of the file; then the vertices
    of the scene's cloth, if it has one.

    `position`, `velocity` (particles, 3) float64 [m], [m/s] at the start, without strain; `masses` (particles,) [kg];
    `pinned_vertices`, ascending; `body` (tetrahedra,) int32: index into `parts`; `tetrahedra` (tetrahedra, 4) int32;
    `names`: of the bodies, and of the cloth; `mesh_position` (particles, 3) [m]: positions in the meshes' coordinates,
    neither rotated nor moved; `matter`; `regions`, `attachments`: of the scene; `rest_inverse` (tetrahedra, 3, 3):
    inverse of the matrix with the edges from the first corner as columns; `volume` (tetrahedra,) [m^3]: of the part of
    each within the body's surface, which scales its mass and stiffness, and `fraction` (tetrahedra,): that over all of
    it; `surface` (triangles, 3) int32, the cloth's last; `first_particle`: of each of `names`; `skin`; `voxel`
    (tetrahedra, 3) int32: the place of each one's voxel in its body, along the longest side first, 0 without a voxel;
    `run` (tetrahedra,) int32: the number of tetrahedra of its voxel, which are consecutive, 1 without a voxel; `sheet`:
    the cloth; `whole`: the set of which this is a part (model/tetrahedra/apart.py), or None; `of_whole`: its particles
    and tetrahedra in that set, both ascending int64. It has the attributes of a row of masses: `rows` 1, `columns` the
    number of particles, `spacing` the mean edge [m], `mass` the mean one.
    """

    names: tuple[str, ...]
    parts: tuple[TetrahedralBody, ...]
    position: np.ndarray
    velocity: np.ndarray
    masses: np.ndarray
    pinned_vertices: np.ndarray
    body: np.ndarray
    tetrahedra: np.ndarray
    rest_inverse: np.ndarray
    volume: np.ndarray
    fraction: np.ndarray
    surface: np.ndarray
    first_particle: np.ndarray
    skin: Skin
    voxel: np.ndarray
    run: np.ndarray
    mesh_position: np.ndarray
    matter: Matter
    regions: Mapping[str, Region] = field(default_factory=dict)
    attachments: Mapping[str, Attachment] = field(default_factory=dict)
    sheet: Sheet | None = None
    whole: TetrahedraSet | None = None
    of_whole: tuple[np.ndarray, np.ndarray] = (NONE, NONE)

    def triangles(self) -> np.ndarray:
        """Return the triangles of the bodies' surfaces, counter-clockwise from outside, and the cloth's."""
        return self.surface.astype(np.uint32)

    def normals(self, position: np.ndarray) -> np.ndarray:
        """Return the unit normals of the particles at `position` (particles, 3), (particles, 3) float64."""
        return mesh_normals(position, self.triangles())

    @property
    def alike(self) -> TetrahedraSet:
        """The set that decides which code the bodies need: that of the whole scene, so that every part runs the same
        code."""
        return self.whole or self

    @property
    def pinned(self) -> str:
        """`sides` where some particle is pinned, else `none`."""
        return "sides" if len(self.alike.pinned_vertices) else "none"

    @cached_property
    def mass(self) -> float:
        """Mean mass of a particle [kg]."""
        return mean(self.masses)

    @property
    def lightest(self) -> float:
        """Smallest mass of a particle that moves [kg]; the mean mass if none moves."""
        free = np.delete(self.masses, self.pinned_vertices)
        return float(free.min()) if len(free) else self.mass

    def mass_of(self, name: str) -> float:
        """Return the mass of the body, or cloth, of that name [kg]."""
        ends, number = [*self.first_particle, self.particle_count], self.names.index(name)
        return float(total(self.masses[ends[number] : ends[number + 1]]))

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (ends (edges, 2) int32, the lower one first, rows ascending; lengths at rest (edges,) [m])."""
        ends = np.concatenate([self.tetrahedra[:, pair] for pair in PAIRS])
        ends = np.unique(np.sort(ends, axis=1), axis=0)
        if self.sheet:
            ends = np.concatenate([ends, self.sheet.mesh.edges.edges + self.first_particle[-1]]).astype(np.int32)
        return ends, edge_lengths(self.position, ends)

    @cached_property
    def spacing(self) -> float:
        """Mean edge [m]."""
        return mean(self.edges[1])

    @property
    def whole_volume(self) -> np.ndarray:
        """Volume of each whole tetrahedron, within the body's surface or not, (tetrahedra,) [m^3]."""
        whole: np.ndarray = self.volume / self.fraction
        return whole

    @cached_property
    def vertex_triangles(self) -> Lists:
        """Surface triangles at each particle, ascending; none at an interior one."""
        corner = self.surface.ravel()
        return grouped(corner, np.arange(len(corner), dtype=np.int32) // 3, self.particle_count)

    @cached_property
    def patch(self) -> np.ndarray:
        """Number of the group of tetrahedra that conserve their volume together, (tetrahedra,) int64, from 0."""
        together = np.array([part.volume == "voxels" for part in self.parts])[self.body] & (self.run > 1)
        starts = np.flatnonzero(np.diff(self.body, prepend=-1) != 0)
        inside = np.arange(len(self.body)) - np.repeat(starts, np.diff([*starts, len(self.body)]))
        begins = ~together | (inside % self.run == 0)
        number: np.ndarray = np.cumsum(begins) - 1
        return number

    def chosen(self, word: str, body: str | None = None, field: str = "pinned") -> np.ndarray:
        """Return the vertices of a body, or of all, on a side, in a region or for `all`, (vertices,) int64, ascending.

        Raises SceneError, which names the `field`, where there is no such body.
        """
        ends = [*self.first_particle[1:], self.particle_count]
        vertices = [np.zeros(0, np.int64)]
        for number in body_numbers(field, body, self.names):
            some = slice(self.first_particle[number], ends[number])
            vertices.append(vertices_of(word, self.mesh_position[some], self.position[some], self.regions) + some.start)
        return np.concatenate(vertices)

    def pin_motions(self, motions: Mapping[str, Motion]) -> np.ndarray:
        """Return the number in `motions` of each pinned vertex's motion, or -1, (pins,) int64. Raises SceneError."""
        if self.whole is not None:
            here = np.isin(self.whole.pinned_vertices, self.of_whole[0])
            return self.whole.pin_motions(motions)[here]
        chosen = {}
        for name, motion in motions.items():
            if not isinstance(motion.pins, str):
                raise SceneError(f"{name}.pins", motion.pins, "must be a side, a region or all for tetrahedral bodies")
            check_word(f"{name}.pins", motion.pins, self.regions)
            there = self.chosen(motion.pins, motion.body, f"{name}.body")
            chosen[name] = np.intersect1d(there, self.pinned_vertices) if motion.pins == "all" else there
        return motion_numbers(motions, self.pinned_vertices, self.names, chosen)

    def __str__(self) -> str:
        """`5289 particles and 19 875 tetrahedra of 4 bodies`, ` and a cloth of 800 triangles`."""
        bodies = "1 body" if len(self.parts) == 1 else f"{len(self.parts)} bodies"
        cloth = f" and a cloth of {len(self.sheet.mesh.triangles)} triangles" if self.sheet else ""
        return f"{self.particle_count} particles and {len(self.tetrahedra)} tetrahedra of {bodies}{cloth}"

    @property
    def damping_rates(self) -> np.ndarray:
        """Damping rate of each particle's velocity, that of its body, (particles,) float64 [1/s]."""
        counts = np.diff([*self.first_particle, self.particle_count])
        rates = [*(part.mass_damping for part in self.parts), *([0.0] if self.sheet else [])]
        return np.repeat(rates, counts)

    def lame(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (mu, lambda) (tetrahedra,) float64 [Pa]."""
        return self.matter.lame


def make_tetrahedra_set(
    parts: Mapping[str, TetrahedralBody],
    regions: Mapping[str, Region] = NO_REGIONS,
    attachments: Mapping[str, Attachment] = NO_ATTACHMENTS,
    materials: Mapping[str, Material] = ONE_MATERIAL,
    cloths: Mapping[str, Mesh] = NO_CLOTH,
) -> TetrahedraSet:
    """Return the set of a scene's bodies, by name.

    `regions`, `attachments`, `materials`, `cloths` (one at most): the scene's. Raises SceneError, InputError, which
    name the body.
    """
    names = (*parts, *cloths)
    words = {
        name: [one.vertices for one in attachments.values() if one.body == name and pins(one, names)] for name in names
    }
    bodies = [placed_body(name, part, materials, regions, words[name]) for name, part in parts.items()]
    body_set = _joined(parts, bodies, regions, attachments)
    for name, cloth in cloths.items():
        body_set = _beside(body_set, sheet_of(name, cloth, words[name], regions))
    return body_set


def _joined(
    parts: Mapping[str, TetrahedralBody],
    bodies: list[PlacedBody],
    regions: Mapping[str, Region],
    attachments: Mapping[str, Attachment],
) -> TetrahedraSet:
    """Return the concatenated set of the `bodies` of `parts`."""
    particles, elements = [len(one.mesh.position) for one in bodies], [len(one.mesh.tetrahedra) for one in bodies]
    if sum(particles) > MAX_PARTICLES:
        raise SceneError("edge", sum(particles), f"at most {MAX_PARTICLES} particles (32-bit indices)")
    require(sum(elements) * ELEMENT_BYTES, available_bytes(), "edge", sum(elements), "main memory")
    first = np.concatenate([[0], np.cumsum(particles)])
    numbered = list(zip(bodies, first, strict=False))
    fraction = np.concatenate([one.body.fraction for one in bodies])
    return TetrahedraSet(
        tuple(parts),
        tuple(parts.values()),
        np.concatenate([one.mesh.position for one in bodies]),
        np.concatenate([one.velocity for one in bodies]),
        np.concatenate([one.masses for one in bodies]),
        np.concatenate([one.pinned + start for one, start in numbered]).astype(np.int64),
        np.repeat(np.arange(len(bodies), dtype=np.int32), elements),
        np.concatenate([one.mesh.tetrahedra + start for one, start in numbered]).astype(np.int32),
        np.concatenate([rest_inverse(one.mesh.position, one.mesh.tetrahedra) for one in bodies]),
        np.concatenate([one.mesh.volumes for one in bodies]) * fraction,
        fraction,
        np.concatenate([one.mesh.surface + start for one, start in numbered]).astype(np.int32),
        first[:-1],
        skin_of([one.body for one in bodies], first),
        np.concatenate([one.voxels for one in bodies]),
        np.repeat(np.array([one.run for one in bodies], np.int32), elements),
        np.concatenate([one.body.mesh.position for one in bodies]),
        joined([one.matter for one in bodies]),
        regions,
        attachments,
    )


def _beside(body_set: TetrahedraSet, sheet: Sheet) -> TetrahedraSet:
    """Return the set with the cloth's vertices after its particles."""
    first, triangles = body_set.particle_count, sheet.mesh.triangles
    return replace(
        body_set,
        names=(*body_set.names, sheet.name),
        position=np.concatenate([body_set.position, sheet.position]),
        velocity=np.concatenate([body_set.velocity, np.zeros_like(sheet.position)]),
        masses=np.concatenate([body_set.masses, sheet.masses]),
        pinned_vertices=np.concatenate([body_set.pinned_vertices, sheet.pinned + first]),
        surface=np.concatenate([body_set.surface, triangles + first]).astype(np.int32),
        first_particle=np.append(body_set.first_particle, first),
        skin=body_set.skin.beside(plain_skin(np.arange(first, first + len(sheet.position)), (triangles,))),
        mesh_position=np.concatenate([body_set.mesh_position, sheet.mesh.position]),
        sheet=sheet,
    )
