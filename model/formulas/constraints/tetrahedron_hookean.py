"""Shape of a neo-Hookean tetrahedron as one descent step of the substep's energy: it exerts no force at rest.

M. Macklin, M. Mueller, "A Constraint-based Formulation of Stable Neo-Hookean Materials", MIG 2021, eq. 6 to 15, write W
as two constraints, |F| and J - alpha, which pull and push at rest and balance only together. The same W is the sum of
two terms that each vanish at rest, J = det F (expand the square of J - alpha, with (lambda + mu) (alpha - 1) = mu):
  mu / 2 (|F|^2 - 3) + (lambda + mu) / 2 ((J - alpha)^2 - (1 - alpha)^2) = mu / 2 S + lambda / 2 (J - 1)^2,
  S = |F|^2 + J^2 - 4 J,    G = dS/dF / 2 = F + (J - 2) cof F,    G = 0 at every rotation
The second term is the scalar row J - 1 of the fixed corotated material. The first one has nine multipliers, the impulse
Y of both rows as a matrix like F. Kept through iterations, they do not rotate with F: where sweeps end, Y is the stress
of W and the step is that of implicit Euler. H is the map from an impulse to a change of F (sum w b b' over the corners'
rows b of B). A visit follows the residual to the minimum of the substep's energy along it, to second order:
  R = -(G + alpha~ (Y - l cof F)) - gamma F (A - A0),    D = R H,    x = R:D / (alpha~ R:D + q),    Y += x R
l is the multiplier of J - 1 (Macklin, Mueller, Chentanez, "XPBD", MIG 2016, eq. 18, of which this is the matrix form).
q = D:S''/2:D = |D|^2 + (cof F : D)^2 + 2 (J - 2) F : cof D, exact, but at least 2 |D|^2, its value at rest without a
rotation: compressed below J = 0.16, the material has a negative curvature.

The damper is that of Kelvin and Voigt in Green's strain (A - I) / 2, A = F'F, A0 at the substep's start: a stress mu
time F dA/dt [Pa], which at rest is `time` times the rate of the elastic one. A rigid rotation does not change A.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, OfPrecision, formula
from softlab.model.formulas.elastic.deformation import (
    cofactor,
    determinant,
    framed_corners,
    framed_gradient,
    inner_product,
)
from softlab.model.formulas.lengths import dot

OPERATIONS = 27 + 5 + 19 + 33 + 12 + 24 + 36 + 17 + 17 + 27 + 17 + 12 + 24  # cof, J, G, R B, w, R:D, D, q, x, applied
OPERATIONS_COMBINED = 18
OPERATIONS_SOFT = 3 * OPERATIONS_COMBINED  # multipliers: two reads, one write
# F at the start, A, A0, their difference, its stress, the sum; of q |D|^2, the slope and its square, D'D, its product,
# 5
OPERATIONS_DAMPER = 36 + 60 + 6 + 45 + OPERATIONS_COMBINED + 17 + 66 + 12 + 30 + 12 + 5

LEAST = OfPrecision(lambda real: np.finfo(real).tiny / np.finfo(real).eps)


@formula
def displaced(weight, row):
    return weight * row[0], weight * row[1], weight * row[2]


@formula
def shifted(point, scale, direction):
    return point[0] + scale * direction[0], point[1] + scale * direction[1], point[2] + scale * direction[2]


@formula
def larger(a, b):
    return a if a > b else b


@formula
def curvature(f, cofactors, excess, d):
    """q. `excess`: J - 2."""
    first, squared = inner_product(cofactors, d), inner_product(d, d)
    second = (excess + excess) * inner_product(f, cofactor(d))
    return larger(squared + (first * first + second), squared + squared)


@formula
def friction(f, d, grown, least_part):
    """Contribution of the damper to q, over gamma. `grown`: A - A0."""
    return larger(halved(slope(f, d)) + larger(along(grown, strain(d)), 0.0), least_part)


@formula
def step_of(impulse, compliance, q):
    """Step size x."""
    return impulse / (compliance * impulse + q) if impulse > LEAST else 0.0


@formula
def descend(points, before, weights, values, compliance, m, gamma):
    f = framed_gradient(points[0], points[1], points[2], points[3], values)
    c = cofactor(f)
    excess = determinant(f, c) - 2.0
    y = combined(f, excess, c)
    if FEATURE.soft:
        y = combined(y, compliance, combined(m, -m[9], c))
    grown = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if FEATURE.damped:
        grown = less(strain(f), strain(framed_gradient(before[0], before[1], before[2], before[3], values)))
        y = combined(y, gamma, stretched(f, grown))
    r = -y[0], -y[1], -y[2], -y[3], -y[4], -y[5], -y[6], -y[7], -y[8]
    ra, rb, rc, rd = framed_corners(r, values)
    a, b, e, g = (
        displaced(weights[0], ra), displaced(weights[1], rb), displaced(weights[2], rc), displaced(weights[3], rd)
    )  # fmt: skip
    impulse = (
        dot(ra[0], ra[1], ra[2], a[0], a[1], a[2]) + dot(rb[0], rb[1], rb[2], b[0], b[1], b[2])
    ) + (dot(rc[0], rc[1], rc[2], e[0], e[1], e[2]) + dot(rd[0], rd[1], rd[2], g[0], g[1], g[2]))  # fmt: skip
    d = framed_gradient(a, b, e, g, values)
    q = curvature(f, c, excess, d)
    if FEATURE.damped:
        squared = inner_product(d, d)
        q = q + gamma * friction(f, d, grown, squared + squared)
    x = step_of(impulse, compliance, q)
    points = shifted(points[0], x, a), shifted(points[1], x, b), shifted(points[2], x, e), shifted(points[3], x, g)
    return points, (combined(m, x, r) if FEATURE.soft else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@formula
def combined(a, scale, b):
    """A + scale B."""
    return (
        a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2], a[3] + scale * b[3], a[4] + scale * b[4],
        a[5] + scale * b[5], a[6] + scale * b[6], a[7] + scale * b[7], a[8] + scale * b[8],
    )  # fmt: skip


@formula
def strain(f):
    """F'F, six numbers."""
    return (
        dot(f[0], f[3], f[6], f[0], f[3], f[6]), dot(f[0], f[3], f[6], f[1], f[4], f[7]),
        dot(f[0], f[3], f[6], f[2], f[5], f[8]), dot(f[1], f[4], f[7], f[1], f[4], f[7]),
        dot(f[1], f[4], f[7], f[2], f[5], f[8]), dot(f[2], f[5], f[8], f[2], f[5], f[8]),
    )  # fmt: skip


@formula
def stretched(f, s):
    """F S, S symmetric."""
    return (
        dot(f[0], f[1], f[2], s[0], s[1], s[2]), dot(f[0], f[1], f[2], s[1], s[3], s[4]),
        dot(f[0], f[1], f[2], s[2], s[4], s[5]), dot(f[3], f[4], f[5], s[0], s[1], s[2]),
        dot(f[3], f[4], f[5], s[1], s[3], s[4]), dot(f[3], f[4], f[5], s[2], s[4], s[5]),
        dot(f[6], f[7], f[8], s[0], s[1], s[2]), dot(f[6], f[7], f[8], s[1], s[3], s[4]),
        dot(f[6], f[7], f[8], s[2], s[4], s[5]),
    )  # fmt: skip


@formula
def twice(f, d, i, j):
    """Entry (i, j) of F'D + D'F."""
    return dot(f[i], f[i + 3], f[i + 6], d[j], d[j + 3], d[j + 6]) + dot(
        d[i], d[i + 3], d[i + 6], f[j], f[j + 3], f[j + 6]
    )


@formula
def slope(f, d):
    """F'D + D'F, six numbers: the derivative of F'F along D."""
    return (
        twice(f, d, 0, 0),
        twice(f, d, 0, 1),
        twice(f, d, 0, 2),
        twice(f, d, 1, 1),
        twice(f, d, 1, 2),
        twice(f, d, 2, 2),
    )


@formula
def less(s, t):
    """S - T of symmetric matrices."""
    return s[0] - t[0], s[1] - t[1], s[2] - t[2], s[3] - t[3], s[4] - t[4], s[5] - t[5]


@formula
def halved(s):
    """|S|^2 / 2 of a symmetric matrix."""
    off = dot(s[1], s[2], s[4], s[1], s[2], s[4])
    return 0.5 * dot(s[0], s[3], s[5], s[0], s[3], s[5]) + off


@formula
def along(s, t):
    """tr(S T) of symmetric matrices."""
    off = dot(s[1], s[2], s[4], t[1], t[2], t[4])
    return dot(s[0], s[3], s[5], t[0], t[3], t[5]) + (off + off)
