"""The step of a tile of a cloth: positions in shared memory, velocities in the registers of each mass's thread.

A thread owns `strip` masses below one another. Going down, it stores the three masses of its own and of both next
columns that springs still need, so that a neighbour is read once for several masses, and passes the pulls of the
springs along its column on to the masses at their other ends with the sign changed. The planes x, y, z (and of the
velocity, if neighbours need it) are stored twice in shared memory: a step reads one copy and writes the other, so one
barrier per step is enough. In `exact` math the sums are those of mass_spring/cloth/point.py.

At the sheet's edges a spring without a mass at its other end has the stiffness 0, or along a row the mass itself as its
neighbour: no branch. Shared memory beyond the edges is 0, a finite number.

The masses of a strip are separate functions, each of which calls the next: indices of registers are then constants,
whether the compiler unrolls loops or not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.gpu_backend.core.planes import near, put_near
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.wind import wind_of
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.mass_spring.cloth.moves import kick
from softlab.gpu_backend.mass_spring.cloth.point import carried, k_damping, k_rest, k_stiffness, paired
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS, spring_constants
from softlab.model.formulas.springs import damped_pull_3d, spring_acceleration_3d
from softlab.model.tables.cloth import SPRING_KINDS

WEST, EAST, NORTH, SOUTH, WEST_2, EAST_2, NORTH_2, SOUTH_2 = (1 << n for n in range(8))  # where the sheet continues
ONE, TWO = np.int32(1), np.int32(2)
# of `mass`: what differs between the masses of a strip
number = Open("number: of the mass in its strip")
is_first, is_last, is_near_last = Open("is_first: a bool"), Open("is_last: a bool"), Open("is_near_last: a bool")
after = Open("after: `mass` of the next mass; of the last one None")
first_mass = Open("first_mass: `mass` of the strip's first mass")
publish = Open("publish(k, x, y, z, vx, vy, vz, post): sends a mass")
has_springs, has_damper = Open("has_springs: a bool"), Open("has_damper: a bool")
structural, shear, bending = (
    Open(f"{kind}(q, p, there, parameters): `pull_between` of a kind of springs") for kind in SPRING_KINDS
)


class Window(NamedTuple):
    """Positions of a mass's neighbours."""

    above: tuple[float, ...]
    below: tuple[float, ...]
    below_2: tuple[float, ...]
    left_above: tuple[float, ...]
    left: tuple[float, ...]
    left_below: tuple[float, ...]
    right_above: tuple[float, ...]
    right: tuple[float, ...]
    right_below: tuple[float, ...]


class Places(NamedTuple):
    """Places in a plane of a mass and of its neighbours in the row."""

    here: int
    west: int
    east: int
    west_2: int
    east_2: int


class Strip(NamedTuple):
    """The masses of a thread in a pass: bits WEST ... of where the sheet continues; bits of the masses that move, that
    are sent and that are pinned; velocities in registers."""

    sides: int
    active: int
    sending: int
    pinned: int
    vx: np.ndarray
    vy: np.ndarray
    vz: np.ndarray


class Moment(NamedTuple):
    """Values that all masses of a pass read: positions in device memory, with the marks of pins; number of the step; velocity
    of the air; where masses are sent to."""

    position: np.ndarray
    world: World
    step: int
    air: tuple[float, float, float]
    post: tuple[np.ndarray, np.ndarray, int, int]


class Ups(NamedTuple):
    """Pulls on the masses at the upper ends of the springs to a mass from above, from two above, and to the next one from
    two above."""

    above: tuple[float, float, float]
    above_2: tuple[float, float, float]
    next_above_2: tuple[float, float, float]


@inlined_routine
def load(shared, place, distance):
    """Return (x, y, z, vx, vy, vz) of the mass `distance` places on."""
    x, y = near(shared, place, distance), near(shared, place, distance + FEATURE.area)
    z = near(shared, place, distance + 2 * FEATURE.area)
    if FEATURE.neighbour_velocities:
        return (
            x, y, z, near(shared, place, distance + 3 * FEATURE.area), near(shared, place, distance + 4 * FEATURE.area),
            near(shared, place, distance + 5 * FEATURE.area),
        )  # fmt: skip
    return x, y, z, 0.0, 0.0, 0.0


@inlined_routine
def put_position(shared, place, distance, x, y, z):
    put_near(shared, place, distance, x)
    put_near(shared, place, distance + FEATURE.area, y)
    put_near(shared, place, distance + 2 * FEATURE.area, z)


@inlined_routine
def put_velocity(shared, place, distance, vx, vy, vz):
    put_near(shared, place, distance + 3 * FEATURE.area, vx)
    put_near(shared, place, distance + 4 * FEATURE.area, vy)
    put_near(shared, place, distance + 5 * FEATURE.area, vz)


@inlined_routine
def put(shared, place, x, y, z, vx, vy, vz):
    """Store one mass, its velocity if that is stored."""
    put_position(shared, place, 0, x, y, z)
    if FEATURE.fields == 6:
        put_velocity(shared, place, 0, vx, vy, vz)


@inlined_routine
def pull_between(q, p, there, parameters):
    """Return the pull on the mass p by a spring to q, both (x, y, z, vx, vy, vz); none unless `there`."""
    if not has_springs:
        return 0.0, 0.0, 0.0
    stiffness, rest = parameters[k_stiffness] if there else 0.0, parameters[k_rest] if there else 0.0
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    if has_damper:
        damping = parameters[k_damping] if there else 0.0
        return damped_pull_3d(dx, dy, dz, q[3] - p[3], q[4] - p[4], q[5] - p[5], stiffness, rest, damping)
    return spring_acceleration_3d(dx, dy, dz, stiffness, rest)


@inlined_routine
def sides(cell):
    """Return the bits WEST ... of a strip whose first mass is in row i and column j."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    end = np.int32(i + FEATURE.strip)
    bits = np.int32(0)
    bits |= WEST if j > 0 else 0
    bits |= EAST if j < columns - 1 else 0
    bits |= NORTH if i > 0 else 0
    bits |= SOUTH if end < rows else 0
    bits |= WEST_2 if j > 1 else 0
    bits |= EAST_2 if j < columns - 2 else 0
    bits |= NORTH_2 if i > 1 else 0
    bits |= SOUTH_2 if end < rows - 1 else 0
    return np.int32(bits)


@inlined_routine
def there(sides):
    """Return True if there are masses (above, below, two above, two below)."""
    north, south, north_2, south_2 = True, True, True, True
    if is_first:
        north, north_2 = sides & NORTH != 0, sides & NORTH_2 != 0
    if is_last:
        south, south_2 = sides & SOUTH != 0, sides & SOUTH_2 != 0
    if is_near_last:
        south_2 = sides & SOUTH != 0
    return north, south, north_2, south_2


@inlined_routine
def spring_sum(shared, places, sides, here, ups, window, parameters):
    """Return (sum on mass r, which is `here`; the `ups` of the next mass)."""
    north, south, north_2, south_2 = there(sides)
    west, east = sides & WEST != 0, sides & EAST != 0
    above, below, below_2 = window.above, window.below, window.below_2
    up, up_two, next_up_two = ups.above, ups.above_2, ups.next_above_2
    if is_first:
        up = structural(here, above, north, parameters)
        up_two = bending(here, load(shared, places.here, (number - 2) * FEATURE.pitch), north_2, parameters)
        next_up_two = bending(below, above, north, parameters)
    down, down_two = structural(below, here, south, parameters), bending(below_2, here, south_2, parameters)
    ax, ay, az = 0.0, 0.0, 0.0
    if FEATURE.structural:
        right, left = (
            structural(window.right, here, True, parameters),
            structural(window.left, here, True, parameters),
        )
        ax, ay, az = carried(right, left, down, up)
    if FEATURE.shear:
        hx, hy, hz = paired(
            shear(window.right_below, here, east and south, parameters),
            shear(window.left_above, here, west and north, parameters),
            shear(window.left_below, here, west and south, parameters),
            shear(window.right_above, here, east and north, parameters),
        )
        if FEATURE.structural:
            hx, hy, hz = ax + hx, ay + hy, az + hz
        ax, ay, az = hx, hy, hz
    if FEATURE.bending:
        right = bending(load(shared, places.east_2, number * FEATURE.pitch), here, True, parameters)
        left = bending(load(shared, places.west_2, number * FEATURE.pitch), here, True, parameters)
        bx, by, bz = carried(right, left, down_two, up_two)
        if FEATURE.structural or FEATURE.shear:
            bx, by, bz = ax + bx, ay + by, az + bz
        ax, ay, az = bx, by, bz
    return (ax, ay, az), Ups(down, next_up_two, down_two)


@inlined_routine
def wind_on(sides, here, window, parameters, air):
    north, south, _, _ = there(sides)
    west, east = sides & WEST != 0, sides & EAST != 0
    w = window
    neighbours = (
        w.right if east else here, w.below if south else here, w.left if west and south else here,
        w.above if north and east else here, w.right_below if south and east else here, w.left if west else here,
        w.above if north else here, w.left_above if north and west else here,
    )  # fmt: skip
    return wind_of(here, neighbours, parameters, air)


@inlined_routine
def mass(shared, places, new, masses, k, columns, moment, here, ups, window):
    """Do a pass of a mass of a strip and of those below it."""
    sides, vx, vy, vz, world = masses.sides, masses.vx, masses.vy, masses.vz, moment.world
    parameters = world.parameters
    (ax, ay, az), next_ups = spring_sum(shared, places, sides, here, ups, window, parameters)
    if FEATURE.gravity:
        ay = ay + parameters.gravity
    if FEATURE.wind:
        wx, wy, wz = wind_on(sides, here, window, parameters, moment.air)
        ax, ay, az = ax + wx, ay + wy, az + wz
    next_here, next_window = here, window
    if not is_last:  # loaded before this mass is stored, since no load may overtake a store
        next_here = window.below
        two, three = (number + 2) * FEATURE.pitch, (number + 3) * FEATURE.pitch
        next_window = Window(
            here, window.below_2 if FEATURE.stencil == 2 else load(shared, places.here, two),
            load(shared, places.here, three if FEATURE.stencil == 2 else number * FEATURE.pitch), window.left,
            window.left_below, load(shared, places.west, two), window.right, window.right_below,
            load(shared, places.east, two),
        )  # fmt: skip
    if masses.active & np.int32(1 << number):
        mark = 0.0
        if FEATURE.pins:
            if masses.pinned & np.int32(1 << number):
                mark = load_quad(moment.position, k)[3]
        p, v = (here[0], here[1], here[2], mark), (vx[number], vy[number], vz[number], 0.0)
        px, py, pz, ux, uy, uz = kick(ax, ay, az, k, p, v, world, moment.step)
        vx[number], vy[number], vz[number] = ux, uy, uz
        put_position(shared, new, number * FEATURE.pitch, px, py, pz)
        if FEATURE.neighbour_velocities:
            put_velocity(shared, new, number * FEATURE.pitch, ux, uy, uz)
        if masses.sending & np.int32(1 << number):
            publish(k, px, py, pz, ux, uy, uz, moment.post)
    if not is_last:
        after(
            shared, places, new, masses, np.int32(k + columns), columns, moment, next_here, next_ups, next_window
        )  # fmt: skip


@inlined_routine
def step_strip(shared, old, new, place, masses, k, columns, moment):
    """Do one pass of the active masses of a Strip, from the copy of the planes that starts at `old` into the one at
    `new`; k: number of the first mass."""
    base, sides = np.int32(old + place), masses.sides
    west, east = base - ONE if sides & WEST else base, base + ONE if sides & EAST else base
    west_2, east_2 = base - TWO if sides & WEST_2 else base, base + TWO if sides & EAST_2 else base
    places = Places(base, np.int32(west), np.int32(east), np.int32(west_2), np.int32(east_2))
    window = Window(
        load(shared, base, -FEATURE.pitch), load(shared, base, FEATURE.pitch),
        load(shared, base, 2 * FEATURE.pitch if FEATURE.stencil == 2 else 0),
        load(shared, places.west, -FEATURE.pitch), load(shared, places.west, 0), load(shared, places.west, FEATURE.pitch),
        load(shared, places.east, -FEATURE.pitch), load(shared, places.east, 0), load(shared, places.east, FEATURE.pitch),
    )  # fmt: skip
    none = (0.0, 0.0, 0.0)
    first_mass(
        shared, places, np.int32(new + place), masses, k, columns, moment, load(shared, base, 0),
        Ups(none, none, none), window,
    )  # fmt: skip


def strip_functions(strip: int, parts: frozenset[str]) -> dict[str, object]:
    """Return the functions for the open names of this file, except `kick` and `publish`."""
    functions: dict[str, object] = {"first_mass": None}
    for r in range(strip - 1, -1, -1):
        places = {"is_first": r == 0, "is_last": r == strip - 1, "is_near_last": r == strip - 2}
        functions["first_mass"] = filled(mass, {"number": r, "after": functions["first_mass"], **places})
    for kind in SPRING_KINDS:
        indices = [CLOTH_PARAMETERS.index(name) for name in spring_constants(kind)]
        names = dict(zip(("k_stiffness", "k_rest", "k_damping"), indices, strict=True))
        flags = {"has_springs": kind in parts, "has_damper": f"{kind}-damping" in parts}
        functions[kind] = filled(pull_between, {**names, **flags})
    return functions
