"""Deformation of a linear tetrahedron a, b, c, d: its gradient F, the rotation nearest to it, and their relation to
corners.

F = D B, where the columns of D are the current edges from a to b, c, d, and B is the inverse of the same matrix at rest
(matrices by rows, nine numbers): T. Sifakis, J. Barbic, "FEM Simulation of 3D Deformable Solids", SIGGRAPH 2012
courses, part 1, section 4.1. So x_b enters F by the first row of B, x_c and x_d by the others, and x_a by minus their
sum: a quantity with the derivative G by F has the derivative G times that row by x_b.

An isotropic material does not depend on the orientation of its rest shape. In the frame of the first edge and of the
plane of the first two (`make_framed`), edges at rest are an upper triangular matrix, and so is B: rows (r0, r1, r2),
(0, r3, r4), (0, 0, r5). That saves a third of all products.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula
from softlab.model.formulas.lengths import cross, dot
from softlab.model.formulas.rotation import (
    OPERATIONS_MATRIX,
    OPERATIONS_NEAR,
    matrix_of,
    normalised,
    rotation_3d_far,
    rotation_3d_near,
    unit,
)

OPERATIONS_GRADIENT = 9 + 45  # the edges, and their product with B
OPERATIONS_CORNERS = 45 + 6  # three products with G, and their sum
OPERATIONS_FRAMED, OPERATIONS_FRAMED_CORNERS = 9 + 27, 27 + 6  # the same with six numbers of B
OPERATIONS_COFACTOR, OPERATIONS_DETERMINANT = 27, 5
OPERATIONS_ROTATION = {size: 60 + 25 + OPERATIONS_MATRIX + near for size, near in OPERATIONS_NEAR.items()}
MIN_PERPENDICULAR = 1e-3  # fraction of a second column's square that must be perpendicular to the first one
FOUR_UNITS = 4  # times the smallest normal number, as in rotation.py

LEAST = OfPrecision(lambda real: FOUR_UNITS * np.finfo(real).tiny)


@formula
def gradient(a, b, c, d, rest):
    """F, from corners (x, y, z) [m] and the numbers `rest`, which begin with B [1/m]."""
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    fx, fy, fz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    gx, gy, gz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return (
        dot(ex, fx, gx, rest[0], rest[3], rest[6]),
        dot(ex, fx, gx, rest[1], rest[4], rest[7]),
        dot(ex, fx, gx, rest[2], rest[5], rest[8]),
        dot(ey, fy, gy, rest[0], rest[3], rest[6]),
        dot(ey, fy, gy, rest[1], rest[4], rest[7]),
        dot(ey, fy, gy, rest[2], rest[5], rest[8]),
        dot(ez, fz, gz, rest[0], rest[3], rest[6]),
        dot(ez, fz, gz, rest[1], rest[4], rest[7]),
        dot(ez, fz, gz, rest[2], rest[5], rest[8]),
    )


@formula
def inner_product(a, b):
    """tr(A'B)."""
    return (dot(a[0], a[1], a[2], b[0], b[1], b[2]) + dot(a[3], a[4], a[5], b[3], b[4], b[5])) + dot(
        a[6], a[7], a[8], b[6], b[7], b[8]
    )


@formula
def times(g, x, y, z):
    """Matrix, by rows, times a vector."""
    return dot(g[0], g[1], g[2], x, y, z), dot(g[3], g[4], g[5], x, y, z), dot(g[6], g[7], g[8], x, y, z)


@formula
def corners(g, rest):
    """Derivatives by a, b, c, d of a quantity whose derivative by F is `g` (9 numbers)."""
    b = times(g, rest[0], rest[1], rest[2])
    c = times(g, rest[3], rest[4], rest[5])
    d = times(g, rest[6], rest[7], rest[8])
    a = -(b[0] + c[0]) - d[0], -(b[1] + c[1]) - d[1], -(b[2] + c[2]) - d[2]
    return a, b, c, d


@formula
def cofactor(f):
    """Derivative of the determinant by F: each column is the cross product of the two others."""
    return (
        f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6],
        f[7] * f[2] - f[8] * f[1], f[8] * f[0] - f[6] * f[2], f[6] * f[1] - f[7] * f[0],
        f[1] * f[5] - f[2] * f[4], f[2] * f[3] - f[0] * f[5], f[0] * f[4] - f[1] * f[3],
    )  # fmt: skip


@formula
def determinant(f, cofactors):
    return dot(f[0], f[1], f[2], cofactors[0], cofactors[1], cofactors[2])


@formula
def pair(ax, ay, bx, by):
    return ax * bx + ay * by


@formula
def first(x, r):
    return x * r


@formula
def row(e, f, g, rest):
    """Row of F along one axis."""
    return first(e, rest[0]), pair(e, f, rest[1], rest[3]), dot(e, f, g, rest[2], rest[4], rest[5])


@formula
def framed_gradient(a, b, c, d, rest):
    """F as by `gradient`, for numbers `rest` that begin with the six of a triangular B."""
    xx, xy, xz = row(b[0] - a[0], c[0] - a[0], d[0] - a[0], rest)
    yx, yy, yz = row(b[1] - a[1], c[1] - a[1], d[1] - a[1], rest)
    zx, zy, zz = row(b[2] - a[2], c[2] - a[2], d[2] - a[2], rest)
    return xx, xy, xz, yx, yy, yz, zx, zy, zz


@formula
def framed_corner(x, y, z, rest):
    """Derivatives by b, c, d, a along one axis."""
    b, c, d = dot(x, y, z, rest[0], rest[1], rest[2]), pair(y, z, rest[3], rest[4]), first(z, rest[5])
    return b, c, d, -(b + c) - d


@formula
def framed_corners(g, rest):
    """Derivatives as by `corners`, for the six numbers of a triangular B."""
    bx, cx, dx, ax = framed_corner(g[0], g[1], g[2], rest)
    by, cy, dy, ay = framed_corner(g[3], g[4], g[5], rest)
    bz, cz, dz, az = framed_corner(g[6], g[7], g[8], rest)
    return (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz)


@formula
def quaternion_of(xx, xy, xz, yx, yy, yz, zx, zy, zz):
    """Unit quaternion of an approximate rotation: S. Shepperd, "Quaternion from Rotation Matrix", J. Guid. Control
    1 (1978)."""
    trace = (xx + yy) + zz
    largest = max(max(xx, yy), max(zz, trace))
    if trace == largest:
        w, x, y, z = 1.0 + trace, zy - yz, xz - zx, yx - xy
    elif xx == largest:
        w, x, y, z = zy - yz, (1.0 + xx) - (yy + zz), xy + yx, xz + zx
    elif yy == largest:
        w, x, y, z = xz - zx, xy + yx, (1.0 + yy) - (xx + zz), yz + zy
    else:
        w, x, y, z = yx - xy, xz + zx, yz + zy, (1.0 + zz) - (xx + yy)
    return unit(w, x, y, z)


@formula
def start(f):
    """Frame of F's columns as a unit quaternion."""
    xx, xy, _, yx, yy, _, zx, zy, _ = f
    aa = dot(xx, yx, zx, xx, yx, zx)
    bb = dot(xy, yy, zy, xy, yy, zy)
    scale = 1.0 / sqrt(aa if aa > LEAST else 1.0)
    ax, ay, az = scale * xx, scale * yx, scale * zx
    along = dot(ax, ay, az, xy, yy, zy)
    bx, by, bz = xy - along * ax, yy - along * ay, zy - along * az
    rest = dot(bx, by, bz, bx, by, bz)
    if (aa > LEAST) & (rest > LEAST) & (rest > MIN_PERPENDICULAR * bb):
        scale = 1.0 / sqrt(rest)
        bx, by, bz = scale * bx, scale * by, scale * bz
        cx, cy, cz = cross(ax, ay, az, bx, by, bz)
        return quaternion_of(ax, bx, cx, ay, by, cy, az, bz, cz)
    return 1.0, 0.0, 0.0, 0.0


@formula
def rotation(f):
    f = normalised(f)
    w, x, y, z, reached = rotation_3d_near(f, start(f))
    if not reached:
        w, x, y, z = rotation_3d_far(f, (w, x, y, z))
    return matrix_of(w, x, y, z)
