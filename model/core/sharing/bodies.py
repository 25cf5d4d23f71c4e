"""Partition of bodies that never collide into blocks of whole bodies: pure arithmetic, and the scene of a block.

A block (`Block`) contains neighbouring bodies in the order of the file. No body acts on another, so that a block is
stepped by the scene's own kernels, and nothing is sent until the state is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.particles.particle_set import ParticleSet
from softlab.model.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Apart:
    """The bodies of a scene, none of which acts on another.

    `names`: of the part of each; `weights` (bodies,) int64: the work for each, as a number of what is `counted`;
    `first_particle` (bodies + 1,) int64; `attribute`: the scene's attribute with its set of particles; `some(first, end)`:
    the set of those bodies alone; `clusters(first, end)`: the indices of their clusters among all, in the order of that
    set, (n,) int64.
    """

    names: tuple[str, ...]
    weights: np.ndarray
    counted: str
    first_particle: np.ndarray
    attribute: str
    some: Callable[[int, int], ParticleSet]
    clusters: Callable[[int, int], np.ndarray]


def require_apart(scene: Scene) -> None:
    """Raise SceneError if the scene's contacts let bodies collide."""
    if scene.contact is not None:
        reason = (
            "lets bodies collide, which is not supported on several GPUs or processes; leave it out (bodies then pass "
            "through each other), or run the scene on one"
        )
        raise SceneError(f"{scene.name_of('contact')}.kind", "contact", reason)


@dataclass(frozen=True)
class Block:
    """Bodies `first` to before `end`, with the particles `first_particle` to before `end_particle`.

    `weight`: the sum of their weights; `parts`: the names of their parts.
    """

    number: int
    first: int
    end: int
    first_particle: int
    end_particle: int
    weight: int
    parts: tuple[str, ...]

    @property
    def particles(self) -> slice:
        """Slice of its particles in the whole set."""
        return slice(self.first_particle, self.end_particle)


@dataclass(frozen=True)
class Division:
    """Bodies in blocks; `counted`: the quantity that is balanced."""

    blocks: tuple[Block, ...]
    counted: str

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.blocks)

    @property
    def largest(self) -> int:
        """Weight of the heaviest block."""
        return max(block.weight for block in self.blocks)

    @property
    def balance(self) -> float:
        """Mean weight over that of the heaviest block: the speed-up over one, divided by their number."""
        return sum(block.weight for block in self.blocks) / (self.count * self.largest)


def divide(apart: Apart, count: int, option: str) -> Division:
    """Return the bodies in `count` blocks, each cut at the border of bodies nearest to an equal partition.

    No block exceeds an equal one by more than a body. Raises SceneError, naming the `option`, for more blocks than
    bodies.
    """
    bodies = len(apart.weights)
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    if count > bodies:
        reason = "1 body is never cut" if bodies == 1 else f"{bodies} bodies can be divided among at most {bodies}"
        raise SceneError(option, count, f"{reason}; use {'1' if bodies == 1 else 'fewer'}")
    ends = np.concatenate([[0], np.cumsum(apart.weights)])
    cuts = [0]
    for k in range(1, count):
        nearest = int(np.abs(ends - ends[-1] * k / count).argmin())
        cuts.append(min(max(nearest, cuts[-1] + 1), bodies - (count - k)))
    first = apart.first_particle
    return Division(
        tuple(
            Block(k, a, b, int(first[a]), int(first[b]), int(ends[b] - ends[a]), tuple(dict.fromkeys(apart.names[a:b])))
            for k, (a, b) in enumerate(pairwise([*cuts, bodies]))
        ),
        apart.counted,
    )
