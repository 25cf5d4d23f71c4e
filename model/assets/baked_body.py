"""What a mesh becomes: a body in its mesh's frame, and a report of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.assets.sampling import Samples
from model.assets.skin import Skin
from model.geometry.solid import Solid
from model.shape_matching.clustering import parts, undetermined
from model.shape_matching.clusters import Clusters
from model.shape_matching.lattice import Lattice


@dataclass(frozen=True)
class Report:
    """What became of a mesh: counts; `mass` [kg]; `volume` [m^3] and the part of it within sqrt(3)/2 spacings of a particle,
    `covered`; `members`, the fewest and the most of a cluster; `overlap`: clusters a particle; `pieces` of the mesh, and
    `parts` of the body that hang together; `undetermined`: clusters of fewer than four particles or with all on a line;
    `told`: a sentence for each thing that was made good, or is odd."""

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
    told: tuple[str, ...]
    filled: int = 0  # of those inside, how many a finer lattice found room for

    @property
    def _extent(self) -> str:
        return f"{100 * self.covered:.1f} % of {self.volume:.4g} m^3 covered" if self.volume else "a sheet"

    def lines(self) -> list[str]:
        """What to tell a user of it."""
        least, most = self.members
        size = f"{least}" if least == most else f"{least} to {most}"
        found = [
            f"{self.particles} particles ({self.interior} inside, {self.surface} on the surface), about {self.spacing:g} m "
            f"apart, {self.mass:.4g} kg; " + self._extent,
            f"{self.clusters} cluster{'' if self.clusters == 1 else 's'} of {size} particles, {self.overlap:.2f} a particle; "
            f"orphans: {self.orphans}; links: {self.links}",
        ]
        if self.parts > 1:
            found.append(f"{self.parts} parts hang together, each moves on its own (pieces of the mesh: {self.pieces})")
        elif self.pieces > 1:
            found.append(f"the mesh's {self.pieces} pieces hang together, as clusters reach from one to the other")
        if self.undetermined:
            found.append(
                f"{self.undetermined} of {self.clusters} clusters have fewer than 4 particles, or all on a line, and turn as "
                "they like: a smaller particle_spacing, a larger cluster_radius or more surface_sampling mends it"
            )
        return [*found, *self.told]


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
    samples: Samples, mass: float, clusters: Clusters, links: np.ndarray, body: Solid, spacing: float
) -> Report:
    count, members, told = len(samples.position), np.diff(clusters.offsets), body.told
    if samples.overlapping:
        told = (
            *told,
            "parts of the mesh overlap one another, or cross themselves: what is inside any of them is inside",
        )
    return Report(
        particles=count,
        interior=samples.interior,
        surface=samples.surface,
        spacing=spacing,
        mass=float(mass),
        volume=float(samples.total),
        covered=samples.covered,
        clusters=clusters.count,
        members=(int(members.min()), int(members.max())),
        overlap=len(clusters.indices) / count,
        orphans=len(clusters.orphans),
        links=len(links),
        pieces=body.pieces,
        parts=parts(clusters, links),
        undetermined=undetermined(clusters),
        told=told,
        filled=samples.filled,
    )
