"""The rotation nearest to a matrix, and rotations by quaternions.

A = sum of m now rest' (rows: current axes; columns: axes at rest). Its nearest rotation R maximises trace(R'A) and has
the determinant +1, whatever A's is: M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005,
3.3. A is first divided by its largest entry, so that no scale is too small or too large (up to four times the smallest
normal number it counts as 0). All operations are + - * / and the root, which are correctly rounded everywhere.
Matrices are tuples of nine numbers, by rows.

In three dimensions trace(R'A) = q'Kq, R of the unit quaternion q = (w, x, y, z) and K symmetric, 4 x 4: P. Davenport's
method in J. Keat, "Analysis of Least-Squares Attitude Determination Routine DOAOP", 1977; B. Horn, "Closed-Form
Solution of Absolute Orientation Using Unit Quaternions", J. Opt. Soc. Am. A 4, 1987. Relative to a rotation q0, with S
= R(q0)'A, q = q0 (1, u):
  K = | t  b'    |    t = trace S,  b = (S_zy - S_yz, S_xz - S_zx, S_yx - S_xy),  H = 2t - S - S'
      | b  t - H |
so that q0 is the best one if and only if b = 0 and H has no negative eigenvalue. This test decides for any rotation if
it is the nearest one: K's largest eigenvalue is at most that of (t, |b|; |b|, t + d), so that with no eigenvalue of H
below -d the trace falls short by at most |b| + d. There are two methods:

`rotation_3d_near` improves the rotation of the previous step, as M. Mueller et al., "A Robust Method to Extract the
Rotational Part of Deformations", MIG 2016, but by a step with all of H instead of its trace (T. Kugelstadt, D.
Koschier, J. Bender, "Fast Corotated FEM using Operator Splitting", SCA 2018), which converges with the third power of
the angle, and by a rational update instead of a sine. It reports if it has converged. It has no branch: loops over many
are vectorised, if it is compiled to be inlined.

`rotation_3d_far` needs no start. K, shifted to positive eigenvalues and squared repeatedly, tends to the projection on
the eigenvectors of the largest one; that projection of the previous rotation is nearest to it among all equally good
ones. Where eigenvalues coincide, as a mirrored body's do, it loses no digits; the largest root of the characteristic
polynomial, a quartic, loses half the digits or more there, and a row of the adjugate the rest.

`rotation_3d` uses the second where the first has not converged.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import FEATURE, OfPrecision, formula
from softlab.model.formulas.lengths import dot

# Counted on numbers; a comparison, a maximum and an absolute value are one each.
OPERATIONS_2D = 22
OPERATIONS_MATRIX = 28
OPERATIONS_NEAR = {4: 567, 8: 779}  # by the bytes of a number

# In units of eps, A's largest entry being 1.
UNCHANGED = 8  # |b| below which a rotation is unchanged, so that bodies at rest stay at rest: rounding of 0
REACHED = 16  # |b| of the nearest rotation
SLACK = 32  # how far H's eigenvalues may be below 0: the rounding of three pivots
LEAST = 1024  # added to H, so that where A does not determine a rotation, rounding rotates by hundredths at most

UNCHANGED_SQUARE = OfPrecision(lambda real: (UNCHANGED * float(np.finfo(real).eps)) ** 2)
NORMAL = OfPrecision(lambda real: 4 * np.finfo(real).tiny)  # its reciprocal is finite
LEAST_STIFFNESS = OfPrecision(lambda real: LEAST * float(np.finfo(real).eps))
LEAST_PIVOT = OfPrecision(lambda real: SLACK * float(np.finfo(real).eps))
REACHED_SQUARE = OfPrecision(lambda real: (REACHED * float(np.finfo(real).eps)) ** 2)
ALONE = OfPrecision(lambda real: 1 - 4 * float(np.finfo(real).eps))
LOST = 1 / 64


@formula
def rotation_2d(xx, xy, yx, yy, cosine, sine):
    """Return (cosine, sine) of the rotation nearest to ((xx, xy), (yx, yy)).

    Where all rotations are equally near (0, and matrices that mirror and scale) it is the `cosine`, `sine` passed
    in. trace(R'A) = c (xx + yy) + s (yx - xy), largest along (xx + yy, yx - xy).
    """
    largest = max(max(abs(xx), abs(xy)), max(abs(yx), abs(yy)))
    scale = 1.0 / largest if largest > NORMAL else 0.0
    c = scale * xx + scale * yy
    s = scale * yx - scale * xy
    squared = c * c + s * s
    distinct = squared > UNCHANGED_SQUARE
    length = sqrt(squared if distinct else 1.0)
    return c / length if distinct else cosine, s / length if distinct else sine


@formula
def matrix_of(w, x, y, z):
    """R of the unit quaternion (w, x, y, z), 9 entries by rows.

    R'R is |q|^4; the form 1 - 2 (products) would be less accurate for a q that rounding has lengthened.
    """
    x2, y2, z2 = x + x, y + y, z + z
    wx, wy, wz, xy, xz, yz = w * x2, w * y2, w * z2, x * y2, x * z2, y * z2
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    return (
        (ww + xx) - (yy + zz), xy - wz, xz + wy,
        xy + wz, (ww + yy) - (xx + zz), yz - wx,
        xz - wy, yz + wx, (ww + zz) - (xx + yy),
    )  # fmt: skip


@formula
def rotated(w, x, y, z, vx, vy, vz):
    """R v of the unit quaternion (w, x, y, z): v + w t + u x t with t = 2 u x v, u = (x, y, z)."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + (w * tx + (y * tz - z * ty)), vy + (w * ty + (z * tx - x * tz)), vz + (w * tz + (x * ty - y * tx))


@formula
def unit(w, x, y, z):
    """Return (w, x, y, z) over its length, with an error of at most 2.5 units of rounding instead of 4.5: the second
    factor is the root's first two terms."""
    inverse = 1.0 / sqrt((w * w + x * x) + (y * y + z * z))
    w, x, y, z = inverse * w, inverse * x, inverse * y, inverse * z
    more = 0.5 * (1.0 - ((w * w + x * x) + (y * y + z * z)))
    return w + more * w, x + more * x, y + more * y, z + more * z


@formula
def normalised(a):
    """A over its largest entry; 0 where that is below the normal numbers."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = a
    first, second = max(max(abs(xx), abs(xy)), max(abs(xz), abs(yx))), max(max(abs(yy), abs(yz)), abs(zx))
    largest = max(max(first, second), max(abs(zy), abs(zz)))
    s = 1.0 / largest if largest > NORMAL else 0.0
    return s * xx, s * xy, s * xz, s * yx, s * yy, s * yz, s * zx, s * zy, s * zz


@formula
def seen_from(a, q):
    """b (3 numbers) and H (xx, xy, xz, yy, yz, zz) relative to q; see the head of the file."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = a
    rxx, rxy, rxz, ryx, ryy, ryz, rzx, rzy, rzz = matrix_of(q[0], q[1], q[2], q[3])
    sxx, sxy, sxz = dot(rxx, ryx, rzx, xx, yx, zx), dot(rxx, ryx, rzx, xy, yy, zy), dot(rxx, ryx, rzx, xz, yz, zz)
    syx, syy, syz = dot(rxy, ryy, rzy, xx, yx, zx), dot(rxy, ryy, rzy, xy, yy, zy), dot(rxy, ryy, rzy, xz, yz, zz)
    szx, szy, szz = dot(rxz, ryz, rzz, xx, yx, zx), dot(rxz, ryz, rzz, xy, yy, zy), dot(rxz, ryz, rzz, xz, yz, zz)
    return (
        szy - syz, sxz - szx, syx - sxy,
        2.0 * (syy + szz), -(sxy + syx), -(sxz + szx), 2.0 * (sxx + szz), -(syz + szy), 2.0 * (sxx + syy),
    )  # fmt: skip


@formula
def improved(a, q):
    """Quaternion after one step, (H + e) u = b; unchanged where b is only rounding.

    e: the excess over t of the largest eigenvalue of K among the mixtures of q0 and K q0 alone, the Ritz value of a
    2 x 2 matrix. The pivots of H + e are made positive: at a saddle, half a turn away, the step leads away from it.
    """
    w, x, y, z = q
    bx, by, bz, hxx, hxy, hxz, hyy, hyz, hzz = seen_from(a, q)
    squared = dot(bx, by, bz, bx, by, bz)
    gx, gy, gz = dot(hxx, hxy, hxz, bx, by, bz), dot(hxy, hyy, hyz, bx, by, bz), dot(hxz, hyz, hzz, bx, by, bz)
    along = dot(gx, gy, gz, bx, by, bz) / max(squared, UNCHANGED_SQUARE)
    e = LEAST_STIFFNESS + 0.5 * (sqrt(along * along + 4.0 * squared) - along)
    first = max(abs(hxx + e), LEAST_STIFFNESS)
    lower_y, lower_z = hxy / first, hxz / first
    second = max(abs((hyy + e) - lower_y * hxy), LEAST_STIFFNESS)
    rest = hyz - lower_y * hxz
    lower = rest / second
    third = max(abs(((hzz + e) - lower_z * hxz) - lower * rest), LEAST_STIFFNESS)
    middle = by - lower_y * bx
    uz = ((bz - lower_z * bx) - lower * middle) / third
    uy = middle / second - lower * uz
    ux = (bx / first - lower_y * uy) - lower_z * uz
    nw, nx = w - ((x * ux + y * uy) + z * uz), x + ((w * ux + y * uz) - z * uy)
    ny, nz = y + ((w * uy + z * ux) - x * uz), z + ((w * uz + x * uy) - y * ux)
    nw, nx, ny, nz = unit(nw, nx, ny, nz)
    go = squared > UNCHANGED_SQUARE
    return nw if go else w, nx if go else x, ny if go else y, nz if go else z


@formula
def reached_from(a, q):
    """True if q is the rotation nearest to A, to rounding."""
    bx, by, bz, hxx, hxy, hxz, hyy, hyz, hzz = seen_from(a, q)
    first = hxx + LEAST_PIVOT
    over = 1.0 / max(first, LEAST_PIVOT)
    second = (hyy + LEAST_PIVOT) - hxy * over * hxy
    rest = hyz - hxy * over * hxz
    third = ((hzz + LEAST_PIVOT) - hxz * over * hxz) - rest / max(second, LEAST_PIVOT) * rest
    return (dot(bx, by, bz, bx, by, bz) <= REACHED_SQUARE) & (first > 0.0) & (second > 0.0) & (third > 0.0)


@formula
def rotation_3d_near(a, q):
    """Return (w, x, y, z, True if it is the rotation nearest to A), improved from the unit quaternion q = (w, x, y,
    z).

    Where it is not the nearest one, the unchanged quaternion: `rotation_3d_far` continues from it.
    """
    a = normalised(a)
    w, x, y, z = q
    nw, nx, ny, nz = w, x, y, z
    for _ in range(2 if FEATURE.single else 3):  # enough from 30 degrees, for nearly all random matrices
        nw, nx, ny, nz = improved(a, (nw, nx, ny, nz))
    reached = reached_from(a, (nw, nx, ny, nz))
    return nw if reached else w, nx if reached else x, ny if reached else y, nz if reached else z, reached


@formula
def squared_of(a, b, c, d, e, f, g, h, i, j):
    """Square of the symmetric matrix with the rows (a, b, c, d), (b, e, f, g), (c, f, h, i), (d, g, i, j)."""
    return (
        (a * a + b * b) + (c * c + d * d), (a * b + b * e) + (c * f + d * g), (a * c + b * f) + (c * h + d * i),
        (a * d + b * g) + (c * i + d * j), (b * b + e * e) + (f * f + g * g), (b * c + e * f) + (f * h + g * i),
        (b * d + e * g) + (f * i + g * j), (c * c + f * f) + (h * h + i * i), (c * d + f * g) + (h * i + i * j),
        (d * d + g * g) + (i * i + j * j),
    )  # fmt: skip


@formula
def projection(matrix):
    """Projection on the eigenvectors of K's largest eigenvalue over their number, 10 entries of a symmetric matrix.

    No eigenvalue of K is below -sqrt(3) |A|. Each square is scaled to trace 1; the next one's trace is 1 for a
    projection on one vector alone, and less otherwise.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix
    squared = dot(xx, xy, xz, xx, xy, xz) + dot(yx, yy, yz, yx, yy, yz) + dot(zx, zy, zz, zx, zy, zz)
    shift = sqrt(3.0 * squared) + NORMAL
    a, b, c, d = shift + ((xx + yy) + zz), zy - yz, xz - zx, yx - xy
    e, f, g = shift + ((xx - yy) - zz), xy + yx, xz + zx
    h, i, j = shift + ((yy - xx) - zz), yz + zy, shift + ((zz - xx) - yy)
    for _ in range(23 if FEATURE.single else 52):
        t = 1.0 / ((a + e) + (h + j))
        a, b, c, d, e, f, g, h, i, j = squared_of(t * a, t * b, t * c, t * d, t * e, t * f, t * g, t * h, t * i, t * j)
        if (a + e) + (h + j) > ALONE:
            break
    t = 1.0 / ((a + e) + (h + j))
    return t * a, t * b, t * c, t * d, t * e, t * f, t * g, t * h, t * i, t * j


@formula
def rotation_3d_far(matrix, q):
    """Return (w, x, y, z) of the rotation nearest to A; of several, the one nearest to the unit quaternion q = (w, x,
    y, z)."""
    w, x, y, z = q
    a, b, c, d, e, f, g, h, i, j = projection(normalised(matrix))
    nw, nx = (a * w + b * x) + (c * y + d * z), (b * w + e * x) + (f * y + g * z)
    ny, nz = (c * w + f * x) + (h * y + i * z), (d * w + g * x) + (i * y + j * z)
    if (nw * nw + nx * nx) + (ny * ny + nz * nz) < LOST:  # nearly half a turn away: too few digits are left
        largest = max(max(a, e), max(h, j))
        if a == largest:
            nw, nx, ny, nz = a, b, c, d
        elif e == largest:
            nw, nx, ny, nz = b, e, f, g
        elif h == largest:
            nw, nx, ny, nz = c, f, h, i
        else:
            nw, nx, ny, nz = d, g, i, j
    nw, nx, ny, nz = unit(nw, nx, ny, nz)
    nw, nx, ny, nz, _ = rotation_3d_near(matrix, (nw, nx, ny, nz))
    return nw, nx, ny, nz


@formula
def rotation_3d(a, q):
    """Return (w, x, y, z) of the rotation nearest to A, from the unit quaternion q of the previous step.

    It gives the same bits as `rotation_3d_near` for many at once followed by `rotation_3d_far` where that did not
    converge.
    """
    w, x, y, z, reached = rotation_3d_near(a, q)
    if reached:
        return w, x, y, z
    return rotation_3d_far(a, (w, x, y, z))
