"""Arrays of a fluid for the CPU kernels, by name. A plane has `capacity` numbers (fluid/solver.py); an array of several
values consists of one plane after the other."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Sizes(NamedTuple):
    """Number of active particles, numbers of a plane, slot of a particle that is far away."""

    particles: int
    capacity: int
    nobody: int


class State(NamedTuple):
    """The start of a substep: positions, velocities, numbers and fluids of the active particles."""

    position: np.ndarray
    velocity: np.ndarray
    number: np.ndarray
    fluid: np.ndarray


class Unsorted(NamedTuple):
    """In the order of the state: positions at the substep's start, predicted positions and velocities. `divergence-free`
    uses the planes of `velocity` for the iterate, the multipliers of its second solve and its targets."""

    before: np.ndarray
    position: np.ndarray
    velocity: np.ndarray


class Sorted(NamedTuple):
    """In the order of cells: positions at the substep's start, predicted positions with quads behind them, predicted
    velocities, numbers and fluids. `divergence-free` writes displacements over `before`."""

    before: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    number: np.ndarray
    fluid: np.ndarray


class Work(NamedTuple):
    """Positions of the next iteration with quads behind them, factors, multipliers, corrections, errors of the density,
    gradients of walls."""

    next: np.ndarray
    factor: np.ndarray
    multiplier: np.ndarray
    delta: np.ndarray
    error: np.ndarray
    wall: np.ndarray


class Table(NamedTuple):
    """Boxes of bands, cells of particles, first particle of each cell, order of particles, particles of a band's cells."""

    boxes: np.ndarray
    cell: np.ndarray
    starts: np.ndarray
    order: np.ndarray
    totals: np.ndarray


class Lists(NamedTuple):
    """Neighbour lists: the number of neighbours of each particle, the largest number in each slice, the neighbours by
    slices, and counts: first the neighbours lost in each band, then the velocities that were limited in each."""

    neighbours: np.ndarray
    longest: np.ndarray
    entries: np.ndarray
    counts: np.ndarray


class Scratch(NamedTuple):
    """Scratch of bands: sums by lanes, places and numbers of particles around a cell, runs of cells."""

    sums: np.ndarray
    near: np.ndarray
    who: np.ndarray
    runs: np.ndarray


class Around(NamedTuple):
    """A band's scratch for the particles around a cell: their positions, squared distances and numbers, and the runs of
    cells that they come from."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    squares: np.ndarray
    who: np.ndarray
    runs: np.ndarray


class At(NamedTuple):
    """Time of a pass: number of the step, of the substep since time 0, and of the iteration; number of iterations; True in
    the second solve of `divergence-free`."""

    step: int
    number: int
    iteration: int
    iterations: int
    second: bool


class Fluid(NamedTuple):
    """All that the passes of a fluid's substep read and write: the fluid's arrays, its constants, rows of
    model/fluid/parameters.py, integers of model/core/own_forces.py, rows and kinds of colliders; Flow and Solids, or ()."""

    sizes: Sizes
    state: State
    unsorted: Unsorted
    in_order: Sorted
    work: Work
    table: Table
    lists: Lists
    scratch: Scratch
    parameters: Any
    fluids: np.ndarray
    integers: np.ndarray
    bodies: np.ndarray
    kinds: np.ndarray
    flow: Flow | tuple[()]
    solids: Solids | tuple[()]


class Sides(NamedTuple):
    """Side lengths of the periodic box and their halves [m]; 0 without one."""

    x: float
    y: float
    z: float
    half_x: float
    half_y: float
    half_z: float


class Pairs(NamedTuple):
    """Constants of sums over pairs of particles: sides of the periodic box; support radius [m], its inverse, scale of
    gradients, the tensile correction and its inverse kernel."""

    sides: Sides
    support: float
    inverse: float
    scale: float
    tensile: float
    inverse_tensile: float


class Flow(NamedTuple):
    """Arrays of emitters and sinks: number of active particles (1,); particles that were due while all particles of their
    fluid were active (1,); first particle of each fluid (fluids + 1,); 1 if a particle is active, by number (particles,);
    rows of model/fluid/flow.py, flat."""

    particles: np.ndarray
    missed: np.ndarray
    starts: np.ndarray
    active: np.ndarray
    emitters: np.ndarray
    points: np.ndarray
    sinks: np.ndarray


class SamplePoints(NamedTuple):
    """Corners of samples, three each, and their weights."""

    corners: np.ndarray
    weights: np.ndarray


class SolidPoints(NamedTuple):
    """Positions of the solids' particles at the substep's start and now, in rows."""

    before: np.ndarray
    position: np.ndarray


class Carriers(NamedTuple):
    """Lightness of the solids' particles; the samples that each of them carries: first of each, samples, weights."""

    lightness: np.ndarray
    offsets: np.ndarray
    samples: np.ndarray
    weights: np.ndarray


class Solids(NamedTuple):
    """Solids that a fluid touches, by samples behind the fluid's particles: number of the fluid's particles; rows of
    `kinds_of` by number, and in the order of cells; slot of each sample; displacements of samples, three planes;
    scratch of bands."""

    fluids: int
    kinds_by_number: np.ndarray
    kinds: np.ndarray
    slots: np.ndarray
    points: SamplePoints
    places: SolidPoints
    carriers: Carriers
    shift: np.ndarray
    sums: np.ndarray
