"""What a fluid's kernels are scaled by: sums over the lattice on which it starts, where nothing is to move.

Kernels: M. Mueller, D. Charypar and M. Gross, SCA 2003: poly6 and the slope of the spiky one, of unit integral in space and
in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import ceil, pi

import numpy as np

from model.geometry.arithmetic.functions import whole_power
from model.geometry.arithmetic.ordered import norm, total

POLY6 = {2: 4 / pi, 3: 315 / (64 * pi)}  # of support 1
SPIKY = {2: 30 / pi, 3: 45 / pi}  # of its slope


def poly6(distance: np.ndarray, support: float, axes: int) -> np.ndarray:
    """W [1/m^axes] at a distance [m]."""
    q = np.minimum(np.asarray(distance, np.float64) / support, 1.0)
    return np.asarray(POLY6[axes] / whole_power(support, axes) * whole_power(1 - q * q, 3))


def spiky_slope(distance: np.ndarray, support: float, axes: int) -> np.ndarray:
    """-dW/dr [1/m^(axes + 1)] at a distance [m]."""
    q = np.minimum(np.asarray(distance, np.float64) / support, 1.0)
    return np.asarray(SPIKY[axes] / whole_power(support, axes + 1) * (1 - q) ** 2)


@dataclass(frozen=True)
class Lattice:
    """Of a lattice of particles `rest_distance` apart [m] that see as far as `support` [m], in so many `axes`.

    `volume` [m^axes]: of a particle, 1 / sum of W, itself included; `density_scale`: volume * W(0); `gradient_scale` [1/m]:
    volume times the slope at 0, times what makes the pressure of such a lattice what it is in a continuum (sum of volume *
    slope * r is `axes`); `wall_scale`, `wall_gradient` [1/m]: so that a particle of the layer next to a plane, half a rest
    distance away, lacks nothing and is not pushed (see model/formulas/fluid/density.py); `spread` [m^2]: half the second
    moment of volume * W along an axis, so that sum of volume * W (v_j - v_i) is that times the Laplacian of v.
    """

    volume: float
    density_scale: float
    gradient_scale: float
    wall_scale: float
    wall_gradient: float
    spread: float


@cache
def lattice_of(rest_distance: float, support: float, axes: int) -> Lattice:
    """The sums, in float64."""
    reach = ceil(support / rest_distance)
    places = np.array(list(product(range(-reach, reach + 1), repeat=axes)), np.float64) * rest_distance
    r = norm(places)
    kernel = poly6(r, support, axes)
    volume = 1 / total(kernel)
    slope = spiky_slope(r, support, axes)
    calibrated = axes / (volume * total(slope * r))
    gradient_scale = volume * float(spiky_slope(np.zeros(1), support, axes)[0]) * calibrated
    below = places[:, 1] < 0
    pushed = volume * calibrated * total(slope[below] * -places[below, 1] / r[below])
    q = rest_distance / 2 / support
    return Lattice(
        volume=volume,
        density_scale=volume * float(poly6(np.zeros(1), support, axes)[0]),
        gradient_scale=gradient_scale,
        wall_scale=volume * total(kernel[below]) / whole_power(1 - q, 5),
        wall_gradient=pushed / whole_power(1 - q, 4),
        spread=volume * total(kernel * places[:, 0] ** 2) / 2,
    )
