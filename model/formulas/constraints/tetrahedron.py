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

Scalar rows turn with F, so that multipliers kept through iterations stay along directions that rows have left: they end some
per cent off the step of implicit Euler that they stand for. `blocks` takes F - R as nine rows instead, R held, which share
one 3 x 3 system, H + alpha~ with H = sum w g g' over the corners' rows g of B (with - their sum for the first), and ends
there. |F| holds a force at rest, which only C_H balances: of the neo-Hookean material there are no blocks.

A damper's stress is `time` times the rate of the elastic one: alpha beta = time in XPBD's eq. 26, gamma = time / h.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace
from typing import Any

from model.formulas import plain
from model.formulas.bending import make as make_bending
from model.formulas.distance import make as make_distance
from model.formulas.elastic.deformation import (
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
BLOCKS = 10  # multipliers of a block: nine of F - R, one of C_H
ROWS = 2
COUNT = 13  # values: 9 of B; at 9, 10 the compliances of C_D, C_H, 1 / (k V) [1/J]; at 11 alpha, or 1; at 12 `time` [s]
SMALLEST = 1e-9  # C_D of no direction: below it in float64, and below all that rounding leaves in float32
OPERATIONS_ROW = OPERATIONS_CORNERS + 27 + 9 + 28  # ..., the weight, the change, to apply it


def operations(material: int, item: int) -> int:
    """Of one projection, counted on numbers of `item` bytes."""
    rows = 2 * (OPERATIONS_GRADIENT + OPERATIONS_ROW) + 9 + 19  # F - R, the length of C_D and the division by it
    turns = {FIXED: 1, COROTATED: 2, HOOKEAN: 0}[material]
    volume = 0 if material == COROTATED else OPERATIONS_COFACTOR + OPERATIONS_DETERMINANT
    return rows + turns * OPERATIONS_ROTATION[item] + volume


def make(real, compiled=plain, material=FIXED, damped=False, blocks=False):
    """See the package; `material`: which of MATERIALS; `damped`: a damper counts; `blocks`: see the head of the file."""
    softness, gradient, zero = make_bending(real, compiled).softness, make_gradient(real, compiled).gradient, real(0)
    terms, one_row = make_terms(real, compiled, material), make_row(real, compiled, damped)
    distortion, dilation, row, scaled = terms.distortion, terms.dilation, one_row.row, one_row.scaled
    block: Any = make_block(real, compiled, damped) if blocks else None

    @compiled
    def project_block(points, before, weights, values, multipliers, constants):
        gamma = zero
        if damped:
            gamma = scaled(constants[1], values[12])
        compliance = softness(constants[0], values[9])
        points, first = block(points, before, weights, values, compliance, multipliers, gamma)
        violation, g = dilation(gradient(points[0], points[1], points[2], points[3], values), values[11])
        compliance = softness(constants[0], values[10])
        points, second = row(points, before, weights, values, violation, g, compliance, multipliers[9], gamma)
        return points, (*first, second)

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

    return SimpleNamespace(project=project_block if blocks else project)


def make_terms(real, compiled, material):
    """`distortion`, `dilation`: the two constraints of a material."""
    dot, elastic, rotation = (
        make_lengths(real, compiled).dot,
        make_gradient(real, compiled),
        make_rotation(real, compiled),
    )
    cofactor, determinant = elastic.cofactor, elastic.determinant
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

    return SimpleNamespace(distortion=distortion, dilation=dilation)


def make_row(real, compiled, damped):
    """`row`: one scalar constraint of four corners; `scaled`."""
    shift, reciprocal = make_bending(real, compiled).shift, make_distance(real, compiled).reciprocal
    dot, corners, zero, one = make_lengths(real, compiled).dot, make_gradient(real, compiled).corners, real(0), real(1)

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

    return SimpleNamespace(row=row, scaled=scaled)


def make_block(real, compiled, damped):
    """block(points, before, weights, values, compliance, multipliers, gamma) -> (points, nine multipliers): F - R at once."""
    elastic, rotation, one = make_gradient(real, compiled), make_rotation(real, compiled), real(1)
    gradient, corner, dot = elastic.gradient, elastic.corner, make_lengths(real, compiled).dot
    system = make_system(real, compiled)

    @compiled
    def asked(violation, compliance, multiplier):
        return -violation - compliance * multiplier

    @compiled
    def drawn(violation, gamma, now, before):
        """With what a damper adds."""
        return violation + gamma * (now - before)

    @compiled
    def moved(point, weight, way):
        return point[0] + weight * way[0], point[1] + weight * way[1], point[2] + weight * way[2]

    @compiled
    def solved(x, y, z, i):
        """A row of the violation times the inverse."""
        return dot(x, y, z, i[0], i[1], i[2]), dot(x, y, z, i[1], i[3], i[4]), dot(x, y, z, i[2], i[4], i[5])

    @compiled
    def block(points, before, weights, values, compliance, m, gamma):
        f = gradient(points[0], points[1], points[2], points[3], values)
        r = rotation(f)
        c = (
            f[0] - r[0], f[1] - r[1], f[2] - r[2], f[3] - r[3], f[4] - r[4], f[5] - r[5],
            f[6] - r[6], f[7] - r[7], f[8] - r[8],
        )  # fmt: skip
        if damped:
            p = gradient(before[0], before[1], before[2], before[3], values)
            c = (
                drawn(c[0], gamma, f[0], p[0]), drawn(c[1], gamma, f[1], p[1]), drawn(c[2], gamma, f[2], p[2]),
                drawn(c[3], gamma, f[3], p[3]), drawn(c[4], gamma, f[4], p[4]), drawn(c[5], gamma, f[5], p[5]),
                drawn(c[6], gamma, f[6], p[6]), drawn(c[7], gamma, f[7], p[7]), drawn(c[8], gamma, f[8], p[8]),
            )  # fmt: skip
        i = system(values, weights, compliance, one + gamma)
        x0, x1, x2 = solved(
            asked(c[0], compliance, m[0]), asked(c[1], compliance, m[1]), asked(c[2], compliance, m[2]), i
        )
        x3, x4, x5 = solved(
            asked(c[3], compliance, m[3]), asked(c[4], compliance, m[4]), asked(c[5], compliance, m[5]), i
        )
        x6, x7, x8 = solved(
            asked(c[6], compliance, m[6]), asked(c[7], compliance, m[7]), asked(c[8], compliance, m[8]), i
        )
        x = x0, x1, x2, x3, x4, x5, x6, x7, x8
        wb = corner(x, values[0], values[1], values[2])
        wc = corner(x, values[3], values[4], values[5])
        wd = corner(x, values[6], values[7], values[8])
        wa = -(wb[0] + wc[0]) - wd[0], -(wb[1] + wc[1]) - wd[1], -(wb[2] + wc[2]) - wd[2]
        points = (
            moved(points[0], weights[0], wa), moved(points[1], weights[1], wb), moved(points[2], weights[2], wc),
            moved(points[3], weights[3], wd),
        )  # fmt: skip
        return points, (
            m[0] + x0, m[1] + x1, m[2] + x2, m[3] + x3, m[4] + x4, m[5] + x5, m[6] + x6, m[7] + x7, m[8] + x8,
        )  # fmt: skip

    return block


def make_system(real, compiled):
    """system(rest, weights, compliance, stiffening): the inverse of what a block's nine rows share, six entries."""
    zero, one, dot = real(0), real(1), make_lengths(real, compiled).dot

    @compiled
    def weighted(weights, a, b, c, d, i, j):
        """An entry of H."""
        return (weights[0] * (a[i] * a[j]) + weights[1] * (b[i] * b[j])) + (
            weights[2] * (c[i] * c[j]) + weights[3] * (d[i] * d[j])
        )

    @compiled
    def inverse_of(xx, xy, xz, yy, yz, zz):
        """Of a symmetric matrix, six entries, by cofactors, over its trace first so that no product is too large or small."""
        trace = (xx + yy) + zz
        s = one / (trace if trace > zero else one)
        xx, xy, xz, yy, yz, zz = s * xx, s * xy, s * xz, s * yy, s * yz, s * zz
        cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        cyy, cyz, czz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        determinant = dot(xx, xy, xz, cxx, cxy, cxz)
        t = s / determinant if determinant > zero else zero
        return t * cxx, t * cxy, t * cxz, t * cyy, t * cyz, t * czz

    @compiled
    def system(rest, weights, compliance, stiffening):
        a = -(rest[0] + rest[3]) - rest[6], -(rest[1] + rest[4]) - rest[7], -(rest[2] + rest[5]) - rest[8]
        b, c, d = (rest[0], rest[1], rest[2]), (rest[3], rest[4], rest[5]), (rest[6], rest[7], rest[8])
        return inverse_of(
            stiffening * weighted(weights, a, b, c, d, 0, 0) + compliance, stiffening * weighted(weights, a, b, c, d, 0, 1),
            stiffening * weighted(weights, a, b, c, d, 0, 2),
            stiffening * weighted(weights, a, b, c, d, 1, 1) + compliance,
            stiffening * weighted(weights, a, b, c, d, 1, 2),
            stiffening * weighted(weights, a, b, c, d, 2, 2) + compliance,
        )  # fmt: skip

    return system
