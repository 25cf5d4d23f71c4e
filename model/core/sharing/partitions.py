"""Partition of the meshes of bodies: pure arithmetic, for every exchange.

A part owns particles. Its window contains these and a halo: everything that a substep reads for the owned particles,
traced backwards through its sweeps. A window stepped alone for a substep computes its owned particles as the whole mesh
does, bit for bit; then each part sends those that are in the others' halos. As for a sheet
(model/core/sharing/decomposition.py) computing twice saves messages (J. Demmel, M. Hoemmen, M. Mohiyuddin, K. Yelick,
"Avoiding communication in sparse matrix computations", 2008).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.particles.particle_set import ParticleSet

Window = tuple[np.ndarray, np.ndarray]  # particles, elements, both ascending int64: global numbers


@dataclass(frozen=True, eq=False)
class SharedMesh:
    """A mesh that is shared in parts.

    `layers` (particles,) int64: number of each particle's layer, which is never cut, from 0 along the bodies, one body
    after the other; `weights` (particles,) float64: the work for each; `window(owned)`: particles and elements that a
    substep of the `owned` (particles,) bool reads; `elements`: their number, described by `counted`; `exchanges`: per
    step; `some(window)`: the particle set of a window; `attribute`: the scene's attribute that it replaces.
    """

    layers: np.ndarray
    weights: np.ndarray
    window: Callable[[np.ndarray], Window]
    elements: int
    counted: str
    exchanges: int
    attribute: str
    some: Callable[[Window], ParticleSet]


@dataclass(frozen=True, eq=False)
class Part:
    """Part `number` of a mesh: `owned` particles (n,) int64, ascending, and the `particles` and `elements` of its
    window."""

    number: int
    owned: np.ndarray
    particles: np.ndarray
    elements: np.ndarray

    @cached_property
    def places(self) -> np.ndarray:
        """Indices of the owned particles in the window."""
        return np.searchsorted(self.particles, self.owned)


@dataclass(frozen=True, eq=False)
class Message:
    """Particles that part `source` sends to part `target`: their indices in the two windows, (n,)."""

    source: int
    target: int
    from_places: np.ndarray
    to_places: np.ndarray


@dataclass(frozen=True, eq=False)
class Partitions:
    """A `mesh` divided into `parts`."""

    mesh: SharedMesh
    parts: tuple[Part, ...]

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.parts)

    @cached_property
    def order(self) -> np.ndarray:
        """Particles sorted by the part that owns them, (particles,) int64."""
        return np.concatenate([part.owned for part in self.parts])

    @cached_property
    def messages(self) -> tuple[Message, ...]:
        """All messages of an exchange."""
        return tuple(self._messages())

    def _messages(self) -> Iterator[Message]:
        for source in self.parts:
            for target in self.parts:
                sent = np.intersect1d(source.owned, target.particles)
                if source.number != target.number and len(sent):
                    places = (np.searchsorted(one.particles, sent) for one in (source, target))
                    yield Message(source.number, target.number, *places)

    @property
    def repeated(self) -> float:
        """Particles in windows, over all particles."""
        return sum(len(part.particles) for part in self.parts) / len(self.order)

    @property
    def balance(self) -> float:
        """Mean number of elements over that of the largest window: the speed-up over one, divided by their number."""
        return self.mesh.elements / (self.count * max(len(part.elements) for part in self.parts))

    @property
    def most_sent(self) -> int:
        """Particles of the largest message of an exchange."""
        return max((len(message.from_places) for message in self.messages), default=0)


def partition(mesh: SharedMesh, count: int, option: str) -> Partitions:
    """Return the mesh in `count` parts of layers, each cut at the border of layers nearest to an equal partition.

    Raises SceneError, naming the `option`, where a window would extend beyond the neighbours, or contain everything.
    """
    partitions = _tried(mesh, count)
    if partitions is None:
        most, over = (
            1,
            count,
        )  # one is always possible, `count` is not; windows are computed for a few numbers between, not for all
        while over - most > 1:
            middle = (most + over) // 2
            most, over = (middle, over) if _tried(mesh, middle) is not None else (most, middle)
        reason = "a substep of a share reads beyond its neighbours, or all (fewer iterations, more substeps read less)"
        raise SceneError(option, count, f"{reason}; use at most {most}")
    return partitions


def _tried(mesh: SharedMesh, count: int) -> Partitions | None:
    """Return the partition in `count` parts, or None where it is not possible."""
    ends = np.concatenate([[0], np.cumsum(np.bincount(mesh.layers, mesh.weights))])
    cuts = [0]
    for k in range(1, count):
        cuts.append(max(int(np.abs(ends - ends[-1] * k / count).argmin()), cuts[-1] + 1))
    if count >= len(ends) or cuts[-1] >= len(ends) - 1:
        return None
    owner = np.searchsorted(cuts, mesh.layers, side="right") - 1
    parts = []
    for number in range(count):
        owned = owner == number
        particles, elements = mesh.window(owned)
        if np.abs(owner[particles] - number).max() > 1 or (count > 1 and len(elements) == mesh.elements):
            return None
        parts.append(Part(number, np.flatnonzero(owned), particles, elements))
    return Partitions(mesh, tuple(parts))
