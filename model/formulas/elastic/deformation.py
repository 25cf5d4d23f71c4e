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
from types import SimpleNamespace

import numpy as np

from softlab.model.formulas import joined, plain
from softlab.model.formulas.lengths import make as make_lengths
from softlab.model.formulas.rotation import OPERATIONS_MATRIX, OPERATIONS_NEAR, make_far, make_near, make_quaternions

OPERATIONS_GRADIENT = 9 + 45  # the edges, and their product with B
OPERATIONS_CORNERS = 45 + 6  # three products with G, and their sum
OPERATIONS_FRAMED, OPERATIONS_FRAMED_CORNERS = 9 + 27, 27 + 6  # the same with six numbers of B
OPERATIONS_COFACTOR, OPERATIONS_DETERMINANT = 27, 5
OPERATIONS_ROTATION = {size: 60 + 25 + OPERATIONS_MATRIX + near for size, near in OPERATIONS_NEAR.items()}
MIN_PERPENDICULAR = 1e-3  # fraction of a second column's square that must be perpendicular to the first one
FOUR_UNITS = 4  # times the smallest normal number, as in rotation.py


def make(real, compiled=plain):
    """Make `gradient`, `corner`, `corners`, `determinant`, `cofactor` and `rotation` in the arithmetic `real`."""
    return joined(make_gradient(real, compiled), SimpleNamespace(rotation=make_rotation(real, compiled)))


def make_gradient(real, compiled=plain):
    """Make the functions of `make` except `rotation`."""
    dot = make_lengths(real, compiled).dot

    @compiled
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

    @compiled
    def corner(g, x, y, z):
        """G times a row of B."""
        return dot(g[0], g[1], g[2], x, y, z), dot(g[3], g[4], g[5], x, y, z), dot(g[6], g[7], g[8], x, y, z)

    @compiled
    def corners(g, rest):
        """Derivatives by a, b, c, d of a quantity whose derivative by F is `g` (9 numbers)."""
        b = corner(g, rest[0], rest[1], rest[2])
        c = corner(g, rest[3], rest[4], rest[5])
        d = corner(g, rest[6], rest[7], rest[8])
        a = -(b[0] + c[0]) - d[0], -(b[1] + c[1]) - d[1], -(b[2] + c[2]) - d[2]
        return a, b, c, d

    @compiled
    def cofactor(f):
        """Derivative of the determinant by F: each column is the cross product of the two others."""
        return (
            f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6],
            f[7] * f[2] - f[8] * f[1], f[8] * f[0] - f[6] * f[2], f[6] * f[1] - f[7] * f[0],
            f[1] * f[5] - f[2] * f[4], f[2] * f[3] - f[0] * f[5], f[0] * f[4] - f[1] * f[3],
        )  # fmt: skip

    @compiled
    def determinant(f, cofactors):
        return dot(f[0], f[1], f[2], cofactors[0], cofactors[1], cofactors[2])

    return SimpleNamespace(
        gradient=gradient, corner=corner, corners=corners, cofactor=cofactor, determinant=determinant
    )  # fmt: skip


def make_framed(real, compiled=plain):
    """Make `gradient` and `corners` as above, for numbers `rest` that begin with the six of a triangular B."""
    dot = make_lengths(real, compiled).dot

    @compiled
    def pair(ax, ay, bx, by):
        return ax * bx + ay * by

    @compiled
    def first(x, r):
        return x * r

    @compiled
    def row(e, f, g, rest):
        """Row of F along one axis."""
        return first(e, rest[0]), pair(e, f, rest[1], rest[3]), dot(e, f, g, rest[2], rest[4], rest[5])

    @compiled
    def gradient(a, b, c, d, rest):
        xx, xy, xz = row(b[0] - a[0], c[0] - a[0], d[0] - a[0], rest)
        yx, yy, yz = row(b[1] - a[1], c[1] - a[1], d[1] - a[1], rest)
        zx, zy, zz = row(b[2] - a[2], c[2] - a[2], d[2] - a[2], rest)
        return xx, xy, xz, yx, yy, yz, zx, zy, zz

    @compiled
    def corner(x, y, z, rest):
        """Derivatives by b, c, d, a along one axis."""
        b, c, d = dot(x, y, z, rest[0], rest[1], rest[2]), pair(y, z, rest[3], rest[4]), first(z, rest[5])
        return b, c, d, -(b + c) - d

    @compiled
    def corners(g, rest):
        bx, cx, dx, ax = corner(g[0], g[1], g[2], rest)
        by, cy, dy, ay = corner(g[3], g[4], g[5], rest)
        bz, cz, dz, az = corner(g[6], g[7], g[8], rest)
        return (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz)

    return SimpleNamespace(gradient=gradient, corners=corners)


def make_rotation(real, compiled=plain):
    """Make `rotation(f)`: R, nine numbers, nearest to F, with the determinant +1 whatever F's is
    (model/formulas/rotation.py).

    It needs no rotation of an earlier step. It starts from F's columns made a right-handed frame (Gram, Schmidt), whose
    error is only the shear, or from the identity where two columns do not make a frame.
    """
    zero, one = real(0), real(1)
    least, across = real(FOUR_UNITS * np.finfo(real).tiny), real(MIN_PERPENDICULAR)
    quaternions = make_quaternions(real, compiled)
    near = make_near(real, compiled, quaternions)
    rotation_3d_near, rotation_3d_far = (
        near.rotation_3d_near,
        make_far(real, compiled, quaternions.unit, near),
    )
    matrix_of, unit, normalised = quaternions.matrix_of, quaternions.unit, near.normalised
    lengths = make_lengths(real, compiled)
    dot, cross = lengths.dot, lengths.cross

    @compiled
    def quaternion_of(xx, xy, xz, yx, yy, yz, zx, zy, zz):
        """Unit quaternion of an approximate rotation: S. Shepperd, "Quaternion from Rotation Matrix", J. Guid. Control
        1 (1978)."""
        trace = (xx + yy) + zz
        largest = max(max(xx, yy), max(zz, trace))
        if trace == largest:
            w, x, y, z = one + trace, zy - yz, xz - zx, yx - xy
        elif xx == largest:
            w, x, y, z = zy - yz, (one + xx) - (yy + zz), xy + yx, xz + zx
        elif yy == largest:
            w, x, y, z = xz - zx, xy + yx, (one + yy) - (xx + zz), yz + zy
        else:
            w, x, y, z = yx - xy, xz + zx, yz + zy, (one + zz) - (xx + yy)
        return unit(w, x, y, z)

    @compiled
    def start(f):
        """Frame of F's columns as a unit quaternion."""
        xx, xy, _, yx, yy, _, zx, zy, _ = f
        aa = dot(xx, yx, zx, xx, yx, zx)
        bb = dot(xy, yy, zy, xy, yy, zy)
        scale = one / sqrt(aa if aa > least else one)
        ax, ay, az = scale * xx, scale * yx, scale * zx
        along = dot(ax, ay, az, xy, yy, zy)
        bx, by, bz = xy - along * ax, yy - along * ay, zy - along * az
        rest = dot(bx, by, bz, bx, by, bz)
        if (aa > least) & (rest > least) & (rest > across * bb):
            scale = one / sqrt(rest)
            bx, by, bz = scale * bx, scale * by, scale * bz
            cx, cy, cz = cross(ax, ay, az, bx, by, bz)
            return quaternion_of(ax, bx, cx, ay, by, cy, az, bz, cz)
        return one, zero, zero, zero

    @compiled
    def rotation(f):
        f = normalised(f)
        w, x, y, z, reached = rotation_3d_near(f, start(f))
        if not reached:
            w, x, y, z = rotation_3d_far(f, (w, x, y, z))
        return matrix_of(w, x, y, z)

    return rotation
