"""Fluid coupled with solids in slow, plain NumPy float64: the reference of both backends.

From the papers, without model/formulas or a backend: samples of volume psi count in the density constraint (N. Akinci
et al., "Versatile Rigid-Fluid Coupling for Incompressible SPH", SIGGRAPH 2012), and their corrections are distributed
to the particles that carry them by inverse masses (M. Macklin et al., "Unified Particle Physics for Real-Time
Applications", SIGGRAPH 2014). The order of a substep is in model/fluid/plan.py; the fluid itself in
bench/reference/fluid.py.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.reference.fluid import _Pairs, _smooth, _World
from softlab.bench.reference.fluid_impact import velocities
from softlab.model.fluid.samples import Samples
from softlab.model.scene.scene import Scene


class FluidAmongSolids:
    """Fluids of a scene among `samples` of solids; per substep `begin`, `correct` in each iteration, `end`."""

    def __init__(self, scene: Scene, samples: Samples):
        self.world, self.samples = _World(scene), samples
        self.count = len(self.world.weight)
        volume = samples.volume
        one = np.ones(self.count)
        self.volume = np.append(one, volume)
        self.solid = np.append(0 * one, volume)
        self.weight = np.append(self.world.weight, samples.mobility)
        nu = self.world.of("viscosity") / self.world.of("density") * self.world.h / self.world.kernels.spread
        self.viscosity = np.append(np.minimum(nu, 1), 0 * volume)

    def begin(self, number: int, x: np.ndarray, v: np.ndarray, before: np.ndarray, position: np.ndarray) -> None:
        """Begin a substep from (x, v) of the fluid; the solids' particles move from `before` to the predicted
        `position`.
        """
        world = self.world
        gravity = world.scene.gravity.acceleration if world.scene.gravity and world.scene.gravity.enabled else 0.0
        self.fastest = np.minimum(world.of("maximum_speed"), world.kernels.h / 2 / world.h)
        u = v.copy()
        u[:, 1] -= world.h * gravity * world.of("buoyancy")
        self.number, self.x, self.u = number, x, self._limited(u)
        self.p, _ = world.collide(number, x, x + world.h * self.u, self.u)
        self.start = np.concatenate([x, self.samples.points(before)])
        joined = np.concatenate([self.p, self.samples.points(position)])
        self.pairs = _Pairs(world, joined)
        self.multiplier, self.c = np.zeros(self.count), np.zeros(self.count)
        self._factors(joined)

    def _limited(self, velocity: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(velocity, axis=1)
        return velocity * np.where(speed > self.fastest, self.fastest / np.where(speed > 0, speed, 1), 1)[:, None]

    def _among_itself(self) -> _Pairs:
        """Return the pairs of two fluid particles among the neighbours at the beginning of the substep."""
        fluid_pairs = _Pairs(self.world, self.p)
        fluid_pairs.pairs = self.pairs.pairs[(self.pairs.pairs < self.count).all(axis=1)]
        fluid_pairs.i, fluid_pairs.j = fluid_pairs.pairs.T
        return fluid_pairs

    @property
    def _end(self) -> float:
        return (self.number + 1) * self.world.h

    def _factors(self, joined: np.ndarray) -> None:
        world, pairs, i, j = self.world, self.pairs, self.pairs.i, self.pairs.j
        method, weight = world.scene.method, self.weight
        pairs.at(joined, np.arange(len(joined)))
        g = -pairs.s[:, None] * pairs.d
        square = (g**2).sum(axis=1)
        gives = weight * self.volume**2
        from_others = pairs.sum(gives[j] * square, gives[i] * square)[: self.count]
        across = pairs.sum(self.volume[j, None] * g, -self.volume[i, None] * g)[: self.count]
        _, wall = world.walls(joined[: self.count], self._end)
        weight = weight[: self.count]
        below = weight * ((across + wall) ** 2).sum(axis=1) + from_others
        self.factor = method.relaxation_factor / (below + method.softness / world.kernels.h**2)

    def correct(self, position: np.ndarray) -> np.ndarray:
        """Do an iteration with the solids' particles at `position`, and return their corrected positions."""
        world, pairs, i, j = self.world, self.pairs, self.pairs.i, self.pairs.j
        method, count = world.scene.method, self.count
        joined = np.concatenate([self.p, self.samples.points(position)])
        pairs.at(joined, np.arange(len(joined)))
        kernel = world.kernels.density(pairs.bare)
        contribution, wall = world.walls(self.p, self._end)
        total = pairs.sum(self.volume[j] * kernel, self.volume[i] * kernel)[:count]
        self.c = total - world.kernels.rest + contribution
        delta = np.minimum(self.multiplier - self.factor * self.c, 0) - self.multiplier
        self.multiplier = self.multiplier + delta
        changes = np.append(delta, np.zeros(self.samples.count))
        both = changes[i] * self.volume[j] + changes[j] * self.volume[i]
        if method.tensile_correction:
            h, at = world.kernels.h, method.tensile_distance
            ratio = np.maximum(1 - (pairs.r / h) ** 2, 0) ** 3 / (1 - at**2) ** 3
            both = both - method.tensile_correction * h**2 * ratio**4 * ((self.solid[i] == 0) & (self.solid[j] == 0))
        displacement = -(both * pairs.s)[:, None] * pairs.d
        moved = joined - self.start
        rub = (self.viscosity[i] + self.viscosity[j]) * 2 / np.maximum(self.weight[i] + self.weight[j], 1e-6)
        rub = rub * (self.solid[i] + self.solid[j]) * ((self.solid[i] > 0) != (self.solid[j] > 0)) / method.iterations
        displacement = displacement + (rub * world.kernels.kernel(pairs.r))[:, None] * (moved[j] - moved[i])
        total = pairs.sum(displacement, -displacement)
        total[:count] += delta[:, None] * wall
        pushed = self.p + world.weight[:, None] * total[:count]
        self.p, _ = world.collide(self.number, self.x, pushed, np.zeros_like(self.p))
        corrected = position.copy()
        for corner in range(self.samples.corners.shape[1]):
            carrier, weights = self.samples.corners[:, corner], self.samples.weights[:, corner]
            weighed = (weights * self.samples.lightness[carrier])[:, None]
            np.add.at(corrected, carrier, weighed * total[count:])
        return corrected

    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (position, velocity) of the fluid after the substep."""
        world = self.world
        v = velocities(world, self.number, self.x, self.u, self.p, self.multiplier)
        p, v = world.collide(self.number, self.x, self.p, v)
        v = _smooth(world, p, v, self._among_itself())
        rate = world.of("drag") + world.of("free_surface_drag") * np.clip(-self.c, 0, 1)
        return p, self._limited(v / (1 + world.h * rate)[:, None])
