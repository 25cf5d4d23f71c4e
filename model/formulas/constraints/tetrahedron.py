"""The elastic energy of a tetrahedron a, b, c, d as two constraints, one after the other.

Of the energy per volume W = k_D C_D^2 / 2 + k_H C_H^2 / 2 each term is a constraint of compliance 1 / (k V), V the volume at
rest (M. Macklin et al., "XPBD", MIG 2016, eq. 4). R is the rotation nearest to F, J = det F:

    fixed corotated   C_D = |F - R|        k_D = 2 mu    C_H = J - 1           k_H = lambda
    corotated         C_D = |F - R|        k_D = 2 mu    C_H = tr(R'F) - 3     k_H = lambda
    neo-Hookean       C_D = sqrt(tr F'F)   k_D = mu      C_H = J - alpha       k_H = lambda + mu

with alpha = 1 + mu / (lambda + mu): A. Stomakhin et al., "Energetically Consistent Invertible Elasticity", SCA 2012, eq. 4;
M. Macklin, M. Mueller, "A Constraint-based Formulation of Stable Neo-Hookean Materials", MIG 2021, eq. 6 to 15, but with
lambda + mu in place of their lambda, as B. Smith, F. de Goes, T. Kim, "Stable Neo-Hookean Flesh Simulation", TOG 37 (2018),
section 3.4, ask for in order that E and nu are Young's modulus and Poisson's ratio. Where C_D is 0 it has no gradient, and
does nothing.

A damper's stress is `time` times the rate of the elastic one: alpha beta = time in XPBD's eq. 26, gamma = time / h.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from model.formulas import plain
from model.formulas.bending import make as make_bending
from model.formulas.distance import make as make_distance
from model.formulas.elasticity import (
    OPERATIONS_COFACTOR,
    OPERATIONS_CORNERS,
    OPERATIONS_DETERMINANT,
    OPERATIONS_GRADIENT,
    OPERATIONS_ROTATION,
    make_gradient,
    make_rotation,
)
from model.formulas.lengths import make as make_lengths

MATERIALS = ("fixed-corotated", "corotated", "neo-hookean")
FIXED, COROTATED, HOOKEAN = range(len(MATERIALS))
COUNT = 13  # values: 9 of B; at 9, 10 the compliances of C_D, C_H, 1 / (k V) [1/J]; at 11 alpha, or 1; at 12 `time` [s]
SMALLEST = 1e-9  # C_D of no direction: below it in float64, and below all that rounding leaves in float32
OPERATIONS_ROW = OPERATIONS_CORNERS + 27 + 9 + 28  # ..., the weight, the change, to apply it


def operations(material: int, item: int) -> int:
    """Of one projection, counted on numbers of `item` bytes."""
    rows = 2 * (OPERATIONS_GRADIENT + OPERATIONS_ROW) + 9 + 19  # F - R, the length of C_D and the division by it
    turns = {FIXED: 1, COROTATED: 2, HOOKEAN: 0}[material]
    volume = 0 if material == COROTATED else OPERATIONS_COFACTOR + OPERATIONS_DETERMINANT
    return rows + turns * OPERATIONS_ROTATION[item] + volume


def make(real, compiled=plain, material=FIXED, damped=False):
    """See the package; `material`: which of MATERIALS; `damped`: a damper counts."""
    formulas, reciprocal = make_bending(real, compiled), make_distance(real, compiled).reciprocal
    softness, shift, dot = formulas.softness, formulas.shift, make_lengths(real, compiled).dot
    elastic = make_gradient(real, compiled)
    gradient, corners, cofactor, determinant = elastic.gradient, elastic.corners, elastic.cofactor, elastic.determinant
    rotation = make_rotation(real, compiled)
    zero, one, three, smallest = real(0), real(1), real(3), real(SMALLEST)
    is_hookean, is_corotated = material == HOOKEAN, material == COROTATED

    @compiled
    def distortion(f):
        """(C_D, its derivative by F)."""
        g = f
        if not is_hookean:
            r = rotation(f)
            g = (
                f[0] - r[0], f[1] - r[1], f[2] - r[2], f[3] - r[3], f[4] - r[4], f[5] - r[5],
                f[6] - r[6], f[7] - r[7], f[8] - r[8],
            )  # fmt: skip
        squared = (dot(g[0], g[1], g[2], g[0], g[1], g[2]) + dot(g[3], g[4], g[5], g[3], g[4], g[5])) + dot(
            g[6], g[7], g[8], g[6], g[7], g[8]
        )
        length = sqrt(squared)
        inverse = one / length if length > smallest else zero
        return length, (
            inverse * g[0], inverse * g[1], inverse * g[2], inverse * g[3], inverse * g[4], inverse * g[5],
            inverse * g[6], inverse * g[7], inverse * g[8],
        )  # fmt: skip

    @compiled
    def dilation(f, rest):
        """(C_H, its derivative by F)."""
        if is_corotated:
            r = rotation(f)
            along = (dot(r[0], r[1], r[2], f[0], f[1], f[2]) + dot(r[3], r[4], r[5], f[3], f[4], f[5])) + dot(
                r[6], r[7], r[8], f[6], f[7], f[8]
            )
            return along - three, r
        cofactors = cofactor(f)
        return determinant(f, cofactors) - rest, cofactors

    @compiled
    def passed(g, now, before):
        """How fast a corner's way in this substep takes the constraint along."""
        return dot(g[0], g[1], g[2], now[0] - before[0], now[1] - before[1], now[2] - before[2])

    @compiled
    def change_of(violation, compliance, multiplier, along, inverse):
        """Change of the multiplier."""
        return ((-violation - compliance * multiplier) - along) * inverse

    @compiled
    def scaled(gamma, along):
        return gamma * along

    @compiled
    def row(points, before, weights, values, violation, g, compliance, multiplier, gamma):
        """The corners after one constraint, and its multiplier."""
        a, b, c, d = points
        wa, wb, wc, wd = weights
        ga, gb, gc, gd = corners(g, values)
        weight = (
            wa * dot(ga[0], ga[1], ga[2], ga[0], ga[1], ga[2]) + wb * dot(gb[0], gb[1], gb[2], gb[0], gb[1], gb[2])
        ) + (wc * dot(gc[0], gc[1], gc[2], gc[0], gc[1], gc[2]) + wd * dot(gd[0], gd[1], gd[2], gd[0], gd[1], gd[2]))
        along = zero
        if damped:
            p, q, r, s = before
            along = scaled(gamma, (passed(ga, a, p) + passed(gb, b, q)) + (passed(gc, c, r) + passed(gd, d, s)))
        inverse = reciprocal(weight, one + gamma, compliance)
        change = change_of(violation, compliance, multiplier, along, inverse)
        moved = (
            shift(a, wa, ga[0], ga[1], ga[2], change), shift(b, wb, gb[0], gb[1], gb[2], change),
            shift(c, wc, gc[0], gc[1], gc[2], change), shift(d, wd, gd[0], gd[1], gd[2], change),
        )  # fmt: skip
        return moved, multiplier + change

    @compiled
    def project(points, before, weights, values, multipliers, constants):
        gamma = zero
        if damped:
            gamma = scaled(constants[1], values[12])
        violation, g = distortion(gradient(points[0], points[1], points[2], points[3], values))
        compliance = softness(constants[0], values[9])
        points, first = row(points, before, weights, values, violation, g, compliance, multipliers[0], gamma)
        violation, g = dilation(gradient(points[0], points[1], points[2], points[3], values), values[11])
        compliance = softness(constants[0], values[10])
        points, second = row(points, before, weights, values, violation, g, compliance, multipliers[1], gamma)
        return points, (first, second)

    return SimpleNamespace(project=project)
