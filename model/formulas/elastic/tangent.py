"""Energy, stress and tangent of a tetrahedron's material; the tangent's eigenvalues can be clamped so that none is
negative.

F = R S, S = V diag(s) V', U = R V. The first Piola-Kirchhoff stress P = dW/dF of the materials of
model/tetrahedra/material.py, with J = det F, C = dJ/dF, t = tr S - 3, k = lambda + mu:
  fixed corotated   2 mu (F - R) + lambda (J - 1) C      corotated   2 mu (F - R) + lambda t R
  neo-Hookean       mu F + k (J - alpha) C
In all three dP = m dF + q (G : dF) G + b dC - c dR, with (m, q, b, c) of (2 mu, lambda, lambda (J - 1), 2 mu) and G =
C; (2 mu, lambda, 0, 2 mu - lambda t) and G = R; (mu, k, k (J - alpha), 0) and G = C. The rotation's differential is dR
= R [w]x, (tr(S) I - S) w = axial(R'dF - dF'R).

In the frames U and V, dF^ = U'dF V, the tangent decouples (J. Teran et al., "Robust Quasistatic Finite Elements and
Flesh Simulation", SCA 2005; B. Smith, F. de Goes, T. Kim, "Analytic Eigensystems for Isotropic Distortion Energies",
ACM TOG 38 (2019)). The diagonal has the 3 x 3 matrix A = m I + q g g' + b offdiag(s_k), g the diagonal of U'G V. Of
each pair (i, j), k the third, the symmetric part has the flip m - b s_k and the skew part the twist m + b s_k - 2 c /
(s_i + s_j). `safe` clamps these at 0, and A's eigenvalues too, so that the tangent is positive semidefinite.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import FEATURE, OfPrecision, formula
from softlab.model.formulas.constraints.tetrahedron import COROTATED, FIXED, HOOKEAN
from softlab.model.formulas.elastic import deformation
from softlab.model.formulas.elastic.deformation import cofactor, determinant
from softlab.model.formulas.lengths import dot

SWEEPS_32, SWEEPS_64 = 4, 6  # of Jacobi's method over a 3 x 3 matrix: it converges quadratically
SWEEPS = {4: SWEEPS_32, 8: SWEEPS_64}  # by the bytes of a number
FLATTEST = 0.05  # smallest s_i + s_j of a twist: below it the corner is inverted, where R jumps
OPERATIONS_STRESS = (
    deformation.OPERATIONS_GRADIENT + deformation.OPERATIONS_COFACTOR + 60 + deformation.OPERATIONS_CORNERS
)
OPERATIONS_BLOCK = 24 + 2 * 45
OPERATIONS_MODULI = 90

LARGEST = OfPrecision(lambda real: float(np.finfo(real).eps) ** (-2))


def operations_axes(item: int) -> int:
    """Count the operations of the eigenvectors of a symmetric matrix, on numbers of `item` bytes."""
    return SWEEPS[item] * 3 * 40


@formula
def squared(a):
    return (dot(a[0], a[1], a[2], a[0], a[1], a[2]) + dot(a[3], a[4], a[5], a[3], a[4], a[5])) + dot(
        a[6], a[7], a[8], a[6], a[7], a[8]
    )


@formula
def mixed(m, a, n, b):
    """m a + n b of two matrices."""
    return (
        m * a[0] + n * b[0], m * a[1] + n * b[1], m * a[2] + n * b[2], m * a[3] + n * b[3], m * a[4] + n * b[4],
        m * a[5] + n * b[5], m * a[6] + n * b[6], m * a[7] + n * b[7], m * a[8] + n * b[8],
    )  # fmt: skip


@formula
def stress(material, f, r, mu, lame, alpha):
    """Return (W [Pa], P). `r`: the rotation nearest to F; not used by the neo-Hookean material."""
    cofactors = cofactor(f)
    ratio = determinant(f, cofactors)
    if material == HOOKEAN:
        off, rest, pressure = ratio - alpha, 1.0 - alpha, lame + mu
        energy = 0.5 * mu * (squared(f) - 3.0) + 0.5 * pressure * ((off - rest) * (off + rest))
        return energy, mixed(mu, f, pressure * off, cofactors)
    d = mixed(1.0, f, -1.0, r)
    if material == FIXED:
        off = ratio - 1.0
        return mu * squared(d) + 0.5 * lame * (off * off), mixed(2.0 * mu, d, lame * off, cofactors)
    along = (dot(r[0], r[1], r[2], d[0], d[1], d[2]) + dot(r[3], r[4], r[5], d[3], d[4], d[5])) + dot(
        r[6], r[7], r[8], d[6], d[7], d[8]
    )
    return mu * squared(d) + 0.5 * lame * (along * along), mixed(2.0 * mu, d, lame * along, r)


@formula
def raised(a):
    """Symmetric matrix (xx, xy, xz, yy, yz, zz) without its negative eigenvalues."""
    e, v = axes(a[0], a[1], a[2], a[3], a[4], a[5])
    x, y, z = max(e[0], 0.0), max(e[1], 0.0), max(e[2], 0.0)
    return (
        dot(x * v[0], y * v[1], z * v[2], v[0], v[1], v[2]), dot(x * v[0], y * v[1], z * v[2], v[3], v[4], v[5]),
        dot(x * v[0], y * v[1], z * v[2], v[6], v[7], v[8]), dot(x * v[3], y * v[4], z * v[5], v[3], v[4], v[5]),
        dot(x * v[3], y * v[4], z * v[5], v[6], v[7], v[8]), dot(x * v[6], y * v[7], z * v[8], v[6], v[7], v[8]),
    )  # fmt: skip


@formula
def pair(m, b, c, third, both, safe):
    """Return ((flip + twist) / 2, (flip - twist) / 2) of a pair with s_i + s_j = `both`."""
    flip = m - b * third
    twist = (m + b * third) - 2.0 * c / max(both, FLATTEST)
    if safe:
        flip, twist = max(flip, 0.0), max(twist, 0.0)
    return 0.5 * (flip + twist), 0.5 * (flip - twist)


@formula
def moduli(material, s, mu, lame, alpha, safe):
    """Return (A (xx, xy, xz, yy, yz, zz), half sums and half differences of flips and twists of (y, z), (z, x), (x, y))
    [Pa]."""
    x, y, z = s
    gx, gy, gz = y * z, z * x, x * y
    m, q, b, c = 2.0 * mu, lame, 0.0, 2.0 * mu
    if material == FIXED:
        b = lame * (x * gx - 1.0)
    elif material == COROTATED:
        c = 2.0 * mu - lame * ((x - 1.0) + (y - 1.0) + (z - 1.0))
        gx, gy, gz = 1.0, 1.0, 1.0
    else:
        m, q, c = mu, lame + mu, 0.0
        b = q * (x * gx - alpha)
    a = (
        m + q * gx * gx, q * gx * gy + b * z, q * gx * gz + b * y, m + q * gy * gy, q * gy * gz + b * x,
        m + q * gz * gz,
    )  # fmt: skip
    if safe:
        a = raised(a)
    sum_x, off_x = pair(m, b, c, x, y + z, safe)
    sum_y, off_y = pair(m, b, c, y, z + x, safe)
    sum_z, off_z = pair(m, b, c, z, x + y, safe)
    return a, (sum_x, sum_y, sum_z), (off_x, off_y, off_z)


@formula
def frame(f, r):
    """Return (s, U, V) of F and the rotation nearest to it."""
    a = transposed_product(r, f)
    s, v = axes(a[0], 0.5 * (a[1] + a[3]), 0.5 * (a[2] + a[6]), a[4], 0.5 * (a[5] + a[7]), a[8])
    return s, product(r, v), v


@formula
def block(u, a, sums, offs, p, o):
    """3 x 3 block of the tangent from corner q to corner p, over the volume: U H U' with H of dF^ = e_m o'.

    `p`, `o`: rows of B of p and q, in the frame V.
    """
    xx, yy, zz = p[0] * o[0], p[1] * o[1], p[2] * o[2]
    h = (
        a[0] * xx + (sums[2] * yy + sums[1] * zz), a[1] * (p[0] * o[1]) + offs[2] * (p[1] * o[0]),
        a[2] * (p[0] * o[2]) + offs[1] * (p[2] * o[0]),
        a[1] * (p[1] * o[0]) + offs[2] * (p[0] * o[1]), a[3] * yy + (sums[2] * xx + sums[0] * zz),
        a[4] * (p[1] * o[2]) + offs[0] * (p[2] * o[1]),
        a[2] * (p[2] * o[0]) + offs[1] * (p[0] * o[2]), a[4] * (p[2] * o[1]) + offs[0] * (p[1] * o[2]),
        a[5] * zz + (sums[1] * xx + sums[0] * yy),
    )  # fmt: skip
    w = product(u, h)
    return (
        dot(w[0], w[1], w[2], u[0], u[1], u[2]), dot(w[0], w[1], w[2], u[3], u[4], u[5]),
        dot(w[0], w[1], w[2], u[6], u[7], u[8]), dot(w[3], w[4], w[5], u[0], u[1], u[2]),
        dot(w[3], w[4], w[5], u[3], u[4], u[5]), dot(w[3], w[4], w[5], u[6], u[7], u[8]),
        dot(w[6], w[7], w[8], u[0], u[1], u[2]), dot(w[6], w[7], w[8], u[3], u[4], u[5]),
        dot(w[6], w[7], w[8], u[6], u[7], u[8]),
    )  # fmt: skip


@formula
def differential(u, v, a, sums, offs, df):
    """dP of dF, for matrix-free products."""
    d = product(transposed_product(u, df), v)
    h = (
        dot(a[0], a[1], a[2], d[0], d[4], d[8]), sums[2] * d[1] + offs[2] * d[3], sums[1] * d[2] + offs[1] * d[6],
        sums[2] * d[3] + offs[2] * d[1], dot(a[1], a[3], a[4], d[0], d[4], d[8]), sums[0] * d[5] + offs[0] * d[7],
        sums[1] * d[6] + offs[1] * d[2], sums[0] * d[7] + offs[0] * d[5], dot(a[2], a[4], a[5], d[0], d[4], d[8]),
    )  # fmt: skip
    w = product(u, h)
    return (
        dot(w[0], w[1], w[2], v[0], v[1], v[2]), dot(w[0], w[1], w[2], v[3], v[4], v[5]),
        dot(w[0], w[1], w[2], v[6], v[7], v[8]), dot(w[3], w[4], w[5], v[0], v[1], v[2]),
        dot(w[3], w[4], w[5], v[3], v[4], v[5]), dot(w[3], w[4], w[5], v[6], v[7], v[8]),
        dot(w[6], w[7], w[8], v[0], v[1], v[2]), dot(w[6], w[7], w[8], v[3], v[4], v[5]),
        dot(w[6], w[7], w[8], v[6], v[7], v[8]),
    )  # fmt: skip


@formula
def seen_in(v, x, y, z):
    """V' times a row of B."""
    return dot(v[0], v[3], v[6], x, y, z), dot(v[1], v[4], v[7], x, y, z), dot(v[2], v[5], v[8], x, y, z)


@formula
def product(a, b):
    return (
        dot(a[0], a[1], a[2], b[0], b[3], b[6]), dot(a[0], a[1], a[2], b[1], b[4], b[7]),
        dot(a[0], a[1], a[2], b[2], b[5], b[8]), dot(a[3], a[4], a[5], b[0], b[3], b[6]),
        dot(a[3], a[4], a[5], b[1], b[4], b[7]), dot(a[3], a[4], a[5], b[2], b[5], b[8]),
        dot(a[6], a[7], a[8], b[0], b[3], b[6]), dot(a[6], a[7], a[8], b[1], b[4], b[7]),
        dot(a[6], a[7], a[8], b[2], b[5], b[8]),
    )  # fmt: skip


@formula
def transposed_product(a, b):
    return product((a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]), b)


@formula
def turn(pp, pq, qq):
    """Return (cosine, sine, decrease of pp and increase of qq) of the rotation that makes pq 0: G. Golub, C. Van Loan,
    "Matrix Computations", 8.5.2."""
    if pq == 0.0:
        return 1.0, 0.0, 0.0
    theta = 0.5 * (qq - pp) / pq
    if abs(theta) > LARGEST:  # the tangent is below half of eps^2, for which `fast` math on CUDA may return NaN
        return 1.0, 0.0, 0.0
    t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
    t = t if theta >= 0.0 else -t
    c = 1.0 / sqrt(t * t + 1.0)
    return c, t * c, t * pq


@formula
def rotated(c, s, p, q):
    return c * p - s * q, s * p + c * q


@formula
def axes(xx, xy, xz, yy, yz, zz):
    """Return (eigenvalues in no order, V by rows: its columns are the eigenvectors), by Jacobi's method."""
    a, b, c, d, e, f, g, h, i = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(SWEEPS_32 if FEATURE.single else SWEEPS_64):
        if (xy == 0.0) & (xz == 0.0) & (yz == 0.0):
            break
        k, s, t = turn(xx, xy, yy)
        xx, yy, xy = xx - t, yy + t, 0.0
        xz, yz = rotated(k, s, xz, yz)
        a, b = rotated(k, s, a, b)
        d, e = rotated(k, s, d, e)
        g, h = rotated(k, s, g, h)
        k, s, t = turn(xx, xz, zz)
        xx, zz, xz = xx - t, zz + t, 0.0
        xy, yz = rotated(k, s, xy, yz)
        a, c = rotated(k, s, a, c)
        d, f = rotated(k, s, d, f)
        g, i = rotated(k, s, g, i)
        k, s, t = turn(yy, yz, zz)
        yy, zz, yz = yy - t, zz + t, 0.0
        xy, xz = rotated(k, s, xy, xz)
        b, c = rotated(k, s, b, c)
        e, f = rotated(k, s, e, f)
        h, i = rotated(k, s, h, i)
    return (xx, yy, zz), (a, b, c, d, e, f, g, h, i)
