"""Shear modulus of the lattice on which a fluid starts, and notes on bodies and fluids that this resistance keeps in
place.

A uniform pressure is one multiplier for all constraints C, so that a lattice under pressure has the energy of
sum k(r), k(r) = (1 - r / support)^3, over its pairs. Its second derivative by a shear that keeps the volume is the shear
modulus, its first by the volume minus the pressure: the ratio of the two depends on support / rest_distance alone. A
fluid has 0. A lattice holds denser fluid above a lighter one, and a body that would rise, as far as its modulus and the
strain at which it yields allow, however fine or short the substeps, whatever the viscosity.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from math import ceil

import numpy as np

from softlab.model.geometry.arithmetic.ordered import norm, total
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import AMONG_BODIES

SUPPORTED_SHEAR = 1.0  # shear of a fluid's lattice below which it may support a body (tests/world/test_rising.py)
NEUTRAL = 1e-3  # relative difference of densities at which a body has no weight in a fluid to speak of
FLOWS = 0.05  # of the pressure: largest modulus at which denser fluid sinks through lighter (tests/fluid/test_fluid_shear.py)


@cache
def shear_over_pressure(across: float, axes: int) -> tuple[float, float]:
    """Return the two shear moduli of a cubic lattice over its pressure, of a shear along its axes and along their diagonals.

    `across`: support over rest distance. With F = diag(exp(g/2), exp(-g/2), 1), d(r^2)/dg = x^2 - y^2 and
    d^2(r^2)/dg^2 = x^2 + y^2 at g = 0; along the diagonals 2 x y takes the place of x^2 - y^2. Negative: the lattice is
    unstable. All directions of shear lie between the two.
    """
    cells = ceil(across)
    places = np.array(list(product(range(-cells, cells + 1), repeat=axes)), np.float64)
    r = norm(places)
    places, r = places[(r > 0) & (r < across)], r[(r > 0) & (r < across)]
    near = 1 - r / across
    slope, curvature = -3 * near**2 / across, 6 * near / across**2
    x, y = places[:, 0], places[:, 1]
    pressure = -total(slope * r) / axes

    def modulus(first: np.ndarray) -> float:
        second = x * x + y * y
        bent = slope * (second / (2 * r) - first**2 / (4 * r**3)) + curvature * first**2 / (4 * r * r)
        return float(total(bent) / pressure)

    return modulus(x * x - y * y), modulus(2 * x * y)


def largest_shear(scene: Scene) -> float:
    """Return the larger shear modulus over pressure of a scene's fluids."""
    fluids = scene.fluid_set
    return max(shear_over_pressure(fluids.support / fluids.spacing, scene.dimensions))


def shear_lines(scene: Scene) -> list[str]:
    """Return notes on denser fluid that starts above a lighter one, and on bodies in a fluid, where its lattice resists."""
    world = scene
    scene = scene.members.get("fluid", scene) if scene.is_world else scene
    if not scene.fluids or not (scene.gravity and scene.gravity.enabled):
        return []
    if largest_shear(scene) <= FLOWS:
        return _supported_bodies(world, scene) if world.is_world else []
    bodies = {"bodies", "tetrahedra"} & world.members.keys() if world.is_world else set()
    fluids, freely = scene.fluid_set, max(shear_over_pressure(AMONG_BODIES, scene.dimensions))
    note = (
        f"on its lattice a fluid resists shear by up to {largest_shear(scene):.2g} of its pressure with this support "
        f"({fluids.support / fluids.spacing:.3g} rest distances; {freely:.2g} with support = "
        f"{AMONG_BODIES * fluids.spacing:g}): "
    )
    lines = [f"{above}: {note}it may stay above {below}, which is lighter" for above, below in _stacked(scene)]
    return lines + [f"{next(iter(scene.fluids))}: {note}bodies rise and sink in it too slowly"] * bool(bodies)


def _supported_bodies(world: Scene, fluid: Scene) -> list[str]:
    """Return notes on submerged bodies of particles whose weight in the fluid its lattice may support.

    A box of the sides a and b, whose density differs from the fluid's by the fraction e, is held by the shear stress
    e rho g a b / (2 (a + b)) on its sides. There, at the depth z, the lattice has the modulus `largest_shear` rho g z.
    """
    fluids = fluid.fluid_set
    water = fluids.position[fluids.there(fluids.position)]
    buoyant_density = fluids.parts[0].density * fluids.parts[0].buoyancy
    if "bodies" not in world.members or not len(water) or buoyant_density <= 0:
        return []
    top, bodies = water[:, 1].max() + fluids.spacing / 2, world.members["bodies"].body_set
    lines: dict[str, str] = {}
    for copy in bodies.copies:
        position, spacing = bodies.position[copy.particles], copy.baked.spacing
        low, high = position.min(axis=0) - spacing / 2, position.max(axis=0) + spacing / 2
        if copy.waits or high[1] > top:
            continue
        (a, _, b), depth = high - low, top - (low[1] + high[1]) / 2
        density = bodies.masses[copy.particles].sum() / (len(position) * spacing**3)
        excess = abs(density / buoyant_density - 1)
        strain = excess * a * b / (2 * (a + b)) / (largest_shear(fluid) * depth)
        if excess > NEUTRAL and 0 < strain < SUPPORTED_SHEAR:
            lines[copy.name] = (
                f"{copy.name}: the lattice of {fluids.names[0]} supports the body's weight in it at a shear of {strain:.2g}: "
                "it rises or sinks too slowly, or stays where it is; a body whose density differs more does not"
            )
    return list(lines.values())


def _stacked(scene: Scene) -> list[tuple[str, str]]:
    """Return the pairs of fluids (above, below) of which the first is denser and starts on top of the second."""
    fluids, names = scene.fluid_set, list(scene.fluids)
    there = fluids.there(fluids.position)
    boxes = {}
    for number, name in enumerate(names):
        position = fluids.position[there & (fluids.fluid == number)]
        if len(position):
            boxes[name] = position.min(axis=0), position.max(axis=0)

    def on_top(above: str, below: str) -> bool:
        (low, high), (other_low, other_high) = boxes[above], boxes[below]
        level = [axis for axis in range(scene.dimensions) if axis != 1]
        beside = any(low[axis] > other_high[axis] or high[axis] < other_low[axis] for axis in level)
        return not beside and bool(low[1] > other_high[1])

    density = {name: part.density * part.buoyancy for name, part in scene.fluids.items()}
    pairs = [(above, below) for above in boxes for below in boxes]
    return [(above, below) for above, below in pairs if density[above] > density[below] and on_top(above, below)]
