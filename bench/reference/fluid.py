"""Fluid in slow, plain NumPy float64: every pair within the support radius, the reference of both backends.

From the papers, without model/formulas or a backend: M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013,
with density and gradient of one kernel, the spiky one, scaled so that a dilatation of the initial lattice changes C as
it changes the density, and multipliers that are summed over a substep's iterations and never attract. The order of a
substep is in model/fluid/plan.py; sums here have no order, so solvers agree with this to rounding. External forces on
particles and lists that overflow are not supported.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from softlab.bench.reference import fluid_impact, fluid_world
from softlab.bench.reference.fluid_divergence import DivergenceFree
from softlab.bench.reference.fluid_world import Flow
from softlab.model.fluid.measure import differences
from softlab.model.scene.scene import Scene


class _Kernels:
    """Kernels of a scene; `slope(r)` [1/m^2] times x_i - x_j is minus the gradient of a neighbour's part of C."""

    def __init__(self, scene: Scene):
        self.axes, self.h, self.d = scene.dimensions, scene.fluid_set.support, scene.fluid_set.spacing
        places = np.array(list(product(range(-5, 6), repeat=self.axes))) * self.d
        r = np.linalg.norm(places, axis=1)
        self.smoothing = 1 / self._poly6(r).sum()
        self.spread = np.sum(self.kernel(r) * places[:, 0] ** 2) / 2
        places, r = places[r > 0], r[r > 0]
        self.neighbours = int(np.sum(r < self.h))
        self.scale, self.rest = 1.0, 0.0
        self.scale = self.axes / np.sum(self.slope(r) * r * r)
        self.rest = np.sum(self.density(r))
        behind = places[:, 1] < 0
        lacks, push = np.sum(self.density(r[behind])), 2 * np.sum(self.slope(r[behind]) * -places[behind, 1])
        self.wall_range = self.d / 2 + 3 * lacks / push
        self.wall = lacks / (1 - self.d / 2 / self.wall_range) ** 3

    def _poly6(self, r: np.ndarray) -> np.ndarray:
        return np.maximum(self.h**2 - r**2, 0) ** 3 / self.h**6

    def kernel(self, r: np.ndarray) -> np.ndarray:
        """Return the weight of one neighbour in smoothing, poly6."""
        return self.smoothing * self._poly6(r)

    def density(self, r: np.ndarray) -> np.ndarray:
        """Return the part of one neighbour in C, by the spiky kernel."""
        return self.scale * np.maximum(1 - r / self.h, 0) ** 3

    def slope(self, r: np.ndarray) -> np.ndarray:
        """Return minus the derivative of `density` over r [1/m^2]."""
        with np.errstate(divide="ignore", invalid="ignore"):
            derivative = 3 * self.scale / self.h * np.maximum(1 - r / self.h, 0) ** 2 / r
        return np.where(r > 0, derivative, 0.0)

    def wall_at(self, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (contribution of a wall to C, its derivative by the distance [1/m])."""
        q = np.clip(distance / self.wall_range, 0, 1)
        return self.wall * (1 - q) ** 3, -3 * self.wall / self.wall_range * (1 - q) ** 2


class _World:
    """Fluids of a scene in three coordinates."""

    def __init__(self, scene: Scene):
        self.scene, self.kernels, self.axes = scene, _Kernels(scene), scene.dimensions
        self.h = scene.method.dt / scene.method.substeps
        self.fine = scene.replace({"method.dt": self.h, "method.substeps": 1})
        self.flow = Flow(scene, self.h)
        self.choose(np.arange(scene.fluid_set.particle_count))

    def choose(self, number: np.ndarray) -> None:
        """Select the particles `number` for all following arrays."""
        fluid_set = self.scene.fluid_set
        self.fluid = fluid_set.fluid[number]
        self.weight = np.array(fluid_set.lightness)[self.fluid]

    def of(self, field: str) -> np.ndarray:
        """Return a field of each particle's fluid; a missing value is infinite."""
        values = [getattr(part, field) for part in self.scene.fluids.values()]
        return np.array([np.inf if value is None else value for value in values], float)[self.fluid]

    def walls(self, p: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
        total, gradient = np.zeros(len(p)), np.zeros_like(p)
        for _, collider in self.scene.colliders:
            distance, normal = fluid_world.distances(collider, p, time)
            contribution, slope = self.kernels.wall_at(distance - collider.thickness)
            of_total, of_contribution = fluid_world.rate(total, contribution), fluid_world.rate(contribution, total)
            gradient = gradient * of_total[:, None] + (slope * of_contribution)[:, None] * normal
            total = fluid_world.joined(total, contribution)
        return total, gradient

    def collide(self, number: int, before: np.ndarray, p: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return fluid_world.collide(self.fine, before, p, v, number)


class _Pairs:
    """Pairs that were neighbours at the beginning of a substep."""

    def __init__(self, world: _World, p: np.ndarray):
        self.world, self.count = world, len(p)
        self.pairs = differences(world.scene, p[:, : world.axes])[0]
        self.i, self.j = self.pairs.T

    def at(self, p: np.ndarray, number: np.ndarray) -> None:
        """Compute differences and distances with particles at `p`; `number`: their places in the arrays."""
        domain, d = self.world.scene.domain, p[self.i] - p[self.j]
        for axis in domain.repeats if domain else ():
            k = "xyz".index(axis)
            assert domain is not None
            d[:, k] -= domain.size[k] * np.round(d[:, k] / domain.size[k])
        self.bare = np.linalg.norm(d, axis=1)
        short = 1e-4 * self.world.kernels.h
        together = self.bare < short
        d[together, 1] = np.where(number[self.i] < number[self.j], -short, short)[together]
        self.d, self.r = d, np.linalg.norm(d, axis=1)
        self.s = self.world.kernels.slope(self.r)

    def sum(self, of_i: np.ndarray, of_j: np.ndarray) -> np.ndarray:
        """Return the sums of the pairs' contributions to their first and to their second particle."""
        shape = (self.count, *of_i.shape[1:])
        total = np.zeros(shape)
        np.add.at(total, self.i, of_i)
        np.add.at(total, self.j, of_j)
        return total


def _places(world: _World, p: np.ndarray) -> np.ndarray:
    """Return the places (n,) of particles in arrays sorted by cells; only coincident particles depend on them."""
    return np.argsort(np.lexsort((np.arange(len(p)), p[:, 0], p[:, 1], p[:, 2])))


def _solve(world: _World, number: int, x: np.ndarray, p: np.ndarray, pairs: _Pairs) -> tuple[np.ndarray, ...]:
    """Return (positions, constraints, multipliers [m^2]) after a substep's iterations."""
    method, weight = world.scene.method, world.weight
    end, place = (number + 1) * world.h, _places(world, p)
    averaged = method.scheme == "averaged"
    pairs.at(p, place)
    g = -pairs.s[:, None] * pairs.d
    _, wall = world.walls(p, end)
    square = (g**2).sum(axis=1)
    from_others = pairs.sum(weight[pairs.j] * square, weight[pairs.i] * square)
    across = pairs.sum(g, -g) + wall
    below = weight * (across**2).sum(axis=1) + from_others
    part = method.relaxation_factor / (world.kernels.neighbours if averaged else 1)
    factor = part / (below + method.softness / world.kernels.h**2)
    multiplier = np.zeros(len(p))
    for _ in range(method.iterations):
        pairs.at(p, place)
        kernel = world.kernels.density(pairs.bare)
        contribution, wall = world.walls(p, end)
        c = pairs.sum(kernel, kernel) - world.kernels.rest + contribution
        if averaged:
            delta = np.minimum(-factor * c, 0)
        else:
            delta = np.minimum(multiplier - factor * c, 0) - multiplier
        multiplier = multiplier + delta
        both = delta[pairs.i] + delta[pairs.j]
        if method.tensile_correction:
            h, at = world.kernels.h, method.tensile_distance
            ratio = np.maximum(1 - (pairs.r / h) ** 2, 0) ** 3 / (1 - at**2) ** 3
            both = both - method.tensile_correction * h**2 * ratio**4
        displacement = -(both * pairs.s)[:, None] * pairs.d
        total = pairs.sum(displacement, -displacement) + delta[:, None] * wall
        p, _ = world.collide(number, x, p + weight[:, None] * total, np.zeros_like(p))
    pairs.at(p, place)
    return p, c, multiplier


def _carried(pairs: _Pairs, multiplier: np.ndarray) -> np.ndarray:
    """Return the weighted mean of the multipliers of each particle's pairs."""
    weights = pairs.s * pairs.r**2
    mean = (multiplier[pairs.i] + multiplier[pairs.j]) / 2 * weights
    return np.asarray(pairs.sum(mean, mean) / np.maximum(pairs.sum(weights, weights), 1e-300))


def _smooth(world: _World, p: np.ndarray, v: np.ndarray, pairs: _Pairs) -> np.ndarray:
    """Return velocities after viscosity, cohesion, surface tension and vorticity confinement of neighbours."""
    scene, h, weight = world.scene, world.kernels.h, world.weight
    i, j = pairs.i, pairs.j
    pairs.at(p, _places(world, p))

    def mean(values: np.ndarray) -> np.ndarray:
        return (values[i] + values[j]) / 2

    viscosity = np.minimum(world.of("viscosity") / world.of("density") * world.h / world.kernels.spread, 1)
    factor = mean(viscosity) * 2 / (weight[i] + weight[j]) * world.kernels.kernel(pairs.r)
    change = factor[:, None] * (v[j] - v[i])
    smoothing = weight[:, None] * pairs.sum(change, -change)
    density = next(iter(scene.fluids.values())).density
    q, direction = pairs.r / h, pairs.d / np.maximum(pairs.r, 1e-300)[:, None]
    spline = np.where(q > 0.5, 64 * (1 - q) ** 3 * q**3, 128 * (1 - q) ** 3 * q**3 - 1)
    spline = np.where(q < 1, spline, 0)
    pulls = -(mean(world.of("cohesion")) * spline)[:, None] * direction * world.h / (density * h**2)
    g = -pairs.s[:, None] * pairs.d
    normal = pairs.sum(g, -g)
    flat = -mean(world.of("surface_tension"))[:, None] * (normal[i] - normal[j]) * world.h / (density * h)
    new = v + smoothing + weight[:, None] * pairs.sum(pulls + flat, -pulls - flat)
    strength = world.of("vorticity_confinement") * world.h
    if strength.any():
        curl = np.cross(v[j] - v[i], g)
        curl = pairs.sum(curl, curl)
        length = np.linalg.norm(curl, axis=1)
        rise = (length[j] - length[i])[:, None] * g
        rise = pairs.sum(rise, rise)
        steep = np.linalg.norm(rise, axis=1)
        toward = rise / np.where(steep > 0, steep, 1)[:, None]
        new = new + strength[:, None] * np.cross(toward, curl)
    return new


def substep(world: _World, number: int, x: np.ndarray, v: np.ndarray, who: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return (numbers of the remaining particles, position, velocity, constraints, multipliers) after a substep.

    All in three coordinates; `who`: numbers of the particles before."""
    world.choose(who)
    scene, h = world.scene, world.h
    gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    fastest = np.minimum(world.of("maximum_speed"), world.kernels.h / 2 / h)

    def limited(velocity: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(velocity, axis=1)
        return velocity * np.where(speed > fastest, fastest / np.where(speed > 0, speed, 1), 1)[:, None]

    def accelerated(velocity: np.ndarray) -> np.ndarray:
        u = velocity.copy()
        u[:, 1] -= h * gravity * world.of("buoyancy")
        return limited(u)

    def braked(velocity: np.ndarray, c: np.ndarray) -> np.ndarray:
        rate = world.of("drag") + world.of("free_surface_drag") * np.clip(-c, 0, 1)
        return np.asarray(velocity / (1 + h * rate)[:, None])

    if scene.method.scheme == "divergence-free":
        _, x = _wrapped(world, x, x)
        pairs = _Pairs(world, x)
        solver = DivergenceFree(world, number, x, pairs, _places(world, x))
        v, multiplier = solver.substep(v, lambda u, c: accelerated(braked(_smooth(world, x, u, pairs), c)))
        v = limited(v)
        settled = fluid_impact.without_rebound(world, number, x, v, solver.second_start, solver.second)
        p, v = world.collide(number, x, x + h * v, settled)
        v = limited(v)
        pairs.at(p, _places(world, p))
        return who, p, v, solver.c, _carried(pairs, multiplier)
    u = accelerated(v)
    p, x = _wrapped(world, x + h * u, x)
    p, _ = world.collide(number, x, p, u)
    left = ~world.flow.ended(p)
    who, x, p, u = who[left], x[left], p[left], u[left]
    world.choose(who)
    fastest = np.minimum(world.of("maximum_speed"), world.kernels.h / 2 / h)
    pairs = _Pairs(world, p)
    p, c, multiplier = _solve(world, number, x, p, pairs)
    carried = _carried(pairs, multiplier)
    p, v = world.collide(number, x, p, fluid_impact.velocities(world, number, x, u, p, multiplier))
    return who, p, limited(braked(_smooth(world, p, v, pairs), c)), c, carried


def _wrapped(world: _World, p: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions p, and x with them, shifted by whole sides so that p is in the periodic box."""
    p, x, domain = p.copy(), x.copy(), world.scene.domain
    for axis in domain.repeats if domain else ():
        k = "xyz".index(axis)
        assert domain is not None
        low, side = domain.origin[k], domain.size[k]
        shift = np.where(p[:, k] < low, side, np.where(p[:, k] >= low + side, -side, 0))
        p[:, k], x[:, k] = p[:, k] + shift, x[:, k] + shift
    return p, x


def run(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, first_step: int = 0
) -> tuple[np.ndarray, ...]:
    """Return (position, velocity (n, dimensions), density errors (n,), pressures (n,) [Pa]) after `steps` steps.

    Errors and pressures are those of the last substep."""
    world, axes = _World(scene), scene.dimensions
    p, v = (np.pad(np.array(array, np.float64), ((0, 0), (0, 3 - axes))) for array in (position, velocity))
    c, multiplier = np.zeros((2, len(p)))
    for number in range(first_step * scene.method.substeps, (first_step + steps) * scene.method.substeps):
        world.flow.emit(number, p, v)
        there = np.flatnonzero(scene.fluid_set.there(p))
        left, *values = substep(world, number, p[there], v[there], there)
        Flow.park(p, v, np.setdiff1d(there, left))
        c, multiplier = np.zeros((2, len(p)))
        p[left], v[left], c[left], multiplier[left] = values
    pressure = -multiplier * next(iter(scene.fluids.values())).density / world.h**2
    return p[:, :axes], v[:, :axes], c, pressure


def simulate(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, first_step: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (particles, dimensions) float64, after `steps` steps from the given ones."""
    values = run(scene, steps, position, velocity, first_step)
    return values[0], values[1]
