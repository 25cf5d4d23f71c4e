"""Operations of a position-based solver on one mass, as routines: its accelerations, and its long-range attachments.

Masses are quads: x, y, z and the weight w, 0 if pinned, 1, or the sheet's mass over the mass's own if the scene has a
`load`. In a plane z stays 0 and is not computed. constraints.py and gather.py have constraints.
"""

from __future__ import annotations

from softlab.gpu_backend.core.forces import add, add_gravity, add_particle_force
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.wind import wind_sum
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.formulas.distance import tether, tethered
from softlab.model.formulas.lengths import squared_length_3d


@inlined_routine
def add_wind(a, position, velocity, k, cell, p, v, parameters, air):
    """Return the acceleration `a` of mass k and that of the wind on it [m/s^2]."""
    if FEATURE.wind:
        a = add(a, p[3], wind_sum(position, velocity, k, cell, p, v, parameters, air))
    return a


@inlined_routine
def accelerate(position, velocity, k, cell, p, v, parameters, integers, step, air):
    """Return the acceleration [m/s^2] of mass k without constraints, at p and with velocity v (quads), at the start of
    the substep."""
    a = add_gravity(0.0, 0.0, 0.0, parameters)
    ax, ay, az = add_wind(a, position, velocity, k, cell, p, v, parameters, air)
    return add_particle_force(ax, ay, az, k, p[3], parameters, integers, step)


@inlined_routine
def tether_mass(p, weight, position, anchors, reaches, first, count):
    """Return the position (x, y, z) after the long-range attachments of one mass, the nearest first.

    They are numbers `first` ... `first + count - 1` of the flat arrays of anchors (masses) and maximum distances [m].
    Anchors are pinned: any array of positions has them.
    """
    x, y, z = p[0], p[1], p[2]
    if weight != 0.0:
        for n in range(count):
            a = load_quad(position, anchors[first + n])
            dx, dy, dz = x - a[0], y - a[1], z - a[2]
            factor = tether(squared_length_3d(dx, dy, dz), reaches[first + n])
            x, y, z = tethered(x, a[0], dx, factor), tethered(y, a[1], dy, factor), tethered(z, a[2], dz, factor)
    return x, y, z
