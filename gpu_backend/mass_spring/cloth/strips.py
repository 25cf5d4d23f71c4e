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

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.planes import near, put_near
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.tiling import Tile
from softlab.gpu_backend.core.wind import make_wind
from softlab.gpu_backend.mass_spring.cloth.moves import make_cloth_kicks
from softlab.gpu_backend.mass_spring.cloth.point import make_accelerations
from softlab.gpu_backend.mass_spring.cloth.tiling import fields, needs_velocities, plane_shape, stencil_rows
from softlab.model.base.tuples import reader
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS

WEST, EAST, NORTH, SOUTH, WEST_2, EAST_2, NORTH_2, SOUTH_2 = (1 << n for n in range(8))  # where the sheet continues


def _make_planes(real: Any, math: str, parts: frozenset[str], tile: Tile) -> tuple[Any, Any]:
    """Make make_load(distance) -> load(shared, place) -> (x, y, z, vx, vy, vz), of the mass `distance` places on, and
    make_put(distance, with_velocity) -> put(shared, place, x, y, z, vx, vy, vz)."""
    plane_rows, pitch = plane_shape(tile, parts)
    area, moving, zero, inline = plane_rows * pitch, needs_velocities(parts), real(0), inlined(math)

    def make_load(distance: int) -> Any:
        @inline
        def load(shared, place):
            x, y = near(shared, place, distance), near(shared, place, distance + area)
            z = near(shared, place, distance + 2 * area)
            if moving:
                return (
                    x, y, z, near(shared, place, distance + 3 * area), near(shared, place, distance + 4 * area),
                    near(shared, place, distance + 5 * area),
                )  # fmt: skip
            return x, y, z, zero, zero, zero

        return load

    def make_put(distance: int, with_velocity: bool) -> Any:
        @inline
        def put(shared, place, x, y, z, vx, vy, vz):
            put_near(shared, place, distance, x)
            put_near(shared, place, distance + area, y)
            put_near(shared, place, distance + 2 * area, z)
            if with_velocity:
                put_near(shared, place, distance + 3 * area, vx)
                put_near(shared, place, distance + 4 * area, vy)
                put_near(shared, place, distance + 5 * area, vz)

        return put

    return make_load, make_put


class Window(NamedTuple):
    """Positions of a mass's neighbours."""

    above: Any
    below: Any
    below_2: Any
    left_above: Any
    left: Any
    left_below: Any
    right_above: Any
    right: Any
    right_below: Any


class Places(NamedTuple):
    """Places in a plane of a mass and of its neighbours in the row."""

    here: Any
    west: Any
    east: Any
    west_2: Any
    east_2: Any


class Ups(NamedTuple):
    """Pulls on the masses at the upper ends of the springs to a mass from above, from two above, and to the next one from
    two above."""

    above: Any
    above_2: Any
    next_above_2: Any


def _make_sides(math: str, strip: int) -> tuple[Any, Any]:
    """Make `sides` (see `make_cloth_strips`) and `make_there`."""
    inline = inlined(math)

    @inline
    def sides(cell):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        end = np.int32(i + strip)
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

    def make_there(r: int) -> Any:
        """Make there(sides) of mass r: true if there are masses (above, below, two above, two below)."""
        first, last, near_last = r == 0, r == strip - 1, r == strip - 2

        @inline
        def there(sides):
            north, south, north_2, south_2 = True, True, True, True
            if first:
                north, north_2 = sides & NORTH != 0, sides & NORTH_2 != 0
            if last:
                south, south_2 = sides & SOUTH != 0, sides & SOUTH_2 != 0
            if near_last:
                south_2 = sides & SOUTH != 0
            return north, south, north_2, south_2

        return there

    return sides, make_there


def _make_forces(
    real: Any, math: str, parts: frozenset[str], tile: Tile, make_load: Any, make_there: Any
) -> tuple[Any, Any]:
    """Make `make_springs` and `make_air`, of mass r of a strip."""
    pulls, wind_of = make_accelerations(real, math, parts), make_wind(real, math, parts).wind_of
    structural, shear, bending = pulls.structural, pulls.shear, pulls.bending
    paired, carried = pulls.paired, pulls.carried
    has_structural, has_shear, has_bending = "structural" in parts, "shear" in parts, "bending" in parts
    (_, pitch), zero, inline = plane_shape(tile, parts), real(0), inlined(math)

    def make_springs(r: int) -> Any:
        there, load_here, up_2, first = make_there(r), make_load(r * pitch), make_load((r - 2) * pitch), r == 0

        @inline
        def spring_sum(shared, places, sides, here, ups, window, parameters):
            """Return (sum on mass r, which is `here`; the `ups` of the next mass)."""
            north, south, north_2, south_2 = there(sides)
            west, east = sides & WEST != 0, sides & EAST != 0
            above, below, below_2 = window.above, window.below, window.below_2
            up, up_two, next_up_two = ups.above, ups.above_2, ups.next_above_2
            if first:
                up = structural(here, above, north, parameters)
                up_two = bending(here, up_2(shared, places.here), north_2, parameters)
                next_up_two = bending(below, above, north, parameters)
            down, down_two = structural(below, here, south, parameters), bending(below_2, here, south_2, parameters)
            ax, ay, az = zero, zero, zero
            if has_structural:
                right, left = (
                    structural(window.right, here, True, parameters),
                    structural(window.left, here, True, parameters),
                )
                ax, ay, az = carried(right, left, down, up)
            if has_shear:
                hx, hy, hz = paired(
                    shear(window.right_below, here, east and south, parameters),
                    shear(window.left_above, here, west and north, parameters),
                    shear(window.left_below, here, west and south, parameters),
                    shear(window.right_above, here, east and north, parameters),
                )
                if has_structural:
                    hx, hy, hz = ax + hx, ay + hy, az + hz
                ax, ay, az = hx, hy, hz
            if has_bending:
                right = bending(load_here(shared, places.east_2), here, True, parameters)
                left = bending(load_here(shared, places.west_2), here, True, parameters)
                bx, by, bz = carried(right, left, down_two, up_two)
                if has_structural or has_shear:
                    bx, by, bz = ax + bx, ay + by, az + bz
                ax, ay, az = bx, by, bz
            return (ax, ay, az), Ups(down, next_up_two, down_two)

        return spring_sum

    def make_air(r: int) -> Any:
        there = make_there(r)

        @inline
        def wind_on(sides, here, window, parameters, air):
            north, south, _, _ = there(sides)
            west, east = sides & WEST != 0, sides & EAST != 0
            w = window
            return wind_of(
                here, w.right if east else here, w.below if south else here, w.left if west and south else here,
                w.above if north and east else here, w.right_below if south and east else here, w.left if west else here,
                w.above if north else here, w.left_above if north and west else here, parameters, air,
            )  # fmt: skip

        return wind_on

    return make_springs, make_air


def _make_mass(
    real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile, publish: Callable, planes: Any, there: Any
) -> Any:
    """Make make_mass(r) -> mass(...), the pass of mass r of a strip and of those below it."""
    make_load, make_put = planes
    make_springs, make_air = _make_forces(real, math, parts, tile, make_load, there)
    kicks = make_cloth_kicks(real, math, integrator, parts)
    kick = kicks.get("middle", kicks.get("step"))
    has_gravity, has_wind, has_pins = "gravity" in parts, "wind" in parts, "pins" in parts
    strip, stencil, (_, pitch), moving = (
        tile.strip,
        stencil_rows(parts),
        plane_shape(tile, parts),
        needs_velocities(parts),
    )
    zero, inline = real(0), inlined(math)

    def make_mass(r: int) -> Any:
        spring_sum, wind_on = make_springs(r), make_air(r)
        bit, distance = np.int32(1 << r), r * pitch
        last, put = r == strip - 1, make_put(distance, moving)
        load_below_2 = make_load((r + 3) * pitch if stencil == 2 else r * pitch)
        load_below_next = make_load((r + 2) * pitch)
        after = None if last else make_mass(r + 1)

        @inline
        def mass(
            shared, places, new, sides, active, sending, pin_bits, vx, vy, vz, k, columns, position, world,
            step, air, post, here, ups, window,
        ):  # fmt: skip
            parameters = world.parameters
            (ax, ay, az), next_ups = spring_sum(shared, places, sides, here, ups, window, parameters)
            if has_gravity:
                ay = ay + parameters.gravity
            if has_wind:
                wx, wy, wz = wind_on(sides, here, window, parameters, air)
                ax, ay, az = ax + wx, ay + wy, az + wz
            next_here, next_window = here, window
            if not last:  # loaded before this mass is stored, since no load may overtake a store
                next_here = window.below
                next_window = Window(
                    here, window.below_2 if stencil == 2 else load_below_next(shared, places.here),
                    load_below_2(shared, places.here), window.left, window.left_below, load_below_next(shared, places.west),
                    window.right, window.right_below, load_below_next(shared, places.east),
                )  # fmt: skip
            if active & bit:
                mark = zero
                if has_pins:
                    if pin_bits & bit:
                        mark = load_quad(position, k)[3]
                p, v = (here[0], here[1], here[2], mark), (vx[r], vy[r], vz[r], zero)
                px, py, pz, ux, uy, uz = kick(ax, ay, az, k, p, v, world, step)
                vx[r], vy[r], vz[r] = ux, uy, uz
                put(shared, new, px, py, pz, ux, uy, uz)
                if sending & bit:
                    publish(k, px, py, pz, ux, uy, uz, post)
            if not last:
                after(
                    shared, places, new, sides, active, sending, pin_bits, vx, vy, vz, np.int32(k + columns), columns,
                    position, world, step, air, post, next_here, next_ups, next_window,
                )  # fmt: skip

        return mass

    return make_mass


@cache
def make_cloth_strips(
    real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile, publish: Callable
) -> SimpleNamespace:
    """Make the device functions of a variant on a tile.

    - `constants(parameters)`: the record's values, read once;
    - `put(shared, place, x, y, z, vx, vy, vz)`: store one mass, its velocity if that is stored;
    - `sides(cell)`: the bits WEST ... of a strip whose first mass is in row i and column j;
    - `step(shared, old, new, place, sides, active, sending, pin_bits, vx, vy, vz, k, columns, position, world, number, air,
      post)`: one pass of the masses of the strip whose bit is set in `active`, from the copy of the planes that starts at
      `old` into the one at `new`. `pin_bits`: bits of pinned masses; k: number of the first mass; `publish(k, x, y, z,
      vx, vy,
      vz, post)` is called for those with a bit in `sending`.
    """
    planes, (sides, make_there) = _make_planes(real, math, parts, tile), _make_sides(math, tile.strip)
    make_load, make_put = planes
    first_mass = _make_mass(real, math, integrator, parts, tile, publish, planes, make_there)(0)
    put, (_, pitch) = make_put(0, fields(tile, parts) == 6), plane_shape(tile, parts)
    load_here, load_above, load_below = make_load(0), make_load(-pitch), make_load(pitch)
    load_two_below = make_load(2 * pitch if stencil_rows(parts) == 2 else 0)
    zero, one, two, inline = real(0), np.int32(1), np.int32(2), inlined(math)

    @inline
    def step(
        shared, old, new, place, sides, active, sending, pin_bits, vx, vy, vz, k, columns, position, world,
        number, air, post,
    ):  # fmt: skip
        base = np.int32(old + place)
        west, east = base - one if sides & WEST else base, base + one if sides & EAST else base
        west_2, east_2 = base - two if sides & WEST_2 else base, base + two if sides & EAST_2 else base
        places = Places(base, np.int32(west), np.int32(east), np.int32(west_2), np.int32(east_2))
        window = Window(
            load_above(shared, base), load_below(shared, base), load_two_below(shared, base),
            load_above(shared, places.west), load_here(shared, places.west), load_below(shared, places.west),
            load_above(shared, places.east), load_here(shared, places.east), load_below(shared, places.east),
        )  # fmt: skip
        none = (zero, zero, zero)
        first_mass(
            shared, places, np.int32(new + place), sides, active, sending, pin_bits, vx, vy, vz, k, columns, position, world,
            number, air, post, load_here(shared, base), Ups(none, none, none), window,
        )  # fmt: skip

    return SimpleNamespace(constants=reader(CLOTH_PARAMETERS, inline), put=put, sides=sides, step=step)
