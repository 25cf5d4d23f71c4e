"""Operations of a position-based solver on one mass, as device functions: its prediction, and its velocity afterwards.

Masses are quads: x, y, z and the weight w, 0 if pinned, 1, or the sheet's mass over the mass's own if the scene has a
`load`. In a plane z stays 0 and is not computed. constraints.py and gather.py have constraints.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.forces import make_forces
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.core.wind import make_wind
from softlab.model.base.types import Real
from softlab.model.formulas import distance, lengths


@cache
def make_accelerations(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the accelerations of a sheet's mass without constraints, each -> (ax, ay, az) [m/s^2]: `add_wind(a,
    ...)`; and `accelerate`, wind and own forces."""
    forces, wind_sum = make_forces(real, math, parts), make_wind(real, math, parts).wind_sum
    add, add_gravity, add_particle_force = forces.add, forces.add_gravity, forces.add_particle_force
    inline, has_wind, zero = inlined(math), "wind" in parts, real(0)

    @inline
    def add_wind(a, position, velocity, k, cell, p, v, parameters, air):
        if has_wind:
            a = add(a, p[3], wind_sum(position, velocity, k, cell, p, v, parameters, air))
        return a

    @inline
    def accelerate(position, velocity, k, cell, p, v, parameters, integers, step, air):
        """Return the acceleration of mass k in row i, column j, at p and with velocity v (quads), at the start of the
        substep."""
        a = add_gravity(zero, zero, zero, parameters)
        ax, ay, az = add_wind(a, position, velocity, k, cell, p, v, parameters, air)
        return add_particle_force(ax, ay, az, k, p[3], parameters, integers, step)

    return SimpleNamespace(add_wind=add_wind, accelerate=accelerate)


@cache
def make_tethers(real: Real, math: str) -> Callable:
    """Make tether_mass(p, weight, position, anchors, reaches, first, count) -> (x, y, z): the position after the
    long-range attachments of one mass, the nearest first.

    They are numbers `first` ... `first + count - 1` of the flat arrays of anchors (masses) and maximum distances [m].
    Anchors are pinned: any array of positions has them.
    """
    formulas = device_formulas(distance, real, math)
    tether, tethered = formulas.tether, formulas.tethered
    squared_length = device_formulas(lengths, real, math).squared_length_3d
    zero = real(0)

    @inlined(math)
    def tether_mass(p, weight, position, anchors, reaches, first, count):
        x, y, z = p[0], p[1], p[2]
        if weight != zero:
            for n in range(count):
                a = load_quad(position, anchors[first + n])
                dx, dy, dz = x - a[0], y - a[1], z - a[2]
                factor = tether(squared_length(dx, dy, dz), reaches[first + n])
                x, y, z = (
                    tethered(x, a[0], dx, factor), tethered(y, a[1], dy, factor), tethered(z, a[2], dz, factor),
                )  # fmt: skip
        return x, y, z

    return tether_mass
