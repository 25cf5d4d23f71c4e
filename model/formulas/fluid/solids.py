"""What solids add to a fluid's density constraint: samples of their surfaces or bodies count among a particle's neighbours.

A sample of volume psi, in volumes of a particle of the fluid, is psi particles in one place: it adds psi times the kernel to
C_i, and psi times the slope to its gradient (N. Akinci et al., "Versatile Rigid-Fluid Coupling for Incompressible SPH",
SIGGRAPH 2012, eqs. 3 to 5). It has no constraint of its own: a particle's moves both by its gradient, and what a sample is
pushed by goes to the particles that carry it, by their inverse masses (M. Macklin et al., "Unified Particle Physics for
Real-Time Applications", SIGGRAPH 2014, 7.1). What a pair does to both is equal and opposite. The pressure in a sample is not
mirrored, as Akinci's is (there, eq. 9): a fluid comes as near as it must to bear what presses on it, and
so leaves no gap, by which a body would displace more than it holds.

Of each particle and each sample there are `volume` (1 of a particle), `grip` (0; of a sample psi over the iterations of a
substep) and `lightness`. d, s, t: as in model/formulas/fluid/density.py.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

OPERATIONS_DENSITY = 15  # a neighbour
OPERATIONS_FACTORS = 37
OPERATIONS_CORRECT = 45


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    two, least = real(2), real(1e-6)

    @compiled
    def counted(total, volume, t):
        """The sum with the kernel of a neighbour of that volume; t: `closeness`."""
        return total + volume * ((t * t) * t)

    @compiled
    def counted_slope(volume, s):
        """The slope [1/m^2] that a neighbour of that volume makes."""
        return volume * s

    @compiled
    def carried(lightness, volume):
        """What a neighbour gives way by, as `weight` of own_added: a sample's lightness times its volume squared."""
        return lightness * (volume * volume)

    @compiled
    def both(change, other_change, volume, other_volume):
        """The changes of both multipliers, as correction_added wants them; a sample's is 0."""
        return change * other_volume + other_change * volume

    @compiled
    def rub(t, viscosity, other_viscosity, weight, other_weight, grip, other_grip):
        """The share of a difference of ways that a particle and a sample take from each other in an iteration, of one of
        weight 1: that of XSPH with the fluid's viscosity, as if the fluid stuck to the solid. 0 of any other pair."""
        mean = (viscosity + other_viscosity) * (two / max(weight + other_weight, least))
        return (mean * (grip + other_grip)) * ((t * t) * t)

    @compiled
    def rub_added(total, share, way, other_way):
        """One axis of the sum of corrections; ways: how far both have come in the substep [m]."""
        return total + share * (other_way - way)

    @compiled
    def middle(x, y, z, a, b, c):
        """One axis of a sample between three particles at x, y, z, of which it has the shares a, b, c."""
        return (a * x + b * y) + c * z

    @compiled
    def carried_on(total, share, correction):
        """One axis of what a particle of a solid is pushed by, with that of one more sample that it carries."""
        return total + share * correction

    return SimpleNamespace(
        counted=counted, counted_slope=counted_slope, carried=carried, both=both, rub=rub, rub_added=rub_added,
        middle=middle, carried_on=carried_on,
    )  # fmt: skip
