"""Contribution of solids to a fluid's density constraint: samples of their surfaces or bodies count as neighbours.

A sample of volume psi, in volumes of a particle of the fluid, is psi particles in one place: it adds psi times the
kernel to C_i, and psi times the slope to its gradient (N. Akinci et al., "Versatile Rigid-Fluid Coupling for
Incompressible SPH", SIGGRAPH 2012, eqs. 3 to 5). It has no constraint of its own. A fluid particle's constraint moves
both by its gradient, and the push on a sample goes to the particles that carry it, by their inverse masses (M. Macklin
et al., "Unified Particle Physics for Real-Time Applications", SIGGRAPH 2014, 7.1). The effects on both particles of a
pair are equal and opposite. The pressure in a sample is not mirrored, as Akinci's is (there, eq. 9): a fluid comes as
near as it must to bear the pressure, and so leaves no gap, by which a body would displace more than its volume.

Each particle and each sample has a `volume` (1 for a particle), a `grip` (0 for a particle; for a sample psi over the
iterations of a substep) and a `lightness`. d, s, t: as in model/formulas/fluid/density.py.
"""

from __future__ import annotations

from softlab.model.base.variant import formula

OPERATIONS_DENSITY = 15  # a neighbour
OPERATIONS_FACTORS = 37
OPERATIONS_CORRECT = 45
LEAST = 1e-6  # of two weights together, so that their quotient is finite


@formula
def counted(total, volume, t):
    """Sum plus the kernel of a neighbour of that volume; t: `closeness`."""
    return total + volume * ((t * t) * t)


@formula
def counted_slope(volume, s):
    """Slope [1/m^2] of a neighbour of that volume."""
    return volume * s


@formula
def carried(lightness, volume):
    """Mobility of a neighbour, as the `weight` of squares_added: a sample's lightness times its volume squared."""
    return lightness * (volume * volume)


@formula
def both(change, other_change, volume, other_volume):
    """Sum of both multipliers' changes, as correction_added expects it. A sample's change is 0."""
    return change * other_volume + other_change * volume


@formula
def rub(t, viscosity, other_viscosity, weight, other_weight, grip, other_grip):
    """Fraction of a difference of displacements that a particle and a sample take from each other in an iteration,
    for weight 1.

    It is that of XSPH with the fluid's viscosity, as if the fluid stuck to the solid, and 0 for any other pair.
    """
    mean = (viscosity + other_viscosity) * (2.0 / max(weight + other_weight, LEAST))
    return (mean * (grip + other_grip)) * ((t * t) * t)


@formula
def rub_added(total, weight, displacement, other_displacement):
    """Sum of corrections plus that of `rub`, one axis. Displacements: in the substep [m]."""
    return total + weight * (other_displacement - displacement)


@formula
def middle(x, y, z, a, b, c):
    """Position of a sample between three particles at x, y, z, with the weights a, b, c, one axis."""
    return (a * x + b * y) + c * z


@formula
def carried_on(total, weight, correction):
    """Push on a particle of a solid plus that on one more sample that it carries, one axis."""
    return total + weight * correction
