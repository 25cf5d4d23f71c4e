"""Links of a body set's bodies: distance constraints between two particles, in colours that share no particle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.formulas.constraints import distance
from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.geometry.colouring import Colouring, colour
from softlab.model.geometry.lists import offsets_of
from softlab.model.particles.constraints import Projection

LINKS = Projection("links", distance, corners=2, values=2, flags=(("per_constraint", True), ("soft", True)))


@dataclass(frozen=True, eq=False)
class Links:
    """`ends` (links, 2) int32: particles; `rest_length` (links,) float64 [m]; `compliance` (links,) float64 [m/N];
    colour c contains those from `starts[c]` to before `starts[c + 1]`, no two of which share a particle."""

    ends: np.ndarray
    rest_length: np.ndarray
    compliance: np.ndarray
    starts: np.ndarray

    @property
    def count(self) -> int:
        """Number of links."""
        return len(self.ends)

    @property
    def colours(self) -> int:
        """Number of colours."""
        return len(self.starts) - 1

    def energy(self, position: np.ndarray) -> float:
        """Return the sum of (length - rest)^2 / (2 compliance) [J], for particles at `position` (particles, 3) [m]."""
        first, other = np.asarray(position, np.float64)[self.ends].transpose(1, 0, 2)
        away = norm(other - first) - self.rest_length
        return 0.5 * float(np.sum(away * away / self.compliance))

    def values(self, substep: float, mass: float) -> np.ndarray:
        """Return rest length [m] and compliance times m / h^2 (dimensionless), (links, 2) float64.

        For substeps of h [s] and masses in units of m [kg] (M. Macklin et al., "XPBD", MIG 2016, eq. 4).
        """
        return np.stack([self.rest_length, self.compliance * mass / substep**2], axis=1)


@dataclass(frozen=True, eq=False)
class LinkedCopies:
    """The links of one baked body, `ends` (n, 2), `rest_length` (n,) [m] and `stiffness` [N/m], and the first particles
    of its copies; `particles`: per copy."""

    ends: np.ndarray
    rest_length: np.ndarray
    stiffness: float
    firsts: np.ndarray
    particles: int


def make_links(bodies: Sequence[LinkedCopies]) -> Links:
    """Return all links by colour, in each by body, copy and order of the body. A body is coloured once for all its
    copies.

    Raises SceneError where too many links share a particle.
    """
    coloured: list[tuple[LinkedCopies, Colouring]] = [
        (body, colour(body.ends, body.particles)) for body in bodies if len(body.ends)
    ]
    ends, lengths, compliance, sizes = [], [], [], []
    for number in range(max((colouring.colours for _, colouring in coloured), default=0)):
        size = 0
        for body, colouring in coloured:
            if number >= colouring.colours:
                continue
            chosen = colouring.order[colouring.starts[number] : colouring.starts[number + 1]]
            copies = len(body.firsts)
            ends.append((body.ends[chosen][None] + body.firsts[:, None, None]).reshape(-1, 2))
            lengths.append(np.tile(body.rest_length[chosen], copies))
            compliance.append(np.full(copies * len(chosen), 1 / body.stiffness))
            size += copies * len(chosen)
        sizes.append(size)
    if not sizes:
        return Links(np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(0), np.zeros(1, np.int32))
    arrays = np.concatenate(ends).astype(np.int32), np.concatenate(lengths), np.concatenate(compliance)
    return Links(*arrays, offsets_of(np.array(sizes)))
