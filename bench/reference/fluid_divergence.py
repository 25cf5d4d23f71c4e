"""Scheme `divergence-free` in slow, plain NumPy float64, as model/fluid/divergence_plan.py describes it.

For a world and the pairs of bench/reference/fluid.py, the reference of the rest of a substep. From the papers, without
model/formulas or a backend: J. Bender and D. Koschier, "Divergence-Free SPH for Incompressible and Viscous Fluids",
TVCG 2017; the iterations' acceleration from A. Beck and M. Teboulle, SIAM J. Imaging Sciences 2 (2009).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

SURFACE = 0.09  # a particle that lacks more of its density is at a surface


class DivergenceFree:
    """Substep `number` of `h` [s] at positions x (n, 3), with `pairs` there."""

    def __init__(self, world: Any, number: int, x: np.ndarray, pairs: Any, places: np.ndarray):
        self.world, self.pairs, self.h = world, pairs, world.h
        method, weight = world.scene.method, world.weight
        pairs.at(x, places)
        kernel = world.kernels.density(pairs.bare)
        contribution, self.wall = world.walls(x, (number + 1) * self.h)
        self.came = contribution - world.walls(x, number * self.h)[0]
        self.c = pairs.sum(kernel, kernel) - world.kernels.rest + contribution
        g = -pairs.s[:, None] * pairs.d
        square = (g**2).sum(axis=1)
        from_others = pairs.sum(weight[pairs.j] * square, weight[pairs.i] * square)
        across = pairs.sum(g, -g) + self.wall
        below = weight * (across**2).sum(axis=1) + from_others
        self.g, self.factor = g, method.relaxation_factor / (below + method.softness / world.kernels.h**2)
        self.iterations = method.iterations
        self.change = world.of("maximum_acceleration") * self.h / 2

    def rate(self, v: np.ndarray) -> np.ndarray:
        """Return the rate of change of C by velocities, or its change by displacements: (n,)."""
        pairs = self.pairs
        one = (self.g * (v[pairs.i] - v[pairs.j])).sum(axis=1)
        return pairs.sum(one, one) + (self.wall * v).sum(axis=1)

    def moved_by(self, multiplier: np.ndarray) -> np.ndarray:
        """Return the displacements of particles by multipliers: (n, 3) [m]."""
        pairs = self.pairs
        displacement = (multiplier[pairs.i] + multiplier[pairs.j])[:, None] * self.g
        total = pairs.sum(displacement, -displacement) + multiplier[:, None] * self.wall
        return np.asarray(self.world.weight[:, None] * total)

    def solve(self, target: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (velocities, multipliers) that keep target + rate of displacements at most 0, to the error of the
        iterations.
        """
        ahead = iterate = np.zeros(len(target))
        for k in range(self.iterations):
            updated = np.minimum(ahead - self.factor * (target + self.rate(self.moved_by(ahead))), 0)
            momentum = k / (k + 3) if k < self.iterations - 1 else 0
            ahead, iterate = updated + momentum * (updated - iterate), updated
        gain = self.moved_by(ahead) / self.h
        far = np.linalg.norm(gain, axis=1)
        return v + gain * np.where(far > self.change, self.change / np.where(far > 0, far, 1), 1)[:, None], ahead

    def substep(
        self, v: np.ndarray, between: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (velocities, multipliers) after both solves.

        `between` them smooths, damps and accelerates velocities. Afterwards `second_start` has the start of the second solve,
        and `second` its multipliers.
        """
        grows = self.h * self.rate(v) + self.came
        v, first = self.solve(np.where(self.c > -SURFACE, grows, -1.0), v)
        self.second_start = between(v, self.c)
        v, self.second = self.solve(self.c + self.h * self.rate(self.second_start), self.second_start)
        return v, first + self.second
