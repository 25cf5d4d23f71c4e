"""Material values of each tetrahedron of a body: those of its region where a table of kind material names that region,
otherwise those of the body's table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.arithmetic.ordered import total
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh
from softlab.model.particles.tetrahedra.masses import limited
from softlab.model.particles.tetrahedra.topology import neighbours
from softlab.model.tables.regions import Region
from softlab.model.tables.tetrahedra import Material, TetrahedralBody, lame_of

WHOLE_RATIO = (
    10.0  # largest ratio of the volumes at two neighbouring vertices in a lattice of whole voxels of five tetrahedra
)


@dataclass(frozen=True, eq=False)
class Matter:
    """Values of each tetrahedron, (n,) float64: Young's modulus [Pa], Poisson's ratio, density [kg/m^3], damping
    [s]."""

    young_modulus: np.ndarray
    poisson_ratio: np.ndarray
    density: np.ndarray
    damping: np.ndarray

    @property
    def lame(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (mu, lambda) [Pa]."""
        return lame_of(self.young_modulus, self.poisson_ratio)

    def some(self, chosen: np.ndarray) -> Matter:
        """Return the values of the `chosen` tetrahedra."""
        return Matter(*(getattr(self, name)[chosen] for name in NAMES))

    def masses(self, mesh: TetrahedralMesh, fractions: np.ndarray, ratio: float | None = None) -> np.ndarray:
        """Return the lumped masses of the vertices, (vertices,) [kg].

        A quarter of each tetrahedron at each of its corners, times the corner's fraction of it (tetrahedra, 4)
        (model/geometry/tetrahedra/fractions.py). Neighbours differ by at most the factor `ratio`. Where voxels are cut,
        the volumes of neighbouring vertices differ by at most WHOLE_RATIO; the body's mass is unchanged.
        """
        count, corners = len(mesh.position), mesh.tetrahedra.ravel()
        volume = np.repeat(mesh.volumes / 4, 4) * fractions.ravel()
        masses = np.bincount(corners, np.repeat(self.density, 4) * volume, minlength=count)
        cut = bool((fractions < 1).any())
        if not cut and ratio is None:
            return masses
        near = neighbours(mesh.tetrahedra, count)
        if cut:
            lumped = np.bincount(corners, volume, minlength=count)
            shared = masses * (limited(lumped, near, WHOLE_RATIO) / lumped)
            masses = shared * (total(masses) / total(shared))
        return masses if ratio is None else limited(masses, near, ratio)


NAMES = tuple(field.name for field in fields(Matter))


def matter_of(
    name: str,
    part: TetrahedralBody,
    mesh: TetrahedralMesh,
    materials: Mapping[str, Material],
    regions: Mapping[str, Region],
) -> Matter:
    """Return the values of the body `name`, whose `mesh` is at its position in the scene.

    Of several tables that contain a tetrahedron's centre the last counts. Raises InputError (a region's mesh).
    """
    values = {one: np.full(len(mesh.tetrahedra), getattr(part, one), np.float64) for one in NAMES}
    middles = mesh.position[mesh.tetrahedra].mean(axis=1)
    for material in materials.values():
        if material.body in (None, name):
            try:
                inside = regions[material.region].holds(middles, 0.0)
            except InputError as error:
                raise InputError(f"{material.region}.{error}") from None
            for one in NAMES:
                value = getattr(material, one)
                if value is not None:
                    values[one][inside] = value
    return Matter(**values)


def joined(some: list[Matter]) -> Matter:
    """Return the values of all bodies, one after the other."""
    return Matter(*(np.concatenate([getattr(one, name) for one in some]) for name in NAMES))
