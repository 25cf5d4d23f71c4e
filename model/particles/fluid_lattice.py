"""Scales of a fluid's kernels: sums over the initial lattice, which must be an equilibrium.

Kernels: M. Mueller, D. Charypar and M. Gross, SCA 2003: poly6 and the slope of the spiky one, of unit integral in space
and in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import ceil, pi

import numpy as np

from softlab.model.geometry.arithmetic.functions import whole_power
from softlab.model.geometry.arithmetic.ordered import norm, total

POLY6 = {2: 4 / pi, 3: 315 / (64 * pi)}  # for a support of 1
SPIKY = {2: 30 / pi, 3: 45 / pi}  # scale of its slope


def poly6(distance: np.ndarray, support: float, axes: int) -> np.ndarray:
    """Return W [1/m^axes] at a distance [m]."""
    q = np.minimum(np.asarray(distance, np.float64) / support, 1.0)
    return np.asarray(POLY6[axes] / whole_power(support, axes) * whole_power(1 - q * q, 3))


def spiky_slope(distance: np.ndarray, support: float, axes: int) -> np.ndarray:
    """Return -dW/dr [1/m^(axes + 1)] at a distance [m]."""
    q = np.minimum(np.asarray(distance, np.float64) / support, 1.0)
    return np.asarray(SPIKY[axes] / whole_power(support, axes + 1) * (1 - q) ** 2)


def closeness_cubed(distance: np.ndarray, support: float) -> np.ndarray:
    """Return (1 - r / support)^3 at a distance r [m], 0 beyond the support: the kernel of the density constraint."""
    return np.asarray(whole_power(np.maximum(1 - np.asarray(distance, np.float64) / support, 0.0), 3))


@dataclass(frozen=True)
class Lattice:
    """Sums over a lattice of particles `rest_distance` apart [m] with the `support` [m], in `axes` dimensions.

    With k(r) = (1 - r / support)^3 and s(r) = -k'(r) / r, sums over all others of the lattice:

    - `volume` [m^axes]: of a particle, 1 / sum of poly6, itself included; `neighbours`: their number.
    - `kernel_sum`: sum of k; `density_scale` = axes / sum of s r^2: a dilatation e changes scale * sum of k by -axes e,
      as it changes density. `gradient_scale` [1/m] = 3 density_scale / support: slope of scale * k at r = 0.
    - `wall_scale`, `wall_range` [m], `wall_gradient` [1/m] = 3 wall_scale / wall_range: of f(y) = wall_scale (1 - y /
      wall_range)^3 at a distance y from a plane. At half a rest distance f is the density of the layers behind the
      plane, and -f' twice their push, since the pressure in them is the particle's own.
    - `smoothing_scale`: volume * poly6(0); `spread` [m^2]: half the second moment of volume * poly6 along an axis, so
      that the sum of volume * poly6 (v_j - v_i) is `spread` times the Laplacian of v.
    """

    volume: float
    neighbours: int
    kernel_sum: float
    density_scale: float
    gradient_scale: float
    wall_scale: float
    wall_range: float
    wall_gradient: float
    smoothing_scale: float
    spread: float


@cache
def lattice_of(rest_distance: float, support: float, axes: int) -> Lattice:
    """Return the sums, computed in float64."""
    cells = ceil(support / rest_distance)
    places = np.array(list(product(range(-cells, cells + 1), repeat=axes)), np.float64) * rest_distance
    r = norm(places)
    smooth = poly6(r, support, axes)
    volume = 1 / total(smooth)
    spread = volume * total(smooth * places[:, 0] ** 2) / 2
    places, r = places[(r > 0) & (r < support)], r[(r > 0) & (r < support)]
    kernel, slope = closeness_cubed(r, support), 3 * (1 - r / support) ** 2 / support
    density_scale = axes / total(slope * r)
    below = places[:, 1] < 0
    lacks = density_scale * total(kernel[below])
    push = 2 * density_scale * total(slope[below] * -places[below, 1] / r[below])
    wall_range = rest_distance / 2 + 3 * lacks / push
    wall_scale = lacks / whole_power(3 * lacks / push / wall_range, 3)
    return Lattice(
        volume=volume,
        neighbours=len(r),
        kernel_sum=total(kernel),
        density_scale=density_scale,
        gradient_scale=3 * density_scale / support,
        wall_scale=wall_scale,
        wall_range=wall_range,
        wall_gradient=3 * wall_scale / wall_range,
        smoothing_scale=volume * float(poly6(np.zeros(1), support, axes)[0]),
        spread=spread,
    )
