"""All particles of a world as one set, for code that only needs particles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.memory import MAX_PARTICLES
from softlab.model.base.pins import pin_indices
from softlab.model.geometry.arithmetic.ordered import mean
from softlab.model.geometry.particle_row import ParticleRow
from softlab.model.geometry.topology import mesh_of, pinned_vertices, vertex_masses
from softlab.model.particles.body_set import BodySet
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.parts import Grid


@dataclass(frozen=True, eq=False)
class WorldSet(ParticleRow):
    """The particles of all members, one member after the other: `first[k]` to before `first[k + 1]` are those of
    `names[k]`.

    `position`, `velocity` (particles, 3) float64 [m], [m/s] at the start; `masses` (particles,) [kg];
    `pinned_vertices`, ascending: particles that do not move. It has the attributes of a row of masses: `rows` 1,
    `columns` the number of particles, `spacing` [m] the smallest one of the members, `mass` [kg] the mean one.
    """

    names: tuple[str, ...]
    first: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    masses: np.ndarray
    pinned_vertices: np.ndarray
    spacing: float

    @property
    def pinned(self) -> str:
        """Return `some` for pinned particles, else `none`."""
        return "some" if len(self.pinned_vertices) else "none"

    @property
    def mass(self) -> float:
        """Mean mass of a particle [kg]."""
        return mean(self.masses)

    @property
    def lightest(self) -> float:
        """Mean mass of a particle [kg]; each member has its own."""
        return self.mass

    def slices(self) -> dict[str, slice]:
        """Return the slice of each member's particles."""
        return {name: slice(*self.first[k : k + 2].tolist()) for k, name in enumerate(self.names)}


def make_world_set(members: Mapping[str, Grid | BodySet | TetrahedraSet | FluidSet | WorldSet]) -> WorldSet:
    """Return the set of the members' own sets, by name. Raises SceneError where there are too many particles."""
    counts = [one.particle_count for one in members.values()]
    if sum(counts) > MAX_PARTICLES:
        raise SceneError("world", sum(counts), f"at most {MAX_PARTICLES} particles (32-bit indices)")
    first = np.append(0, np.cumsum(counts))
    each = [_of(one) for one in members.values()]
    position, velocity, masses = (np.concatenate(arrays) for arrays in list(zip(*each, strict=True))[:3])
    pinned = np.concatenate([start + one[3] for start, one in zip(first, each, strict=False)]).astype(np.int64)
    spacing = min(one.spacing for one in members.values())
    return WorldSet(tuple(members), first, position, velocity, masses, pinned, spacing)


def _of(
    part: Grid | BodySet | TetrahedraSet | FluidSet | WorldSet,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (position, velocity, masses, pinned) of a member's particles."""
    if isinstance(part, Mesh):
        position = mesh_of(part).position + part.origin
        by_rows = part.file is None
        pinned = pin_indices(part.pinned, part.rows, part.columns) if by_rows else pinned_vertices(part)
        return position, np.zeros_like(position), vertex_masses(part), pinned
    assert not isinstance(part, Grid)
    return part.position, part.velocity, part.masses, part.pinned_vertices
