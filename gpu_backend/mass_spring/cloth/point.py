"""The forces on one mass of a cloth, as device functions.

Each thread sums its up to twelve neighbours' pulls, and the wind on the six triangles that it is a corner of. Sums are
computed as on the CPU: a kind's springs in pairs, (structural + shear) + bending, then gravity, wind, external, poke,
damping. A neighbour beyond the edge is the mass itself, which neither pulls itself nor spans a triangle: no branch at
the edges. Functions are compiled for the parts of a scene: flags are closure constants, an absent part leaves no
instruction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.forces import make_forces
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import knows_time
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.wind import make_wind
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import (
    CLOTH_PARAMETERS,
    spring_constants,
)
from softlab.model.formulas import implicit, springs
from softlab.model.tables.cloth import SPRING_KINDS


@cache
def _make_paired(math: str) -> Callable:
    @inlined(math)
    def paired(a, b, c, d):
        """Return (a + b) + (c + d), by axis."""
        return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])

    return paired


@cache
def make_cloth_springs(real: Real, math: str, parts: frozenset[str], system: str = "") -> Callable:
    """Make spring_sum(position, velocity, place, cell, p, v, parameters): the pulls of all springs over mass [m/s^2].

    They act on the mass at index `place` of the flat arrays, at p and with velocity v (quads). `system`: of implicit
    Euler, `end` for pulls at the step's end, with the velocity there and the position without it; `product` for the
    product of its matrix with the vector in `velocity`.
    """
    pulls, of_system = device_formulas(springs, real, math), device_formulas(implicit, real, math)
    spring_acceleration_3d, end_pull_3d, at_end = pulls.spring_acceleration_3d, of_system.end_pull_3d, system == "end"
    damped_pull_3d = of_system.product_3d if system == "product" else pulls.damped_pull_3d
    has_structural, has_shear, has_bending = "structural" in parts, "shear" in parts, "bending" in parts
    zero, one, two, inline = real(0), np.int32(1), np.int32(2), inlined(math)

    def make_pull(kind: str) -> Callable:
        k_stiffness, k_rest, k_damping = spring_constants(kind)
        has_damper = system != "" or f"{kind}-damping" in parts

        @inline
        def pull(position, velocity, other, p, v, parameters):
            q = load_quad(position, other)
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            stiffness, rest = parameters[k_stiffness], parameters[k_rest]
            if has_damper:
                w = load_quad(velocity, other)
                if at_end:
                    return end_pull_3d(
                        dx, dy, dz, w[0] - v[0], w[1] - v[1], w[2] - v[2], stiffness, rest, parameters[k_damping],
                        parameters.dt,
                    )  # fmt: skip
                return damped_pull_3d(
                    dx, dy, dz, w[0] - v[0], w[1] - v[1], w[2] - v[2], stiffness, rest, parameters[k_damping]
                )  # fmt: skip
            return spring_acceleration_3d(dx, dy, dz, stiffness, rest)

        return pull

    structural_pull, shear_pull, bending_pull = (make_pull(kind) for kind in SPRING_KINDS)
    paired = _make_paired(math)

    @inline
    def structural_sum(position, velocity, place, cell, p, v, parameters):
        # The choices are written as in wind_sum, so that a neighbour that both read is loaded once.
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        right = structural_pull(position, velocity, place if last else place + one, p, v, parameters)
        left = structural_pull(position, velocity, place if first else place - one, p, v, parameters)
        below = structural_pull(position, velocity, place if bottom else place + columns, p, v, parameters)
        above = structural_pull(position, velocity, place if top else place - columns, p, v, parameters)
        return paired(right, left, below, above)

    @inline
    def shear_sum(position, velocity, place, cell, p, v, parameters):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        below_right = shear_pull(
            position, velocity, place if bottom or last else place + columns + one, p, v, parameters
        )  # fmt: skip
        above_left = shear_pull(position, velocity, place if top or first else place - columns - one, p, v, parameters)
        below_left = shear_pull(
            position, velocity, place if bottom or first else place + columns - one, p, v, parameters
        )
        above_right = shear_pull(position, velocity, place if top or last else place - columns + one, p, v, parameters)
        return paired(below_right, above_left, below_left, above_right)

    @inline
    def bending_sum(position, velocity, place, cell, p, v, parameters):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        right = bending_pull(position, velocity, place + two if j < columns - 2 else place, p, v, parameters)
        left = bending_pull(position, velocity, place - two if j > 1 else place, p, v, parameters)
        below = bending_pull(position, velocity, place + two * columns if i < rows - 2 else place, p, v, parameters)
        above = bending_pull(position, velocity, place - two * columns if i > 1 else place, p, v, parameters)
        return paired(right, left, below, above)

    @inline
    def spring_sum(position, velocity, place, cell, p, v, parameters):
        ax, ay, az = zero, zero, zero
        if has_structural:
            ax, ay, az = structural_sum(position, velocity, place, cell, p, v, parameters)
        if has_shear:
            hx, hy, hz = shear_sum(position, velocity, place, cell, p, v, parameters)
            if has_structural:
                hx, hy, hz = ax + hx, ay + hy, az + hz
            ax, ay, az = hx, hy, hz
        if has_bending:
            bx, by, bz = bending_sum(position, velocity, place, cell, p, v, parameters)
            if has_structural or has_shear:
                bx, by, bz = ax + bx, ay + by, az + bz
            ax, ay, az = bx, by, bz
        return ax, ay, az

    return spring_sum


@cache
def make_accelerations(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `structural`, `shear`, `bending`: pull(q, p, there, values) on the mass p by a spring to q, both (x, y, z,
    vx, vy, vz); none unless `there`. And the sums by axis `paired`, `carried`."""
    formulas = device_formulas(springs, real, math)
    spring_acceleration_3d, damped_pull_3d = formulas.spring_acceleration_3d, formulas.damped_pull_3d
    inline = inlined(math)
    zero = real(0)

    def make_pull(kind: str) -> Callable:
        k_stiffness, k_rest, k_damping = (CLOTH_PARAMETERS.index(name) for name in spring_constants(kind))
        has_springs, has_damper = kind in parts, f"{kind}-damping" in parts

        @inline
        def pull(q, p, there, parameters):
            if not has_springs:
                return zero, zero, zero
            stiffness, rest = parameters[k_stiffness] if there else zero, parameters[k_rest] if there else zero
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            if has_damper:
                damping = parameters[k_damping] if there else zero
                return damped_pull_3d(dx, dy, dz, q[3] - p[3], q[4] - p[4], q[5] - p[5], stiffness, rest, damping)
            return spring_acceleration_3d(dx, dy, dz, stiffness, rest)

        return pull

    @inline
    def carried(a, b, c, up):
        """Return (a + b) + (c - up): `up` is the pull of the spring above on the mass at its other end."""
        return (a[0] + b[0]) + (c[0] - up[0]), (a[1] + b[1]) + (c[1] - up[1]), (a[2] + b[2]) + (c[2] - up[2])

    return SimpleNamespace(
        structural=make_pull("structural"), shear=make_pull("shear"), bending=make_pull("bending"), carried=carried,
        paired=_make_paired(math),
    )  # fmt: skip


@cache
def make_cloth_forces(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the device functions of a variant: `steady`, `add_particle_force`, `damp`, `current_step`.

    `steady`: springs, gravity, wind, which the two combined kicks of velocity Verlet share; then `add_particle_force`
    (core/forces.py) and `damp`, each (ax, ay, az, ...) -> (ax, ay, az).
    """
    spring_sum, winds = make_cloth_springs(real, math, parts), make_wind(real, math, parts)
    wind_sum = winds.wind_sum
    forces = make_forces(real, math, parts)
    add_gravity, add_particle_force = forces.add_gravity, forces.add_particle_force
    damped = device_formulas(springs, real, math).damped
    inline = inlined(math)
    has_wind, has_damping, has_time = "wind" in parts, "damping" in parts, knows_time(parts)
    no_step = np.int64(0)

    @inline
    def steady(position, velocity, place, cell, p, v, parameters, air):
        ax, ay, az = spring_sum(position, velocity, place, cell, p, v, parameters)
        ax, ay, az = add_gravity(ax, ay, az, parameters)
        if has_wind:
            wx, wy, wz = wind_sum(position, velocity, place, cell, p, v, parameters, air)
            ax, ay, az = ax + wx, ay + wy, az + wz
        return ax, ay, az

    @inline
    def damp(ax, ay, az, v, parameters):
        if has_damping:
            rate = parameters.damping
            ax, ay, az = damped(ax, v[0], rate), damped(ay, v[1], rate), damped(az, v[2], rate)
        return ax, ay, az

    @inline
    def current_step(counter, pass_number):
        """Return the number of the step, if anything depends on it."""
        if has_time:
            return counter[0] + pass_number
        return no_step

    return SimpleNamespace(
        spring_sum=spring_sum, wind_sum=wind_sum, air_now=winds.air_now, steady=steady, add_particle_force=add_particle_force,
        damp=damp, current_step=current_step,
    )  # fmt: skip
