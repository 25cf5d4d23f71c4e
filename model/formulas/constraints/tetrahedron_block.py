"""Shape of a tetrahedron as a block: the stretch S = R'F of F = R S minus 1, six rows that share one system; see
tetrahedron.py.

R rotates with the corners: a change R Z of the impulse changes F by R Z H, H = sum w g g' over the corners' rows g of
B, and S near 1 by the symmetric part of Z H. With R fixed at its old value, the step would be an oblique projection
where H has different eigenvalues a, b: it amplifies a disturbance by up to (a + b) / (2 sqrt(a b)) in the norm of the
masses, so that sweeps over slivers at rest diverge. The step of XPBD (Macklin, Mueller, Chentanez, MIG 2016, eq. 18)
with the right slope is
  (Z Ha + Ha Z) / 2 = -(S - 1) - gamma (S - S0) - alpha~ R'Y,    Ha = (1 + gamma) H + alpha~,    Y += R Z
a Lyapunov equation. Iterations end where alpha~ Y = -(F - R), whatever Ha is. Y is the impulse as a matrix like F: nine
multipliers that do not rotate with R. Where Y is 0, Z is symmetric, and without compliance the linear step at rest is
the orthogonal projection in the norm of the masses, which amplifies nothing.

The damper's rate is that of the stretch S in the material's own frame, S0 at the substep's start. A rigid rotation does
not change S and is not damped (objective rates: J. Simo, T. Hughes, "Computational Inelasticity", Springer 1998,
section 7.2).
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, OfPrecision, formula
from softlab.model.formulas.elastic.deformation import framed_corners, framed_gradient, rotation
from softlab.model.formulas.lengths import dot, moved

OPERATIONS = 36 + 69 + 99 + 45 + 33 + 24  # 1 - S, H + alpha~, Z, R Z, corners, their displacement
OPERATIONS_DAMPER = 36 + 30 + 18 + 6  # besides a rotation: F at the start, S0, their contribution, 1 + gamma
OPERATIONS_SOFT = 45 + 16 + 49 + 9  # R'Y, its contribution, the skew part of Z, the new multipliers

# the smallest R:D: below it a quotient may be infinite
LEAST = OfPrecision(lambda real: np.finfo(real).tiny / np.finfo(real).eps)
UNITS = OfPrecision(lambda real: 64 * np.finfo(real).eps)


@formula
def column(q, i, a, j):
    """Entry (i, j) of Q'A."""
    return dot(q[i], q[i + 3], q[i + 6], a[j], a[j + 3], a[j + 6])


@formula
def stretch(f, r):
    """R'F, six entries of a symmetric matrix."""
    return (
        column(r, 0, f, 0), column(r, 0, f, 1), column(r, 0, f, 2), column(r, 1, f, 1), column(r, 1, f, 2),
        column(r, 2, f, 2),
    )  # fmt: skip


@formula
def less(q, scale, s, t):
    """Q - scale (S - T), symmetric."""
    return (
        q[0] - scale * (s[0] - t[0]), q[1] - scale * (s[1] - t[1]), q[2] - scale * (s[2] - t[2]),
        q[3] - scale * (s[3] - t[3]), q[4] - scale * (s[4] - t[4]), q[5] - scale * (s[5] - t[5]),
    )  # fmt: skip


@formula
def relieved(q, compliance, r, y):
    """Return (six entries of the symmetric part of Q - compliance R'Y, three of twice its skew part). Q is
    symmetric."""
    xy, yx, xz = column(r, 0, y, 1), column(r, 1, y, 0), column(r, 0, y, 2)
    zx, yz, zy = column(r, 2, y, 0), column(r, 1, y, 2), column(r, 2, y, 1)
    mean = 0.5 * compliance
    return (
        q[0] - compliance * column(r, 0, y, 0), q[1] - mean * (xy + yx), q[2] - mean * (xz + zx),
        q[3] - compliance * column(r, 1, y, 1), q[4] - mean * (yz + zy), q[5] - compliance * column(r, 2, y, 2),
    ), (compliance * (yz - zy), compliance * (zx - xz), compliance * (xy - yx))  # fmt: skip


@formula
def row(x, y, z, a):
    """Row (x, y, z) times A."""
    return dot(x, y, z, a[0], a[3], a[6]), dot(x, y, z, a[1], a[4], a[7]), dot(x, y, z, a[2], a[5], a[8])


@formula
def block(points, before, weights, values, compliance, m, gamma):
    f = framed_gradient(points[0], points[1], points[2], points[3], values)
    r = rotation(f)
    s = stretch(f, r)
    q = 1.0 - s[0], -s[1], -s[2], 1.0 - s[3], -s[4], 1.0 - s[5]
    if FEATURE.damped:
        p = framed_gradient(before[0], before[1], before[2], before[3], values)
        q = less(q, gamma, s, stretch(p, rotation(p)))
    h = system(values, weights, compliance, 1.0 + gamma)
    x, y, z = 0.0, 0.0, 0.0
    if FEATURE.soft:
        q, k = relieved(q, compliance, r, m)
        x, y, z = skew(h, k)
    q = symmetric(h, q)
    a = q[0], q[1] - z, q[2] + y, q[1] + z, q[3], q[4] - x, q[2] - y, q[4] + x, q[5]
    x0, x1, x2 = row(r[0], r[1], r[2], a)
    x3, x4, x5 = row(r[3], r[4], r[5], a)
    x6, x7, x8 = row(r[6], r[7], r[8], a)
    wa, wb, wc, wd = framed_corners((x0, x1, x2, x3, x4, x5, x6, x7, x8), values)
    points = (
        moved(points[0], weights[0], wa), moved(points[1], weights[1], wb), moved(points[2], weights[2], wc),
        moved(points[3], weights[3], wd),
    )  # fmt: skip
    if not FEATURE.soft:
        return points, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return points, (
        m[0] + x0, m[1] + x1, m[2] + x2, m[3] + x3, m[4] + x4, m[5] + x5, m[6] + x6, m[7] + x7, m[8] + x8,
    )  # fmt: skip


@formula
def weighted(weights, a, b, c, d, i, j):
    """Entry (i, j) of H."""
    return (weights[0] * (a[i] * a[j]) + weights[1] * (b[i] * b[j])) + (
        weights[2] * (c[i] * c[j]) + weights[3] * (d[i] * d[j])
    )


@formula
def system(rest, weights, compliance, stiffening):
    a = -rest[0], -(rest[1] + rest[3]), -(rest[2] + rest[4]) - rest[5]
    b, c, d = (rest[0], rest[1], rest[2]), (0.0, rest[3], rest[4]), (0.0, 0.0, rest[5])
    xx, xy = weighted(weights, a, b, c, d, 0, 0), weighted(weights, a, b, c, d, 0, 1)
    xz, yy = weighted(weights, a, b, c, d, 0, 2), weighted(weights, a, b, c, d, 1, 1)
    yz, zz = weighted(weights, a, b, c, d, 1, 2), weighted(weights, a, b, c, d, 2, 2)
    if FEATURE.damped:
        xx, xy, xz = stiffening * xx, stiffening * xy, stiffening * xz
        yy, yz, zz = stiffening * yy, stiffening * yz, stiffening * zz
    xx, yy, zz = xx + compliance, yy + compliance, zz + compliance
    trace = (xx + yy) + zz
    return xx, xy, xz, yy, yz, zz, 1.0 / trace if trace > 0.0 else 0.0


@formula
def inverse(pivot, floor):
    larger = pivot if pivot > floor else floor
    return 1.0 / larger if larger > LEAST else 0.0


@formula
def solved(xx, xy, xz, yy, yz, zz, floors, x, y, z):
    """Solution of a symmetric 3 x 3 system. `floors`: smallest pivots."""
    i = inverse(xx, floors[0])
    u, v = i * xy, i * xz
    j = inverse(yy - u * xy, floors[1])
    w = yz - v * xy
    o = j * w
    k = inverse((zz - v * xz) - o * w, floors[2])
    y = y - u * x
    z = k * ((z - v * x) - o * y)
    y = j * y - o * z
    return i * x - (u * y + v * z), y, z


@formula
def symmetric(h, q):
    """Six entries of Z from six of Q. `h`: six entries of H, and 1 over its trace."""
    s = h[6]
    a, xy, xz, b, yz, c = s * h[0], s * h[1], s * h[2], s * h[3], s * h[4], s * h[5]
    qa, qb, qc = s * q[0], s * q[3], s * q[5]
    qxy, qxz, qyz = s * q[1], s * q[2], s * q[4]
    ia, ib, ic = inverse(a, 0.0), inverse(b, 0.0), inverse(c, 0.0)
    ya, yb = xy * ia, xy * ib  # coefficients of the entry xy of Z in the rows of the diagonal's entries a and b
    za, zc = xz * ia, xz * ic
    wb, wc = yz * ib, yz * ic
    ab, ac, bc = a + b, a + c, b + c
    x, y, z = solved(
        ab - xy * (ya + yb), yz - xy * za, xz - xy * wb, ac - xz * (za + zc), xy - xz * wc, bc - yz * (wb + wc),
        (UNITS * ab, UNITS * ac, UNITS * bc),
        2.0 * qxy - (ya * qa + yb * qb), 2.0 * qxz - (za * qa + zc * qc), 2.0 * qyz - (wb * qb + wc * qc),
    )  # fmt: skip
    return ia * qa - (ya * x + za * y), x, y, ib * qb - (yb * x + wb * z), z, ic * qc - (zc * y + wc * z)


@formula
def skew(h, q):
    """Return (x, y, z) of Z = [[0, -z, y], [z, 0, -x], [-y, x, 0]], from twice those of Q. Z H + H Z is skew as well,
    and its three numbers are (tr H - H)(x, y, z)."""
    s = h[6]
    a, b, c = s * (h[3] + h[5]), s * (h[0] + h[5]), s * (h[0] + h[3])
    floors = UNITS * a, UNITS * b, UNITS * c
    return solved(a, -(s * h[1]), -(s * h[2]), b, -(s * h[4]), c, floors, s * q[0], s * q[1], s * q[2])
