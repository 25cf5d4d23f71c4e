"""Effects of neighbours on a fluid's velocities, for CPU threads (model/fluid/plan.py, 7 and 8)."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.fluid.cells import row_of
from softlab.cpu_backend.fluid.lists import wrap
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.variant import FEATURE, routine
from softlab.model.fluid.parameters import F_COHESION, F_CONFINEMENT, F_TENSION, F_VISCOSITY, F_WEIGHT
from softlab.model.formulas.fluid.density import apart, gradient_added, near, slope, squared
from softlab.model.formulas.fluid.motion import (
    confined,
    curl_added,
    pull,
    pull_added,
    rise_added,
    smooth_added,
    smoothed,
    smoothing_weight,
    speed_of,
    tension_added,
)


@routine
def difference(i, j, capacity, place, sides, support):
    """Return the difference of two positions and its square."""
    dx, dy, dz = (
        place[i] - place[j],
        place[capacity + i] - place[capacity + j],
        place[2 * capacity + i] - place[2 * capacity + j],
    )
    dx, dy, dz = wrap(dx, dy, dz, sides)
    dy = apart(dy, squared(dx, dy, dz), support, i < j)
    return dx, dy, dz, squared(dx, dy, dz)


@routine
def shapes(i, entries, place, world, sides):
    """Write the normal and the vorticity of particle i, whose neighbours begin at entries[0]."""
    capacity, velocity, fluid, parameters = (
        world.sizes.capacity,
        world.in_order.velocity,
        world.in_order.fluid,
        world.parameters,
    )
    normal, curl, _ = world.unsorted
    support, inverse, scale = parameters.support, parameters.inverse_support, parameters.gradient_scale
    nx, ny, nz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    vx, vy, vz = velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
    for k in range(world.lists.neighbours[i]):
        j = np.int64(entries[k * LANES])
        if FEATURE.solids and fluid[j] == parameters.sampled:
            continue
        dx, dy, dz, square = difference(i, j, capacity, place, sides, support)
        s = slope(square, inverse, scale)
        if FEATURE.surface_tension:
            nx, ny, nz = gradient_added(nx, s, dx), gradient_added(ny, s, dy), gradient_added(nz, s, dz)
        if FEATURE.vorticity:
            ux, uy, uz = velocity[j], velocity[capacity + j], velocity[2 * capacity + j]
            wx = curl_added(wx, s, dy, dz, vy, vz, uy, uz)
            wy = curl_added(wy, s, dz, dx, vz, vx, uz, ux)
            wz = curl_added(wz, s, dx, dy, vx, vy, ux, uy)
    normal[i], normal[capacity + i], normal[2 * capacity + i] = nx, ny, nz
    curl[i], curl[capacity + i], curl[2 * capacity + i] = wx, wy, wz


@routine
def smooth(i, entries, place, world, sides):
    """Return the velocity of particle i after viscosity, cohesion, surface tension and vorticity confinement."""
    capacity, velocity, fluid, fluids = (
        world.sizes.capacity,
        world.in_order.velocity,
        world.in_order.fluid,
        world.fluids,
    )
    parameters, (normal, curl, _) = world.parameters, world.unsorted
    support, inverse, scale = parameters.support, parameters.inverse_support, parameters.gradient_scale
    vx, vy, vz = velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
    mx, my, mz, fx, fy, fz, rx, ry, rz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    row = row_of(fluid, i)
    weight, length = fluids[row + F_WEIGHT], 0.0
    if FEATURE.vorticity:
        length = speed_of(curl[i], curl[capacity + i], curl[2 * capacity + i])
    for k in range(world.lists.neighbours[i]):
        j = np.int64(entries[k * LANES])
        dx, dy, dz, square = difference(i, j, capacity, place, sides, support)
        other = row_of(fluid, j)
        if FEATURE.solids and fluid[j] == parameters.sampled:
            continue
        if FEATURE.viscosity:
            smoothing = smoothing_weight(
                near(square, inverse), fluids[row + F_VISCOSITY], fluids[other + F_VISCOSITY], weight,
                fluids[other + F_WEIGHT],
            )  # fmt: skip
            mx = smooth_added(mx, smoothing, vx, velocity[j])
            my = smooth_added(my, smoothing, vy, velocity[capacity + j])
            mz = smooth_added(mz, smoothing, vz, velocity[2 * capacity + j])
        if FEATURE.cohesion:
            drawn = pull(square, inverse, fluids[row + F_COHESION], fluids[other + F_COHESION])
            fx, fy, fz = pull_added(fx, drawn, dx), pull_added(fy, drawn, dy), pull_added(fz, drawn, dz)
        if FEATURE.surface_tension:
            tension_here, its = fluids[row + F_TENSION], fluids[other + F_TENSION]
            fx = tension_added(fx, tension_here, its, normal[i], normal[j])
            fy = tension_added(fy, tension_here, its, normal[capacity + i], normal[capacity + j])
            fz = tension_added(fz, tension_here, its, normal[2 * capacity + i], normal[2 * capacity + j])
        if FEATURE.vorticity:
            s = slope(square, inverse, scale)
            its = speed_of(curl[j], curl[capacity + j], curl[2 * capacity + j])
            rx, ry = rise_added(rx, s, dx, length, its), rise_added(ry, s, dy, length, its)
            rz = rise_added(rz, s, dz, length, its)
    vx, vy, vz = smoothed(vx, mx, weight, fx), smoothed(vy, my, weight, fy), smoothed(vz, mz, weight, fz)
    if FEATURE.vorticity:
        steep, strength = speed_of(rx, ry, rz), fluids[row + F_CONFINEMENT]
        wx, wy, wz = curl[i], curl[capacity + i], curl[2 * capacity + i]
        vx = confined(vx, strength, steep, ry, rz, wy, wz)
        vy = confined(vy, strength, steep, rz, rx, wz, wx)
        vz = confined(vz, strength, steep, rx, ry, wx, wy)
    return vx, vy, vz
