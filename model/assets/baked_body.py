"""The body that a mesh becomes, in its mesh's frame, and a report on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.assets.clustering import parts, undetermined
from softlab.model.assets.clusters import Clusters
from softlab.model.assets.lattice import Lattice
from softlab.model.assets.sampling import Samples
from softlab.model.assets.skin import Skin


@dataclass(frozen=True)
class Report:
    """Result of baking a mesh.

    Counts; `mass` [kg]; `volume` [m^3] and the fraction of it within sqrt(3)/2 spacings of a particle, `covered`;
    `members`, the fewest and the most of a cluster; `overlap`: clusters per particle; `pieces` of the mesh, and
    connected `parts` of the body; `undetermined`: clusters of fewer than four particles or with all on a line; `notes`:
    a sentence for each repair or oddity.
    """

    particles: int
    interior: int
    surface: int
    spacing: float
    mass: float
    volume: float
    covered: float
    clusters: int
    members: tuple[int, int]
    overlap: float
    orphans: int
    links: int
    pieces: int
    parts: int
    undetermined: int
    notes: tuple[str, ...]
    filled: int = 0  # of those inside, the number that a finer lattice added

    @property
    def _extent(self) -> str:
        return f"{100 * self.covered:.1f} % of {self.volume:.4g} m^3 covered" if self.volume else "a sheet"

    def lines(self) -> list[str]:
        """Return the lines that describe the body to a user."""
        least, most = self.members
        size = f"{least}" if least == most else f"{least} to {most}"
        lines = [
            f"{self.particles} particles ({self.interior} inside, {self.surface} on the surface), about {self.spacing:g} m "
            f"apart, {self.mass:.4g} kg; " + self._extent,
            f"{self.clusters} cluster{'' if self.clusters == 1 else 's'} of {size} particles, {self.overlap:.2f} a particle; "
            f"orphans: {self.orphans}; links: {self.links}",
        ]
        if self.parts > 1:
            lines.append(
                f"{self.parts} parts are not connected and move independently (pieces of the mesh: {self.pieces})"
            )
        elif self.pieces > 1:
            lines.append(
                f"the mesh's {self.pieces} pieces move together, because clusters contain particles of several"
            )
        if self.undetermined:
            lines.append(
                f"{self.undetermined} of {self.clusters} clusters have fewer than 4 particles, or all on a line, so "
                "their rotation is undefined: a smaller particle_spacing, a larger cluster_radius or more surface_sampling "
                "helps"
            )
        return [*lines, *self.notes]


@dataclass(frozen=True, eq=False)
class BakedBody:
    """A body in its mesh's frame, to be put into a world any number of times.

    `position` (particles, 3) float64 [m], `mass` (particles,) float64 [kg], `clusters`, `links` (n, 2) int32 with
    `rest_length` (n,) float64 [m] and one `link_stiffness` [N/m], `skin`, particle `spacing` [m], `report`; `lattice`: whose
    windows the clusters are, None of other bodies.
    """

    position: np.ndarray
    mass: np.ndarray
    clusters: Clusters
    links: np.ndarray
    rest_length: np.ndarray
    link_stiffness: float
    skin: Skin
    spacing: float
    report: Report
    lattice: Lattice | None = None


def report_of(
    clusters: Clusters,
    links: np.ndarray,
    spacing: float,
    mass: float,
    surface: int,
    notes: Sequence[str],
    *,
    volume: float = 0.0,
    pieces: int = 1,
    hanging: int | None = None,
    samples: Samples | None = None,
) -> Report:
    """Return the report of a body of particles `spacing` [m] apart, of `mass` [kg] and `volume` [m^3], `surface` of
    them on its surface, in `clusters` with `links` (n, 2), from a mesh of so many `pieces`. `hanging`: how many parts
    hang together, where that is known; `samples`: where particles were sampled."""
    count, members = len(clusters.mass), np.diff(clusters.offsets)
    return Report(
        particles=count,
        interior=count - surface,
        surface=surface,
        spacing=spacing,
        mass=float(mass),
        volume=float(volume),
        covered=samples.covered if samples else 1.0,
        clusters=clusters.count,
        members=(int(members.min()), int(members.max())),
        overlap=len(clusters.indices) / count,
        orphans=len(clusters.orphans),
        links=len(links),
        pieces=pieces,
        parts=parts(clusters, links) if hanging is None else hanging,
        undetermined=undetermined(clusters),
        notes=tuple(notes),
        filled=samples.filled if samples else 0,
    )
