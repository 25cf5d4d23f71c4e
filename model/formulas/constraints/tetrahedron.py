"""Elastic energy of a tetrahedron a, b, c, d as two constraints, one after the other.

Each term of the energy per volume W = k_D C_D^2 / 2 + k_H C_H^2 / 2 is a constraint of compliance 1 / (k V), V the
volume at rest (M. Macklin et al., "XPBD", MIG 2016, eq. 4). R is the rotation nearest to F, J = det F:
  fixed corotated   C_D = |F - R|        k_D = 2 mu    C_H = J - 1           k_H = lambda
  corotated         C_D = |F - R|        k_D = 2 mu    C_H = tr(R'F) - 3     k_H = lambda
  neo-Hookean       tetrahedron_hookean.py             C_H = J - 1           k_H = lambda
A. Stomakhin et al., "Energetically Consistent Invertible Elasticity", SCA 2012, eq. 4; B. Smith, F. de Goes, T. Kim,
"Stable Neo-Hookean Flesh Simulation", TOG 37 (2018), section 3.4. The shape of the neo-Hookean material is not a
length, but an energy term with its minimum at rest, and has nine multipliers.

C_D is the length of G = F - R, and G / C_D its derivative by F. With the multiplier's change written as C_D x, XPBD's
eq. 18 times C_D^2 has no root except where a multiplier is kept, and no division by C_D; where C_D is 0 it does
nothing:
  (sum w |G b|^2 + alpha~ C_D^2) x = -C_D^2 - C_D alpha~ lambda,    each corner moves by w x G b,  b its row of B
The scalar rows rotate with F. Multipliers kept through iterations stay along directions that the rows have left, so
that they end some per cent away from the step of implicit Euler that they represent. `blocks` treats F - R as one
system instead (tetrahedron_block.py): its multipliers do not rotate, and it ends at that step. The neo-Hookean material
ends there without.

A damper's stress is `time` times the rate of the elastic one: alpha beta = time in XPBD's eq. 26, gamma = time / h.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.bending import shift, softness
from softlab.model.formulas.constraints.tetrahedron_block import OPERATIONS as OPERATIONS_BLOCK
from softlab.model.formulas.constraints.tetrahedron_block import OPERATIONS_DAMPER as OPERATIONS_BLOCK_DAMPER
from softlab.model.formulas.constraints.tetrahedron_block import OPERATIONS_SOFT as OPERATIONS_BLOCK_SOFT
from softlab.model.formulas.constraints.tetrahedron_block import block
from softlab.model.formulas.constraints.tetrahedron_hookean import OPERATIONS as OPERATIONS_HOOKEAN
from softlab.model.formulas.constraints.tetrahedron_hookean import OPERATIONS_COMBINED, combined, descend
from softlab.model.formulas.constraints.tetrahedron_hookean import OPERATIONS_DAMPER as OPERATIONS_HOOKEAN_DAMPER
from softlab.model.formulas.constraints.tetrahedron_hookean import OPERATIONS_SOFT as OPERATIONS_HOOKEAN_SOFT
from softlab.model.formulas.distance import reciprocal
from softlab.model.formulas.elastic.deformation import (
    OPERATIONS_COFACTOR,
    OPERATIONS_DETERMINANT,
    OPERATIONS_FRAMED,
    OPERATIONS_FRAMED_CORNERS,
    OPERATIONS_ROTATION,
    cofactor,
    determinant,
    framed_corners,
    framed_gradient,
    rotation,
)
from softlab.model.formulas.lengths import dot

MATERIALS = ("fixed-corotated", "corotated", "neo-hookean")
FIXED, COROTATED, HOOKEAN = range(len(MATERIALS))
BLOCKS = 10  # multipliers of a block, and of a neo-Hookean tetrahedron: nine for the shape, one for C_H
ROWS = 2
COUNT = 10  # values: 6 of B (make_framed); at 6, 7 the compliances of C_D, C_H, 1 / (k V) [1/J]; J at rest; `time` [s]
SOFT_SHAPE, SOFT_VOLUME, REST, TIME = range(6, COUNT)
OPERATIONS_ROW = OPERATIONS_FRAMED_CORNERS + 27 + 9 + 28  # ..., the weight, the change, its application
OPERATIONS_ROW_DAMPER, OPERATIONS_ROW_SOFT = 4 * 8 + 4, 2  # displacements of four corners; the multiplier


def operations(
    material: int, item: int, damped: int = False, blocks: int = False, soft: int = False, alone: int = True
) -> int:
    """Count the operations of one projection on numbers of `item` bytes; flags as in `make`."""
    rotation, volume = OPERATIONS_ROTATION[item], 0
    row = OPERATIONS_ROW + damped * OPERATIONS_ROW_DAMPER + soft * OPERATIONS_ROW_SOFT
    if alone:
        slope = rotation + 18 if material == COROTATED else OPERATIONS_COFACTOR + OPERATIONS_DETERMINANT
        volume = OPERATIONS_FRAMED + slope + row
    if material == HOOKEAN:
        shape = OPERATIONS_HOOKEAN + damped * OPERATIONS_HOOKEAN_DAMPER + soft * OPERATIONS_HOOKEAN_SOFT
        return OPERATIONS_FRAMED + shape + volume + (soft and alone) * OPERATIONS_COMBINED
    shape = (
        OPERATIONS_BLOCK + soft * OPERATIONS_BLOCK_SOFT if blocks else 18 + row + soft * OPERATIONS_ROW_SOFT
    )  # 18 for C_D^2
    if blocks and damped:
        shape += rotation + OPERATIONS_BLOCK_DAMPER
    if not blocks:
        shape += 9  # F - R
    return OPERATIONS_FRAMED + rotation + shape + volume


@formula
def damper(values, constants):
    return scaled(constants[1], values[TIME]) if FEATURE.damped else 0.0


@formula
def with_volume(points, before, weights, values, multiplier, gamma, constants):
    """Return (corners after C_H, multiplier of C_H)."""
    if not FEATURE.alone:
        return points, 0.0
    violation, g = dilation(framed_gradient(points[0], points[1], points[2], points[3], values), values[REST])
    compliance = softness(constants[0], values[SOFT_VOLUME])
    return row(points, before, weights, values, violation, g, compliance, multiplier, gamma)


@formula
def project_block(points, before, weights, values, multipliers, constants):
    gamma, compliance = damper(values, constants), softness(constants[0], values[SOFT_SHAPE])
    points, first = block(points, before, weights, values, compliance, multipliers, gamma)
    points, second = with_volume(points, before, weights, values, multipliers[9], gamma, constants)
    return points, (*first, second)


@formula
def project_by_rows(points, before, weights, values, multipliers, constants):
    gamma, compliance = damper(values, constants), softness(constants[0], values[SOFT_SHAPE])
    squared, g = distortion(framed_gradient(points[0], points[1], points[2], points[3], values))
    points, first = row_of_length(points, before, weights, values, squared, g, compliance, multipliers[0], gamma)
    points, second = with_volume(points, before, weights, values, multipliers[1], gamma, constants)
    return points, (first, second)


@formula
def project_hookean(points, before, weights, values, multipliers, constants):
    gamma, compliance = damper(values, constants), softness(constants[0], values[SOFT_SHAPE])
    points, first = descend(points, before, weights, values, compliance, multipliers, gamma)
    if not FEATURE.alone:
        return points, (*first, 0.0)
    violation, g = dilation(framed_gradient(points[0], points[1], points[2], points[3], values), values[REST])
    compliance = softness(constants[0], values[SOFT_VOLUME])
    points, second = row(points, before, weights, values, violation, g, compliance, multipliers[9], gamma)
    if FEATURE.soft:
        first = combined(first, second - multipliers[9], g)
    return points, (*first, second)


@formula
def project(points, before, weights, values, multipliers, constants):
    """Project a tetrahedron, see the package.

    FEATURE.material: an index into MATERIALS; .damped: with the damper; .blocks: see the head of the file; .soft:
    multipliers may differ from 0; .alone: with C_H, which a voxel may have instead (voxel_volume.py).
    """
    if FEATURE.material == HOOKEAN:
        return project_hookean(points, before, weights, values, multipliers, constants)
    if FEATURE.blocks:
        return project_block(points, before, weights, values, multipliers, constants)
    return project_by_rows(points, before, weights, values, multipliers, constants)


@formula
def distortion(f):
    """Return (C_D^2, G) of a material that has a length C_D."""
    r = rotation(f)
    g = (
        f[0] - r[0], f[1] - r[1], f[2] - r[2], f[3] - r[3], f[4] - r[4], f[5] - r[5],
        f[6] - r[6], f[7] - r[7], f[8] - r[8],
    )  # fmt: skip
    squared = (dot(g[0], g[1], g[2], g[0], g[1], g[2]) + dot(g[3], g[4], g[5], g[3], g[4], g[5])) + dot(
        g[6], g[7], g[8], g[6], g[7], g[8]
    )
    return squared, g


@formula
def dilation(f, rest):
    """Return (C_H, derivative of C_H by F)."""
    if FEATURE.material == COROTATED:
        r = rotation(f)
        along = (dot(r[0], r[1], r[2], f[0], f[1], f[2]) + dot(r[3], r[4], r[5], f[3], f[4], f[5])) + dot(
            r[6], r[7], r[8], f[6], f[7], f[8]
        )
        return along - 3.0, r
    cofactors = cofactor(f)
    return determinant(f, cofactors) - rest, cofactors


@formula
def passed(g, now, before):
    """Displacement of a corner in this substep, projected on the constraint's gradient."""
    return dot(g[0], g[1], g[2], now[0] - before[0], now[1] - before[1], now[2] - before[2])


@formula
def change_of(violation, accumulated, along, inverse):
    """Change of the multiplier."""
    return ((-violation - accumulated) - along) * inverse


@formula
def scaled(scale, value):
    return scale * value


@formula
def changed(points, before, weights, values, violation, g, accumulated, compliance, gamma):
    """Return (corners after a constraint whose derivative by F is `g`, change of its multiplier).

    `accumulated`: compliance times the multiplier so far.
    """
    a, b, c, d = points
    wa, wb, wc, wd = weights
    ga, gb, gc, gd = framed_corners(g, values)
    weight = (
        wa * dot(ga[0], ga[1], ga[2], ga[0], ga[1], ga[2]) + wb * dot(gb[0], gb[1], gb[2], gb[0], gb[1], gb[2])
    ) + (wc * dot(gc[0], gc[1], gc[2], gc[0], gc[1], gc[2]) + wd * dot(gd[0], gd[1], gd[2], gd[0], gd[1], gd[2]))
    along = 0.0
    if FEATURE.damped:
        p, q, r, s = before
        along = scaled(gamma, (passed(ga, a, p) + passed(gb, b, q)) + (passed(gc, c, r) + passed(gd, d, s)))
    change = change_of(violation, accumulated, along, reciprocal(weight, 1.0 + gamma, compliance))
    moved = (
        shift(a, wa, ga[0], ga[1], ga[2], change), shift(b, wb, gb[0], gb[1], gb[2], change),
        shift(c, wc, gc[0], gc[1], gc[2], change), shift(d, wd, gd[0], gd[1], gd[2], change),
    )  # fmt: skip
    return moved, change


@formula
def row(points, before, weights, values, violation, g, compliance, multiplier, gamma):
    """Return (corners after one constraint, its multiplier)."""
    accumulated = scaled(compliance, multiplier) if FEATURE.soft else 0.0
    moved, change = changed(points, before, weights, values, violation, g, accumulated, compliance, gamma)
    return moved, multiplier + change


@formula
def row_of_length(points, before, weights, values, squared, g, compliance, multiplier, gamma):
    """Return (corners, multiplier) as by `row`, for the length of `g` as the constraint; `squared`: that length
    squared. See the head of the file."""
    length = sqrt(squared) if FEATURE.soft else 0.0
    accumulated = scaled(length, scaled(compliance, multiplier)) if FEATURE.soft else 0.0
    scaled_compliance = scaled(compliance, squared)
    moved, change = changed(points, before, weights, values, squared, g, accumulated, scaled_compliance, gamma)
    return moved, multiplier + scaled(length, change) if FEATURE.soft else 0.0
