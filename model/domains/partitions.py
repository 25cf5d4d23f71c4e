"""Who owns what when the meshes of bodies are shared in parts: pure arithmetic, for every way of sending.

A share owns particles. Its window holds these and a halo: whatever a substep, walked backwards from what is owned through its
sweeps, reads. A window stepped by itself for a substep leaves what it owns as the whole would have it, bit for bit; then each
share sends what it owns of the others' halos. As of a sheet (model/domains/decomposition.py) what is sent is saved by
computing twice (J. Demmel, M. Hoemmen, M. Mohiyuddin, K. Yelick, "Avoiding communication in sparse matrix computations",
2008).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from model.core.errors import SceneError

Window = tuple[np.ndarray, np.ndarray]  # particles, elements, both ascending int64: numbers among all


@dataclass(frozen=True, eq=False)
class SharedMesh:
    """What is shared in parts. `layers` (particles,) int64: of each particle the number of the layer that is never cut, from
    0 on along the bodies, one body after the other; `weights` (particles,) float64: how much work each is; `window(owned)`:
    what a substep of the `owned` (particles,) bool reads; `elements`: how many there are, called `counted`; `exchanges`:
    a step; `some(window)`: what is in a window, in the place of what the scene calls `held`."""

    layers: np.ndarray
    weights: np.ndarray
    window: Callable[[np.ndarray], Window]
    elements: int
    counted: str
    exchanges: int
    held: str
    some: Callable[[Window], Any]


@dataclass(frozen=True, eq=False)
class Part:
    """What share `number` owns, particles (n,) int64, ascending, and what its window holds, `particles` and `elements`."""

    number: int
    owned: np.ndarray
    particles: np.ndarray
    elements: np.ndarray

    @cached_property
    def places(self) -> np.ndarray:
        """Where in the window the owned ones are."""
        return np.searchsorted(self.particles, self.owned)


@dataclass(frozen=True, eq=False)
class Message:
    """Particles that share `source` sends share `target`: where they are in the one's window, and in the other's, (n,)."""

    source: int
    target: int
    from_places: np.ndarray
    to_places: np.ndarray


@dataclass(frozen=True, eq=False)
class Partitions:
    """A `mesh` in `parts`."""

    mesh: SharedMesh
    parts: tuple[Part, ...]

    @property
    def count(self) -> int:
        """How many."""
        return len(self.parts)

    @cached_property
    def order(self) -> np.ndarray:
        """(particles,) int64: all of them, in the order in which shares own them."""
        return np.concatenate([part.owned for part in self.parts])

    @cached_property
    def messages(self) -> tuple[Message, ...]:
        """All that is sent in an exchange."""
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
        """Particles that windows hold, over all that there are."""
        return sum(len(part.particles) for part in self.parts) / len(self.order)

    @property
    def balance(self) -> float:
        """The fair part of the elements over those of the largest window: how much faster all are than one, over their
        number."""
        return self.mesh.elements / (self.count * max(len(part.elements) for part in self.parts))

    @property
    def most_sent(self) -> int:
        """Particles of the largest message of an exchange."""
        return max((len(message.from_places) for message in self.messages), default=0)


def partition(mesh: SharedMesh, count: int, option: str) -> Partitions:
    """The mesh in `count` parts of layers, each cut at the border of two that is nearest to where a fair one would be.

    Raises SceneError, naming the `option`, where a window would reach beyond the neighbours, or hold all."""
    found = _tried(mesh, count)
    if found is None:
        most, over = (
            1,
            count,
        )  # one goes always, so many do not; windows are walked for a few numbers between, not for all
        while over - most > 1:
            middle = (most + over) // 2
            most, over = (middle, over) if _tried(mesh, middle) is not None else (most, middle)
        told = "a substep of a share reads beyond its neighbours, or all (fewer iterations, more substeps read less)"
        raise SceneError(option, count, f"{told}; use at most {most}")
    return found


def _tried(mesh: SharedMesh, count: int) -> Partitions | None:
    """Those, or None."""
    ends = np.concatenate([[0], np.cumsum(np.bincount(mesh.layers, mesh.weights))])
    cuts = [0]
    for k in range(1, count):
        cuts.append(max(int(np.abs(ends - ends[-1] * k / count).argmin()), cuts[-1] + 1))
    if count >= len(ends) or cuts[-1] >= len(ends) - 1:
        return None
    share = np.searchsorted(cuts, mesh.layers, side="right") - 1
    parts = []
    for number in range(count):
        owned = share == number
        particles, elements = mesh.window(owned)
        if np.abs(share[particles] - number).max() > 1 or (count > 1 and len(elements) == mesh.elements):
            return None
        parts.append(Part(number, np.flatnonzero(owned), particles, elements))
    return Partitions(mesh, tuple(parts))
