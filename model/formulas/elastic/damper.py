"""Damping of a tetrahedron in proportion to the rate of its Green strain E = (F'F - I) / 2, which no rigid motion
changes.

A step of h from E_0 adds to the incremental potential, per volume,
  D = tau / (2 h) (E - E_0) : C : (E - E_0),     C : E = 2 mu E + lambda tr(E) I,
with tau the damping time [s] and C the moduli at rest: a Kelvin-Voigt solid in the second Piola-Kirchhoff stress
(dissipation by the rate of an objective strain: G. Sanchez-Banderas, M. Otaduy, "Strain Rate Dissipation for Elastic
Deformations", Comput. Graph. Forum 37 (2018)). P = F N with N = tau / h C : (E - E_0), and P F' is symmetric: the
damper's forces have no moment in any motion. Small vibrations about rest are damped as by tau K, with the stiffness K
at rest.

Its second derivative is N dF'dF + tau / h sym(F'dF) : C : sym(F'dF). The second term is never negative; the first one
is non-negative only where N has no negative eigenvalue.

At order 2 (stages.py) the second stage begins ahead of the end of the first one, at E_1 + sqrt(2) (E_1 - E_0). With
that strain in place of the one at the extrapolated positions, a rotation has no strain rate in either stage. The damper
is of second order, since the strain's increments add up as those of velocities do.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula
from softlab.model.formulas.elastic.deformation import times
from softlab.model.formulas.elastic.tangent import raised
from softlab.model.formulas.lengths import dot

OPERATIONS = 9 + 3 * 5 + 3 * 11 + 20 + 45 + 9  # F of the displacement, the strain, D and N, F N, the sum with P
OPERATIONS_BLOCK = 18 + 30 + 6 * 12  # one of six blocks: F times two rows of B is counted with each of them

AHEAD = sqrt(2)


@formula
def symmetric(t, x, y, z):
    """Symmetric matrix of six numbers times a vector."""
    return dot(t[0], t[3], t[4], x, y, z), dot(t[3], t[1], t[5], x, y, z), dot(t[4], t[5], t[2], x, y, z)


@formula
def increment(f, d):
    """E - E_0 from F and d = F - F_0: the symmetric part of (F - d / 2)'d, accurate for a small d at any F."""
    m = (
        f[0] - 0.5 * d[0], f[1] - 0.5 * d[1], f[2] - 0.5 * d[2], f[3] - 0.5 * d[3], f[4] - 0.5 * d[4],
        f[5] - 0.5 * d[5], f[6] - 0.5 * d[6], f[7] - 0.5 * d[7], f[8] - 0.5 * d[8],
    )  # fmt: skip
    return (
        dot(m[0], m[3], m[6], d[0], d[3], d[6]), dot(m[1], m[4], m[7], d[1], d[4], d[7]),
        dot(m[2], m[5], m[8], d[2], d[5], d[8]),
        0.5 * (dot(m[0], m[3], m[6], d[1], d[4], d[7]) + dot(m[1], m[4], m[7], d[0], d[3], d[6])),
        0.5 * (dot(m[0], m[3], m[6], d[2], d[5], d[8]) + dot(m[2], m[5], m[8], d[0], d[3], d[6])),
        0.5 * (dot(m[1], m[4], m[7], d[2], d[5], d[8]) + dot(m[2], m[5], m[8], d[1], d[4], d[7])),
    )  # fmt: skip


@formula
def strain(f):
    """E, accurate for F near the identity."""
    return increment(f, (f[0] - 1.0, f[1], f[2], f[3], f[4] - 1.0, f[5], f[6], f[7], f[8] - 1.0))


@formula
def beyond(e, first):
    """E - E_0 in a second stage, from the increment of that stage and of the stage before it."""
    return (
        e[0] - AHEAD * first[0], e[1] - AHEAD * first[1], e[2] - AHEAD * first[2], e[3] - AHEAD * first[3],
        e[4] - AHEAD * first[4], e[5] - AHEAD * first[5],
    )  # fmt: skip


@formula
def scaled(time, rate, mu, lame):
    """mu and lambda [Pa], times tau / h."""
    gamma = rate * time
    return gamma * mu, gamma * lame


@formula
def resisted(e, mu, lame):
    """Return (D [Pa], N [Pa]) from E - E_0 and moduli times tau / h."""
    twice, bulk = mu + mu, lame * ((e[0] + e[1]) + e[2])
    n = (
        twice * e[0] + bulk, twice * e[1] + bulk, twice * e[2] + bulk, twice * e[3], twice * e[4], twice * e[5],
    )  # fmt: skip
    diagonal, off = dot(n[0], n[1], n[2], e[0], e[1], e[2]), dot(n[3], n[4], n[5], e[3], e[4], e[5])
    return 0.5 * (diagonal + 2.0 * off), n


@formula
def stressed(p, f, n):
    """P + F N."""
    ax, ay, az = symmetric(n, f[0], f[1], f[2])
    bx, by, bz = symmetric(n, f[3], f[4], f[5])
    cx, cy, cz = symmetric(n, f[6], f[7], f[8])
    return p[0] + ax, p[1] + ay, p[2] + az, p[3] + bx, p[4] + by, p[5] + bz, p[6] + cx, p[7] + cy, p[8] + cz


@formula
def positive(n):
    """N without its negative eigenvalues."""
    xx, xy, xz, yy, yz, zz = raised((n[0], n[3], n[4], n[1], n[5], n[2]))
    return xx, yy, zz, xy, xz, yz


@formula
def squared(f):
    """F F', six numbers."""
    return (
        dot(f[0], f[1], f[2], f[0], f[1], f[2]), dot(f[3], f[4], f[5], f[3], f[4], f[5]),
        dot(f[6], f[7], f[8], f[6], f[7], f[8]), dot(f[0], f[1], f[2], f[3], f[4], f[5]),
        dot(f[0], f[1], f[2], f[6], f[7], f[8]), dot(f[3], f[4], f[5], f[6], f[7], f[8]),
    )  # fmt: skip


@formula
def block(h, f, ff, n, mu, lame, p, o):
    """h plus the 3 x 3 block from corner q to corner p, whose rows of B are `o` and `p`: (p'N o) I + mu (p'o) F F'
    + mu (F o)(F p)' + lambda (F p)(F o)'."""
    nx, ny, nz = symmetric(n, o[0], o[1], o[2])
    isotropic, shear = dot(p[0], p[1], p[2], nx, ny, nz), mu * dot(p[0], p[1], p[2], o[0], o[1], o[2])
    px, py, pz = times(f, p[0], p[1], p[2])
    ox, oy, oz = times(f, o[0], o[1], o[2])
    return (
        h[0] + ((isotropic + shear * ff[0]) + (mu + lame) * (px * ox)),
        h[1] + (shear * ff[3] + (mu * (ox * py) + lame * (px * oy))),
        h[2] + (shear * ff[4] + (mu * (ox * pz) + lame * (px * oz))),
        h[3] + (shear * ff[3] + (mu * (oy * px) + lame * (py * ox))),
        h[4] + ((isotropic + shear * ff[1]) + (mu + lame) * (py * oy)),
        h[5] + (shear * ff[5] + (mu * (oy * pz) + lame * (py * oz))),
        h[6] + (shear * ff[4] + (mu * (oz * px) + lame * (pz * ox))),
        h[7] + (shear * ff[5] + (mu * (oz * py) + lame * (pz * oy))),
        h[8] + ((isotropic + shear * ff[2]) + (mu + lame) * (pz * oz)),
    )  # fmt: skip
