"""XPBD on a grid or a cloth in slow, plain NumPy float64: the reference of both backends.

From the papers, without model/formulas, model/build or a backend: Macklin, Mueller, Chentanez, XPBD: Position-Based
Simulation of Compliant Constrained Dynamics, 2016 (eq. 17, 18, 26); Macklin et al., Small Steps in Physics Simulation,
2019 (substeps). A spring of stiffness k is the constraint C = |d| - L with the compliance alpha = 1/k; with a damper
beta along it [N s/m] it is one implicit Euler step h of

 m p'' = sum over constraints (k C + beta C') d / |d|  +  other forces,

except for the rotation of d / |d| within the step. The multiplier of a constraint is force times -h^2 [kg m]; it is 0
at the beginning of a substep and persists through its iterations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot

import numpy as np

from softlab.bench.reference import cloth, mass_spring
from softlab.bench.reference.philox import random_directions
from softlab.bench.reference.steps import Poke, Settle, pinned_mask
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene

# ascending: one constraint at a time from the first mass on, which is not parallel; for tests
ORDERINGS = ("gauss-seidel", "ascending", "jacobi", "weighted-jacobi", "averaged-jacobi")

# (rows, columns) from one end of a constraint to the other -> the positions of its two colours in the order of all. The
# first end is the upper one, of two in a row the left one; (1, -1) goes from (i, j + 1) to (i + 1, j). All directions
# from even rows to odd ones come first, then those from odd rows to even ones: two rows at a time are involved.
COLOURS = {(1, 0): (0, 3), (1, 1): (1, 4), (1, -1): (2, 5), (0, 1): (6, 7), (2, 0): (8, 9), (0, 2): (10, 11)}


@dataclass(frozen=True)
class Direction:
    """Common values of the constraints along one direction; stiffnesses may differ between constraints (see `sheet`)."""

    rest_length: float  # m
    compliance: float | np.ndarray  # m/N, 0: inextensible
    damping: float = 0.0  # N s/m


@dataclass(frozen=True)
class Constraints:
    """Distance constraints, (constraints,) each, with their colours; no two of one colour share a mass."""

    first: np.ndarray  # particle
    second: np.ndarray
    rest_length: np.ndarray  # m
    compliance: np.ndarray  # m/N
    damping: np.ndarray  # N s/m
    colour: np.ndarray

    def valence(self, particles: int) -> np.ndarray:
        """Return the number of constraints of each mass, pinned or not: (particles,)."""
        return np.bincount(np.concatenate([self.first, self.second]), minlength=particles)

    @cached_property
    def colours(self) -> list[np.ndarray]:
        """Indices of the constraints of every colour, in order."""
        return [np.flatnonzero(self.colour == colour) for colour in np.unique(self.colour)]

    @cached_property
    def ascending(self) -> list[np.ndarray]:
        """Every constraint by itself, ordered by its first mass, then by its second."""
        return list(np.lexsort((self.second, self.first))[:, None])


@dataclass(frozen=True)
class Substep:
    """Result of a substep: (particles, dimensions) each, and the multipliers (constraints,) [kg m]."""

    position: np.ndarray  # m
    velocity: np.ndarray  # m/s
    predicted: np.ndarray  # m, positions without constraints
    iterated: np.ndarray  # m, positions before colliders
    multipliers: np.ndarray


def sheet(rows: int, columns: int, directions: dict[tuple[int, int], Direction]) -> Constraints:
    """Return the constraints of a sheet; particle i * columns + j is the mass (i, j).

    A compliance may be an array that broadcasts to the (rows, columns) of the constraints along its direction, in the
    order of `bench.reference.cloth.ends`."""
    number = np.arange(rows * columns).reshape(rows, columns)
    groups = []
    for direction, colours in COLOURS.items():
        if direction not in directions:
            continue
        first, second = cloth.ends(number, direction)
        i, j = np.indices(first.shape)
        along, stride = (i, direction[0]) if direction[0] else (j, direction[1])
        common = directions[direction]
        values = (common.rest_length, common.compliance, common.damping, np.where(along // stride % 2, *colours[::-1]))
        groups.append([np.ravel(a) for a in (first, second, *(np.broadcast_to(a, first.shape) for a in values))])
    if not groups:
        groups = [[np.zeros(0, kind) for kind in (int, int, float, float, float, int)]]
    first, second, rest_length, compliance, damping, colour = (np.concatenate(a) for a in zip(*groups, strict=True))
    return Constraints(first, second, rest_length, compliance, damping, colour)


def of_scene(scene: Scene, inextensible: bool = False) -> Constraints:
    """Return the scene's springs as constraints, with compliance 1/stiffness, or 0 if `inextensible`."""
    grid = scene.grid
    directions: dict[tuple[int, int], Direction] = {}
    if scene.springs:
        for direction in ((1, 0), (0, 1)):
            k = np.full((grid.rows, grid.columns), scene.springs.stiffness)
            np.moveaxis(k, 1 if direction[1] else 0, 0)[1::2] *= scene.springs.stiffness_ratio
            directions[direction] = Direction(
                scene.springs.rest_length, 0.0 if inextensible else 1 / cloth.ends(k, direction)[0]
            )
    for kind, springs in scene.cloth_springs.items():
        for direction in cloth.OFFSETS[kind]:
            compliance = 0.0 if inextensible else 1 / springs.stiffness
            directions[direction] = Direction(grid.spacing * hypot(*direction), compliance, springs.damping)
    return sheet(grid.rows, grid.columns, directions)


def _stretched(
    constraints: Constraints, which: np.ndarray, position: np.ndarray, before: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (C + gamma times the elongation (n,), a~ = alpha/h^2, gamma = alpha beta/h (eq. 26), d/|d| (n, k)).

    The elongation is C - C_before, which is invariant under rotation, and not eq. 26's grad C . (x - x_before).
    Coincident masses have no direction: 0."""
    a, b = constraints.first[which], constraints.second[which]
    d = position[b] - position[a]
    length = np.sqrt(np.einsum("nk,nk->n", d, d))[:, None]
    direction = np.divide(d, length, out=np.zeros_like(d), where=length > 0)
    alpha = constraints.compliance[which]
    gamma = alpha * constraints.damping[which] / h
    lengthening = length[:, 0] - np.linalg.norm(before[b] - before[a], axis=1)
    return length[:, 0] - constraints.rest_length[which] + gamma * lengthening, alpha / h**2, gamma, direction


def iterate(
    constraints: Constraints,
    position: np.ndarray,
    multipliers: np.ndarray,
    before: np.ndarray,
    inverse_mass: np.ndarray,
    h: float,
    ordering: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position (particles, dimensions) [m], multipliers [kg m]) after one iteration over all constraints.

    `before` is the position at the beginning of the substep, `inverse_mass` (particles,) [1/kg] is 0 where pinned.
    gauss-seidel goes colour by colour. jacobi takes all constraints at one position and divides each one's change of
    multiplier by the larger valence of its ends: it converges, but n iterations give 1 - (1 - 1/valence)^n of a soft
    spring's force however short the substep. weighted-jacobi only multiplies the inverse masses by the valences, which
    is enough: the denominator is the sum of its row in the system (eq. 17), so the error shrinks (Gershgorin), and a
    soft spring is exact at once. averaged-jacobi keeps the whole change and divides the masses' displacements by their
    own valence: with compliance it converges to another stiffness, and it does not conserve momentum. A constraint
    between coincident or pinned masses is skipped."""
    p, multipliers = position.copy(), multipliers.copy()
    valence = constraints.valence(len(p))
    if ordering == "gauss-seidel":
        together = constraints.colours
    else:
        together = constraints.ascending if ordering == "ascending" else [np.arange(len(constraints.first))]
    for which in together:
        a, b = constraints.first[which], constraints.second[which]
        stretch, compliance, gamma, n = _stretched(constraints, which, p, before, h)
        weight = inverse_mass[a] + inverse_mass[b]
        if ordering == "weighted-jacobi":
            weight = valence[a] * inverse_mass[a] + valence[b] * inverse_mass[b]
        projected = n.any(axis=1) & (weight > 0)
        change = np.divide(
            -stretch - compliance * multipliers[which],
            (1 + gamma) * weight + compliance,
            out=np.zeros(len(which)),
            where=projected,
        )
        if ordering == "jacobi":
            change /= np.maximum(valence[a], valence[b])
        multipliers[which] += change
        scale = 1 / valence if ordering == "averaged-jacobi" else np.ones(len(p))
        np.subtract.at(p, a, (scale[a] * inverse_mass[a] * change)[:, None] * n)
        np.add.at(p, b, (scale[b] * inverse_mass[b] * change)[:, None] * n)
    return p, multipliers


def substep(
    constraints: Constraints,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray | float,
    inverse_mass: np.ndarray,
    h: float,
    iterations: int,
    ordering: str = "gauss-seidel",
    drag: np.ndarray | float = 0.0,
    settle: Settle = lambda before, p, v: (p, v),
) -> Substep:
    """Return one substep of `h` [s] (XPBD 2016, algorithm 1) from `position` [m] and `velocity` [m/s].

    `acceleration` [m/s^2] and the damper `drag` = c/m [1/s] act on the prediction, the damper on the velocity before
    the acceleration: damping the velocity that gravity has just added would leave a hanging chain at (1 - h c/m) of its
    load. `settle` applies colliders, given the position before the substep, the iterated one and the velocity between
    them. Positions and velocities are (particles, dimensions)."""
    if ordering not in ORDERINGS:
        raise SceneError("method.ordering", ordering, f"one of {', '.join(ORDERINGS)}")
    free = (inverse_mass > 0)[:, None]
    before = position
    v = np.where(free, velocity * (1 - h * drag) + h * acceleration, 0.0)
    predicted = before + h * v
    p, multipliers = predicted, np.zeros(len(constraints.first))
    for _ in range(iterations):
        p, multipliers = iterate(constraints, p, multipliers, before, inverse_mass, h, ordering)
    settled, v = settle(before, p, (p - before) / h)
    return Substep(settled, np.where(free, v, 0.0), predicted, p, multipliers)


def residuals(
    constraints: Constraints, state: Substep, before: np.ndarray, inverse_mass: np.ndarray, h: float
) -> tuple[float, float]:
    """Return (largest |C + a~ lambda| [m], largest |M (x - x~) - grad C' lambda| of the free masses [kg m]).

    C includes the damper's term. XPBD 2016, eq. 9 and 8: both are 0 for converged iterations. For the iterated
    position, before colliders."""
    every = np.arange(len(constraints.first))
    stretch, compliance, _, n = _stretched(constraints, every, state.iterated, before, h)
    a, b = constraints.first, constraints.second
    projected = n.any(axis=1) & (inverse_mass[a] + inverse_mass[b] > 0)
    along = state.multipliers[:, None] * n
    balance = np.zeros_like(state.position)
    free = inverse_mass > 0
    balance[free] = (state.iterated - state.predicted)[free] / inverse_mass[free, None]
    np.add.at(balance, a, along)
    np.subtract.at(balance, b, along)
    first = np.abs(np.where(projected, stretch + compliance * state.multipliers, 0.0))
    return float(first.max(initial=0.0)), float(np.abs(balance[free]).max(initial=0.0))


def accelerations(
    scene: Scene, p: np.ndarray, v: np.ndarray, time: float, frame: int, poke: Poke | None, mass: np.ndarray
) -> np.ndarray:
    """Return all accelerations but those of constraints and the masses' damper: (particles, dimensions) [m/s^2]."""
    grid, dimensions = scene.grid, scene.dimensions
    force = np.zeros_like(p)
    if scene.wind:
        shape = (grid.rows, grid.columns, dimensions)
        force += cloth.wind_forces(scene, p.reshape(shape), v.reshape(shape), time).reshape(p.shape)
    if scene.external and scene.external.magnitude > 0:
        directions = random_directions(scene.external.seed, frame, len(p), axes=dimensions)
        force += scene.external.magnitude * directions.reshape(p.shape)
    if poke is not None and poke[0] is not None:
        force[poke[0]] += poke[1]
    force /= mass[:, None]
    if scene.gravity and scene.gravity.enabled:
        force[:, 1] -= scene.gravity.acceleration
    return force


def simulate(
    scene: Scene,
    steps: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    poke: Poke | None = None,
    *,
    substeps: int = 1,
    iterations: int = 1,
    ordering: str = "gauss-seidel",
    inextensible: bool = False,
    masses: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]) after `steps` steps of `method.dt`, (particles, dimensions) float64 each.

    Arguments and order as in bench.reference.mass_spring.simulate. `masses` (particles,) [kg] replaces the scene's. A
    random force is constant over a whole step; wind and colliders follow the time of every substep."""
    begin, at_rest = mass_spring.start(scene)
    p = begin if position is None else np.array(position, dtype=np.float64)
    v = at_rest if velocity is None else np.array(velocity, dtype=np.float64)
    mass = np.full(len(p), scene.grid.mass) if masses is None else np.asarray(masses, dtype=np.float64)
    inverse_mass = np.where(pinned_mask(scene).ravel(), 0.0, 1 / mass)
    drag = (scene.damping.coefficient if scene.damping else 0.0) / mass[:, None]
    constraints, h = of_scene(scene, inextensible), scene.method.dt / substeps
    fine, shape = scene.replace({"method.dt": h}), (scene.grid.rows, scene.grid.columns, scene.dimensions)

    def collided(number: int) -> Settle:
        def settle(before: np.ndarray, p: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if not scene.colliders:
                return p, v
            p, v = cloth.collide(fine, before.reshape(shape), p.reshape(shape), v.reshape(shape), number)
            return p.reshape(-1, 3), v.reshape(-1, 3)

        return settle

    for number in range(steps * substeps):
        a = accelerations(scene, p, v, number * h, number // substeps, poke, mass)
        state = substep(constraints, p, v, a, inverse_mass, h, iterations, ordering, drag, collided(number))
        p, v = state.position, state.velocity
    return p, v
