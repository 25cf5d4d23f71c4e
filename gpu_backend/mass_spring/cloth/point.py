"""The forces on one mass of a cloth, as routines.

Each thread sums its up to twelve neighbours' pulls, and the wind on the six triangles that it is a corner of. Sums are
computed as on the CPU: a kind's springs in pairs, (structural + shear) + bending, then gravity, wind, external, poke,
damping. A neighbour beyond the edge is the mass itself, which neither pulls itself nor spans a triangle: no branch at
the edges. Kernels are compiled for the parts of a scene: an absent part leaves no instruction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.gpu_backend.core.forces import add_gravity, particle_features, with_forces
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.wind import wind_sum
from softlab.model.base.types import Feature
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
from softlab.model.contact.cloth_parameters import spring_constants
from softlab.model.core.integrators import step_formula
from softlab.model.formulas.implicit import end_pull_3d, product_3d
from softlab.model.formulas.springs import damped, damped_pull_3d, spring_acceleration_3d
from softlab.model.mass_spring.plan import sheet_features
from softlab.model.tables.cloth import SPRING_KINDS

ONE, TWO, NO_STEP = np.int32(1), np.int32(2), np.int64(0)
# of `pull`, for a kind of springs: names of their constants; whether they have a damper; its formula
k_stiffness, k_rest, k_damping = Open("k_stiffness: a name"), Open("k_rest: a name"), Open("k_damping: a name")
has_damper, at_end = Open("has_damper: a bool"), Open("at_end: a bool")
damper_pull = Open("damper_pull(dx, dy, dz, wx, wy, wz, stiffness, rest, damping)")
structural_pull, shear_pull, bending_pull = (
    Open(f"{kind}_pull(position, velocity, other, p, v, parameters): of `pulls_of`") for kind in SPRING_KINDS
)


@inlined_routine
def paired(a, b, c, d):
    """Return (a + b) + (c + d), by axis."""
    return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])


@inlined_routine
def carried(a, b, c, up):
    """Return (a + b) + (c - up): `up` is the pull of the spring above on the mass at its other end."""
    return (a[0] + b[0]) + (c[0] - up[0]), (a[1] + b[1]) + (c[1] - up[1]), (a[2] + b[2]) + (c[2] - up[2])


@inlined_routine
def pull(position, velocity, other, p, v, parameters):
    """Return the pull over mass [m/s^2] of a spring on the mass at p, with the velocity v, from mass `other`."""
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
        return damper_pull(
            dx, dy, dz, w[0] - v[0], w[1] - v[1], w[2] - v[2], stiffness, rest, parameters[k_damping]
        )  # fmt: skip
    return spring_acceleration_3d(dx, dy, dz, stiffness, rest)


@inlined_routine
def structural_sum(position, velocity, place, cell, p, v, parameters):
    # The choices are written as in wind_sum, so that a neighbour that both read is loaded once.
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
    right = structural_pull(position, velocity, place if last else place + ONE, p, v, parameters)
    left = structural_pull(position, velocity, place if first else place - ONE, p, v, parameters)
    below = structural_pull(position, velocity, place if bottom else place + columns, p, v, parameters)
    above = structural_pull(position, velocity, place if top else place - columns, p, v, parameters)
    return paired(right, left, below, above)


@inlined_routine
def shear_sum(position, velocity, place, cell, p, v, parameters):
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
    below_right = shear_pull(
        position, velocity, place if bottom or last else place + columns + ONE, p, v, parameters
    )  # fmt: skip
    above_left = shear_pull(position, velocity, place if top or first else place - columns - ONE, p, v, parameters)
    below_left = shear_pull(position, velocity, place if bottom or first else place + columns - ONE, p, v, parameters)
    above_right = shear_pull(position, velocity, place if top or last else place - columns + ONE, p, v, parameters)
    return paired(below_right, above_left, below_left, above_right)


@inlined_routine
def bending_sum(position, velocity, place, cell, p, v, parameters):
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    right = bending_pull(position, velocity, place + TWO if j < columns - 2 else place, p, v, parameters)
    left = bending_pull(position, velocity, place - TWO if j > 1 else place, p, v, parameters)
    below = bending_pull(position, velocity, place + TWO * columns if i < rows - 2 else place, p, v, parameters)
    above = bending_pull(position, velocity, place - TWO * columns if i > 1 else place, p, v, parameters)
    return paired(right, left, below, above)


@inlined_routine
def spring_sum(position, velocity, place, cell, p, v, parameters):
    """Return the sum of the pulls over mass [m/s^2] on the mass at index `place` of the flat arrays, at p and with
    velocity v (quads)."""
    ax, ay, az = 0.0, 0.0, 0.0
    if FEATURE.structural:
        ax, ay, az = structural_sum(position, velocity, place, cell, p, v, parameters)
    if FEATURE.shear:
        hx, hy, hz = shear_sum(position, velocity, place, cell, p, v, parameters)
        if FEATURE.structural:
            hx, hy, hz = ax + hx, ay + hy, az + hz
        ax, ay, az = hx, hy, hz
    if FEATURE.bending:
        bx, by, bz = bending_sum(position, velocity, place, cell, p, v, parameters)
        if FEATURE.structural or FEATURE.shear:
            bx, by, bz = ax + bx, ay + by, az + bz
        ax, ay, az = bx, by, bz
    return ax, ay, az


@inlined_routine
def steady(position, velocity, place, cell, p, v, parameters, air):
    """Return the acceleration by springs, gravity and wind, which the two combined kicks of velocity Verlet share."""
    ax, ay, az = 0.0, 0.0, 0.0
    if not FEATURE.implicit:
        ax, ay, az = spring_sum(position, velocity, place, cell, p, v, parameters)
    ax, ay, az = add_gravity(ax, ay, az, parameters)
    if FEATURE.wind:
        wx, wy, wz = wind_sum(position, velocity, place, cell, p, v, parameters, air)
        ax, ay, az = ax + wx, ay + wy, az + wz
    return ax, ay, az


@inlined_routine
def damp(ax, ay, az, v, parameters):
    if FEATURE.damping:
        rate = parameters.damping
        ax, ay, az = damped(ax, v[0], rate), damped(ay, v[1], rate), damped(az, v[2], rate)
    return ax, ay, az


@inlined_routine
def current_step(counter, pass_number):
    """Return the number of the step, if anything depends on it."""
    if FEATURE.timed:
        return counter[0] + pass_number
    return NO_STEP


def pulls_of(parts: frozenset[str], system: str = "") -> dict[str, Callable]:
    """Return the pulls of springs by their open names.

    `system`: of implicit Euler, `end` for pulls at the step's end, with the velocity there and the position without it;
    `product` for the product of its matrix with the vector in `velocity`.
    """
    damper = product_3d if system == "product" else damped_pull_3d
    common = {"at_end": system == "end", "damper_pull": damper}
    pulls = {}
    for kind in SPRING_KINDS:
        stiffness, rest, damping = spring_constants(kind)
        names = {"k_stiffness": stiffness, "k_rest": rest, "k_damping": damping}
        has_damper = system != "" or f"{kind}-damping" in parts
        pulls[f"{kind}_pull"] = filled(pull, {**common, **names, "has_damper": has_damper})
    return pulls


def of_scene(kernel: Callable, integrator: str, parts: frozenset[str]) -> Callable:
    """Return a kernel with the springs and forces of a scene and the formula of an integrator."""
    return with_forces(filled(kernel, {**pulls_of(parts), "one_force": step_formula(integrator)}), parts)


def cloth_features(integrator: str, parts: frozenset[str]) -> dict[str, Feature]:
    """Return the features of a cloth's kernels."""
    return {**sheet_features(integrator, parts), **particle_features(parts), "damped": True}
