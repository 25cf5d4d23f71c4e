"""Bending of two triangles that share an edge: a hinge between a and b, with wings c and d, as position-based
constraints.

Triangles are (a, b, c) and (b, a, d), flat where the angle theta between their normals is 0. Both constraints are
lengths [m] that for small angles equal |b - a| theta. Both therefore have the compliance (A_c + A_d) / (3 B) [m/N],
with the areas at rest and the bending stiffness B [N m]. Their energies are those of E. Grinspun et al., "Discrete
Shells", SCA 2003, eq. 2, and of M. Bergou et al., "A Quadratic Bending Model for Inextensible Surfaces", SGP 2006, eq.
4 and 5, which agree there.

`isometric`: the vector k = K0 a + K1 b + K2 c + K3 d of the cotangents at rest. Its length is |b - a| (t_c + t_d),
where t are the wings' directions away from the edge: 2 |b - a| sin(theta/2) while triangles keep their shape. It is
linear, so that its energy is quadratic and one projection is exact. It constrains only the length of k and has no slope
at k = 0, so that scenes need a mesh that is flat at rest (model/position_based/rest_shape.py).

`dihedral`: |b - a| (4 tan(theta/4) - the same at rest). It needs no inverse trigonometric function. It is smooth from
-180 to 180 degrees, where it is 4 instead of pi, and has a derivative everywhere, so that a hinge folded flat still
opens (2 sin(theta/2) has none there). Gradient of theta: R. Bridson, S. Marino, R. Fedkiw, "Simulation of Clothing with
Folds and Wrinkles", SCA 2003, section 4. PBD's own gradient (M. Mueller et al., "Position Based Dynamics", 2006,
appendix A) divides by the sine and is undefined at 0 and 180 degrees.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula
from softlab.model.formulas.lengths import cross, dot, inverse_length, squared_length_3d

OPERATIONS_ISOMETRIC = 75  # 21 for the vector, 10 for its length, 12 for the change, 9 for the weight, 24 to apply
OPERATIONS_DIHEDRAL = 170

NORMAL = OfPrecision(lambda real: 4 * np.finfo(real).tiny)


@formula
def softness(compliance, area):
    """Compliance of the hinge (dimensionless). `compliance`: m / (B h^2) [1/m^2]; `area`: (A_c + A_d) / 3 [m^2]."""
    return compliance * area


@formula
def shifted(position, weight, coefficient, change):
    """Position of a corner after the change, one axis."""
    return position + weight * (coefficient * change)


@formula
def shift(point, weight, gx, gy, gz, change):
    """Position of a corner after the change along its gradient, all axes."""
    x, y, z = point
    return shifted(x, weight, gx, change), shifted(y, weight, gy, change), shifted(z, weight, gz, change)


@formula
def curvature(kb, kc, kd, e, f, g):
    """k [m], one axis. e, f, g: b - a, c - a and d - a; a itself cancels, since the entries of K sum to 0."""
    return (kb * e + kc * f) + kd * g


@formula
def square_sum(wa, wb, wc, wd, ka, kb, kc, kd):
    """Sum over the corners of weight times coefficient squared."""
    return (wa * (ka * ka) + wb * (kb * kb)) + (wc * (kc * kc) + wd * (kd * kd))


@formula
def shortening(x, y, z, rest):
    """Factor that shortens k = (x, y, z) [m] by `rest` [m]. It is 1 where the square of k is below the normal
    numbers, for which `fast` math has no root."""
    squared = squared_length_3d(x, y, z)
    return 1.0 - rest * inverse_length(squared) if squared > NORMAL else 1.0


@formula
def isometric_change(part, k, reciprocal, compliance, multiplier):
    """Change of the multiplier [m], one axis."""
    return (-(part * k) - compliance * multiplier) * reciprocal


@formula
def quarter_tangent(sine, cosine):
    """tan(theta/4) in [-1, 1]. The larger of the half angle's sine and cosine comes from a root, the other one from
    a division, so that neither loses digits."""
    if cosine >= 0.0:
        adjacent = sqrt(0.5 * (1.0 + cosine))
        opposite = 0.5 * sine / adjacent
    else:
        opposite = sqrt(0.5 * (1.0 - cosine))
        adjacent = 0.5 * abs(sine) / opposite
        if sine < 0.0:
            opposite = -opposite
    return opposite / (1.0 + adjacent)


@formula
def hinge(ex, ey, ez, fx, fy, fz, gx, gy, gz):
    """Return (tan(theta/4), gradients of theta [1/m] by c (3) and by d (3), positions of c and of d along the edge
    (2)).

    e, f, g: b - a, c - a, d - a. All are 0 where a triangle has no area. theta > 0: the wings approach each other
    on the side of the normals.
    """
    nx, ny, nz = cross(ex, ey, ez, fx, fy, fz)
    mx, my, mz = cross(gx, gy, gz, ex, ey, ez)
    nn, mm, ee = dot(nx, ny, nz, nx, ny, nz), dot(mx, my, mz, mx, my, mz), dot(ex, ey, ez, ex, ey, ez)
    if not (nn > 0.0 and mm > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    edge = ee * inverse_length(ee)
    over_n, over_m = inverse_length(nn), inverse_length(mm)
    cosine = dot(nx, ny, nz, mx, my, mz) * over_n * over_m
    sine = dot(gx, gy, gz, nx, ny, nz) * edge * over_n * over_m
    t = quarter_tangent(sine, cosine)
    u, v = edge * over_n * over_n, edge * over_m * over_m
    along_c, along_d = dot(fx, fy, fz, ex, ey, ez) / ee, dot(gx, gy, gz, ex, ey, ez) / ee
    return t, u * nx, u * ny, u * nz, v * mx, v * my, v * mz, along_c, along_d


@formula
def by_ends(along_c, along_d, uc, ud):
    """Gradients by a and by b, one axis, from those by c and d."""
    return -((1.0 - along_c) * uc) - (1.0 - along_d) * ud, -(along_c * uc) - along_d * ud


@formula
def steepness(edge, t):
    """Derivative [m] of the constraint by theta. `edge`: the edge's length at rest."""
    return edge * (1.0 + t * t)


@formula
def gradient_sum(steep, wa, wb, wc, wd, aa, bb, cc, dd):
    """Sum of weight times gradient squared. `aa`, `bb`, `cc`, `dd`: squared gradients of theta by each corner."""
    return steep * steep * ((wa * aa + wb * bb) + (wc * cc + wd * dd))


@formula
def dihedral_change(edge, t, rest, steep, reciprocal, compliance, multiplier):
    """Return (change of the multiplier [m], that times the constraint's derivative by theta). `rest`: t at rest."""
    change = (-(4.0 * edge * (t - rest)) - compliance * multiplier) * reciprocal
    return change, change * steep
