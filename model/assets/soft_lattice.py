"""Blocks of a regular lattice: soft bodies whose clusters are windows, summed in passes along the axes.

A. Rivers, D. James, "FastLSM: Fast Lattice Shape Matching for Robust Real-Time Deformation", SIGGRAPH 2007.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from softlab.model.assets.baked_body import BakedBody, report_of
from softlab.model.assets.lattice import Lattice
from softlab.model.assets.sampling import MAX_PARTICLES
from softlab.model.assets.skin import make_skin
from softlab.model.assets.soft_body import Meshes, SoftBody, check_masses
from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.memory import available_bytes, require
from softlab.model.base.table import Count
from softlab.model.geometry.arithmetic.ordered import dot, total
from softlab.model.geometry.solid import as_mesh

OFF = 1e-6  # of a box's longest side: how far a corner of the mesh may be off its sides
FITS = 0.2  # of the spacing: how far one that fills the box may be off it
FITTED = 1e-6  # of a side: how far particles that fill it may end beside it
MAX_TRIED = 10_000  # spacings
ENTRY_BYTES = 100  # of a window's member while clusters are made
MAX_ENTRIES = 2**31 - 1  # of clusters: indices are 32-bit


class SoftLattice(SoftBody):
    """A box filled with a lattice of particles, `particle_spacing` apart, and a cluster around each, of the particles
    up to `region` positions away along each axis: the larger, the stiffer and smoother. The cost of a step hardly
    depends on it. If a spacing within 20 % fills the box exactly along all axes, it is used instead, and reported."""

    lacks: ClassVar[tuple[str, ...]] = (
        "volume_sampling", "surface_sampling", "cluster_spacing", "cluster_radius", "link_radius", "link_stiffness",
        "fill_holes",
    )  # fmt: skip
    lacks_reason: ClassVar[str] = (
        "does not apply to a lattice, which fills a box evenly; `region` sets the size of its clusters"
    )

    region: Count = 2

    def bake(self, mesh: Meshes) -> BakedBody:
        """Bake as `SoftBody.from_mesh`; the mesh must be a box along the axes. Raises InputError, SceneError."""
        box = as_mesh(mesh)
        low, high = _box(box.position, box.triangles)
        with np.errstate(all="ignore"):
            along = (high - low) / self.particle_spacing
        if not np.prod(along) <= MAX_PARTICLES:
            raise SceneError(
                "particle_spacing",
                self.particle_spacing,
                f"gives more than {MAX_PARTICLES} particles; use a larger one",
            )
        sides, asked = high - low, self.particle_spacing
        spacing = fitting_spacing(sides, asked)
        counts = [max(1, round(float(side / spacing))) for side in sides]
        lattice = Lattice((counts[0], counts[1], counts[2]), self.region, spacing)
        entries = float(np.prod([axis.count.sum() for axis in lattice.axes]))
        if entries > MAX_ENTRIES:
            raise SceneError(
                "region", self.region, f"at most {MAX_ENTRIES} members of windows together; these have {entries:.3g}"
            )
        require(int(entries) * ENTRY_BYTES, available_bytes(), "region", self.region, "main memory")
        position = lattice.positions() + 0.5 * (low + high)
        volume = float(np.prod(high - low))
        total = self.density * volume if self.mass is None else self.mass
        mass = np.full(lattice.size, total / lattice.size)
        check_masses(self, mass)
        clusters = lattice.clusters(position, mass, self.cluster_stiffness)
        none = np.zeros((0, 2), np.int32)
        surface = lattice.size - int(np.prod([max(0, count - 2) for count in counts]))
        filled = spacing * np.array(counts)
        notes = (*box.repairs, *_notes(sides, filled, asked, spacing))
        report = report_of(clusters, none, spacing, total, surface, notes, volume=volume, hanging=1)
        report = replace(report, covered=float(np.prod(np.minimum(1.0, filled / sides))))
        skin = make_skin(box.position, box.triangles, clusters.rest_centre)
        return BakedBody(position, mass, clusters, none, np.zeros(0), 0.0, skin, spacing, report, lattice)


def fitting_spacing(sides: np.ndarray, spacing: float) -> float:
    """Return the spacing [m] nearest to `spacing` that divides all of a box's `sides` (3,) [m], if one is within FITS
    of it, else `spacing`.

    >>> round(fitting_spacing(np.array([1.0, 0.5, 1.0]), 0.3), 6), fitting_spacing(np.array([1.0, 0.7, 0.3]), 0.28)
    (0.25, 0.28)
    """
    longest = float(sides.max())
    low, high = longest / (spacing * (1 + FITS)), longest / (spacing * (1 - FITS))
    best, off = spacing, np.inf
    for count in range(max(1, int(np.ceil(low - OFF))), min(int(high + OFF), int(low) + MAX_TRIED) + 1):
        candidate = longest / count
        along = sides / candidate
        away = abs(candidate - spacing)
        if away < off and np.all(np.abs(along - np.round(along)) <= FITTED * np.round(along)):
            best, off = candidate, away
    return spacing if off <= OFF * spacing else best


def _notes(sides: np.ndarray, filled: np.ndarray, asked: float, spacing: float) -> list[str]:
    """Return a sentence on how a lattice of the size `filled` (3,) [m] differs from its box, if it does."""
    if spacing != asked:
        return [f"particles are {spacing:.6g} m apart, not {asked:g}, so that they fill the box exactly"]
    if np.allclose(filled, sides, rtol=FITTED, atol=0):
        return []
    sizes, box = (" x ".join(f"{side:.4g}" for side in one) for one in (filled, sides))
    return [
        f"particles fill {sizes} m, the box is {box} m: no spacing within {100 * FITS:.0f} % of {asked:g} m divides all of "
        "its sides; a particle_spacing that does would fill it"
    ]


def _box(position: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest corner [m] of a mesh that is a box along the axes: closed, its vertices on the
    six sides and its volume theirs. Raises InputError for any other."""
    if not len(triangles):
        raise InputError("the mesh has no triangles; a lattice fills a box")
    low, high = position.min(axis=0), position.max(axis=0)
    sides = high - low
    away = np.minimum(np.abs(position - low), np.abs(position - high)).min(axis=1)
    a, b, c = (position[corner] - low for corner in triangles.T)
    volume = abs(total(dot(a, np.cross(b, c)))) / 6
    if away.max() > OFF * sides.max() or not np.isclose(volume, np.prod(sides), rtol=OFF):
        raise InputError(
            f"the mesh is no box along the axes: it holds {volume:.4g} m^3 of the {np.prod(sides):.4g} m^3 around it; a "
            'soft_lattice fills boxes, such as shape = { name = "box" }; kind = "soft_body" takes any closed mesh'
        )
    return low, high
