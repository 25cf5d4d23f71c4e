"""Volume of a voxel of five tetrahedra as one constraint, in place of one for each of them.

Linear tetrahedra that each conserve their volume leave a body too few degrees of freedom: it locks near a Poisson's
ratio of 1/2. With the mean of J over a patch of them, here a voxel, there is one volume to conserve for about one
vertex:
  W_H = lambda (J' - 1)^2 / 2,    J' = V / V_0 of the voxel,    C = J' - 1, compliance 1 / (lambda V_0)
J. Nagtegaal, D. Parks, J. Rice, "On Numerically Accurate Finite Element Solutions in the Fully Plastic Range", CMAME 4
(1974); E. de Souza Neto, F. Andrade Pires, D. Owen, "F-bar-based Linear Triangles and Tetrahedra for Finite Strain
Analysis of Nearly Incompressible Solids", IJNME 62 (2005). The other terms of F are in tetrahedron.py, which then
constrains only shapes.

Corners: a to d belong to one tetrahedron each; e to h are those of the tetrahedron between them, as in
Projection.around: a with f, g, h; b with g, h, e; c with h, e, f; d with e, f, g. Where e, f, g, h has a positive
volume, the first and the third of the four have a negative one.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.bending import shift, softness
from softlab.model.formulas.constraints.tetrahedron import passed
from softlab.model.formulas.distance import reciprocal
from softlab.model.formulas.lengths import cross, dot

CORNERS, COUNT = (
    8,
    4,
)  # values: 1 / (6 V_0) [1/m^3]; the compliance 1 / (lambda V_0) [1/J]; J' at rest; a damper's time [s]
OPERATIONS = 5 * (9 + 27 + 6 + 5) + 4 * 9 + 8 * 6 + 8 * 9 + 20
OPERATIONS_DAMPER = 8 * 8 + 10  # the speed of eight corners along the constraint


@formula
def away(p, q):
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@formula
def pointed(a, b, c, d):
    """Return (six times the volume of a, b, c, d, its derivatives by the four)."""
    e, f, g = away(a, b), away(a, c), away(a, d)
    b = cross(f[0], f[1], f[2], g[0], g[1], g[2])
    c = cross(g[0], g[1], g[2], e[0], e[1], e[2])
    d = cross(e[0], e[1], e[2], f[0], f[1], f[2])
    a = -(b[0] + c[0]) - d[0], -(b[1] + c[1]) - d[1], -(b[2] + c[2]) - d[2]
    return dot(e[0], e[1], e[2], b[0], b[1], b[2]), a, b, c, d


@formula
def negative(p):
    return -p[0], -p[1], -p[2]


@formula
def less_two(first, plus, minus, more):
    """first + plus - minus - more: two of the four tetrahedra at the corner are negative."""
    return (
        (first[0] + plus[0]) - (minus[0] + more[0]), (first[1] + plus[1]) - (minus[1] + more[1]),
        (first[2] + plus[2]) - (minus[2] + more[2]),
    )  # fmt: skip


@formula
def less_one(first, plus, more, minus):
    """first + plus + more - minus: one of the four tetrahedra at the corner is negative."""
    return (
        (first[0] + plus[0]) + (more[0] - minus[0]), (first[1] + plus[1]) + (more[1] - minus[1]),
        (first[2] + plus[2]) + (more[2] - minus[2]),
    )  # fmt: skip


@formula
def gradients(points):
    a, b, c, d, e, f, g, h = points
    six_a, pa, pf, pg, ph = pointed(a, f, g, h)
    six_b, qb, qg, qh, qe = pointed(b, g, h, e)
    six_c, rc, rh, re, rf = pointed(c, h, e, f)
    six_d, sd, se, sf, sg = pointed(d, e, f, g)
    six, te, tf, tg, th = pointed(e, f, g, h)
    return (six + ((six_b - six_a) + (six_d - six_c))), (
        negative(pa), qb, negative(rc), sd, less_one(te, qe, se, re), less_two(tf, sf, pf, rf),
        less_one(tg, qg, sg, pg), less_two(th, qh, ph, rh),
    )  # fmt: skip


@formula
def square(g):
    return dot(g[0], g[1], g[2], g[0], g[1], g[2])


@formula
def scaled(scale, value):
    return scale * value


@formula
def weighted(w, n):
    """Sum of eight products."""
    return ((w[0] * n[0] + w[1] * n[1]) + (w[2] * n[2] + w[3] * n[3])) + (
        (w[4] * n[4] + w[5] * n[5]) + (w[6] * n[6] + w[7] * n[7])
    )


@formula
def project(points, before, weights, values, multipliers, constants):
    six, g = gradients(points)
    scale, compliance = values[0], softness(constants[0], values[1])
    weight = weighted(
        weights,
        (square(g[0]), square(g[1]), square(g[2]), square(g[3]), square(g[4]), square(g[5]), square(g[6]), square(g[7])),
    )  # fmt: skip
    violation, gamma = scaled(scale, six) - values[2], 0.0
    if FEATURE.damped:
        gamma = scaled(constants[1], values[3])
        travel = ((passed(g[0], points[0], before[0]) + passed(g[1], points[1], before[1]))
                  + (passed(g[2], points[2], before[2]) + passed(g[3], points[3], before[3]))
                  + (passed(g[4], points[4], before[4]) + passed(g[5], points[5], before[5]))
                  + (passed(g[6], points[6], before[6]) + passed(g[7], points[7], before[7])))  # fmt: skip
        violation = violation + scaled(gamma, scaled(scale, travel))
    accumulated = scaled(compliance, multipliers[0]) if FEATURE.soft else 0.0
    change = scaled(
        -violation - accumulated, reciprocal(scaled(scale, scaled(scale, weight)), 1.0 + gamma, compliance)
    )  # fmt: skip
    travel = scaled(scale, change)
    moved = (
        shift(points[0], weights[0], g[0][0], g[0][1], g[0][2], travel),
        shift(points[1], weights[1], g[1][0], g[1][1], g[1][2], travel),
        shift(points[2], weights[2], g[2][0], g[2][1], g[2][2], travel),
        shift(points[3], weights[3], g[3][0], g[3][1], g[3][2], travel),
        shift(points[4], weights[4], g[4][0], g[4][1], g[4][2], travel),
        shift(points[5], weights[5], g[5][0], g[5][1], g[5][2], travel),
        shift(points[6], weights[6], g[6][0], g[6][1], g[6][2], travel),
        shift(points[7], weights[7], g[7][0], g[7][1], g[7][2], travel),
    )
    return moved, (multipliers[0] + change if FEATURE.soft else 0.0,)
