"""Vertex block descent: one vertex of a tetrahedral body moves to reduce the incremental potential, all others fixed.

A. H. Chen, Z. Liu, Y. Yang, C. Yuksel, "Vertex Block Descent", ACM TOG 43 (2024), section 3. Backward Euler's step of h
from x0 minimises sum m |x - y|^2 / (2 h^2) + sum V W(F), y = x0 + h v + h^2 a with all but elastic forces in a. For one
vertex, whose row of B in a tetrahedron is b (F changes by dx b'), the derivative is m / h^2 (x - y) + sum V P b. The
block of second derivatives is m / h^2 I + sum V K, with
  K = k_D |b|^2 I + k_H (G b)(G b)'        (formulas/elastic/energy.py)

That is the whole block of the neo-Hookean material: J is linear in one vertex, so that its energy is a square. For the
other materials it omits the rotation of R, k_D (C_D's) and k_H C_H (the corotated C_H's) times b' dR/dF b. This changes
the path, not the solution: a vertex stays where the derivative is 0, whatever K is. Fixed corotated: K is never less
than the curvature, since |F - R(F)| is the smallest |F - R| of any R and so at most that with the old R; every visit
lowers the potential. Corotated: this holds while k_H C_H < k_D. Where it is stretched more, the omitted term is added
and the block is the whole one; otherwise vertices would overshoot and never come to rest.

Iterations begin at y where a body is free: all of it falls. Where it is pinned they begin at x0 + h v. There the load
is already balanced, and a body at rest stays at rest for any number of iterations. From y, iterations would have to
undo h^2 a again in each substep, and would leave a bar of 1 MPa 20 times too soft at 10 of them. (The paper's adaptive
start is between the two by the acceleration of the last step, which the state does not contain.)

A damper resists the rate of Green's strain, as in Newton's method (damper.py). The paper's damper (section 3.5) takes K
(x - x0) of one vertex alone, which slows down falling and rotating bodies; this one does not act on a rigid motion, has
no moment, and is the same for small strains. Its second derivative is complete except for the contribution of its
stress where that is compressive. All equations are divided by m / h^2, so that their only unit is m.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.constraints.tetrahedron import COROTATED, HOOKEAN
from softlab.model.formulas.elastic import damper, deformation
from softlab.model.formulas.elastic import energy as energies
from softlab.model.formulas.elastic.damper import block, resisted, scaled, squared, strain, stressed, symmetric
from softlab.model.formulas.elastic.deformation import gradient, times
from softlab.model.formulas.elastic.energy import stress
from softlab.model.formulas.lengths import dot

COUNT = 13  # values of a tetrahedron: 9 of B; at 9, 10 V k_D, V k_H [J]; at 11 alpha, or 1; at 12 `time` [s]
STRAINS = 6  # entries of E_0, which is symmetric: xx, yy, zz, xy, xz, yz
SUMS = 9  # numbers of a vertex: three of the derivative; xx, yy, zz, xy, xz, yz of the block
OPERATIONS_ELEMENT = 2 + 15 + 15 + 5 + 4 + 15 + 9  # the row, P b, G b, |b|^2, k_D |b|^2, the block, the sums
OPERATIONS_DAMPER = damper.OPERATIONS + damper.OPERATIONS_BLOCK
OPERATIONS_TURNING = 30 + 15 + 5 + 14 + 30  # F R', its product with b, the determinant, the matrix
OPERATIONS_MOVE = 3 + 12 + 9 + 35  # x - y, the scales, to add the mass, to solve
OPERATIONS_START = 6


def operations(material: int, item: int, damped: bool) -> int:
    """Count the operations of one tetrahedron at one of its vertices, on numbers of `item` bytes."""
    stress = deformation.OPERATIONS_GRADIENT + energies.operations(material, item)
    return stress + OPERATIONS_ELEMENT + damped * OPERATIONS_DAMPER


@formula
def initial_strain(points, values):
    """E, six numbers, of the four corners at the start of a substep."""
    return strain(gradient(points[0], points[1], points[2], points[3], values))


@formula
def damping(f, before, values, rate):
    """Return the damper's stress N by Hooke's law in Green's strain, and its moduli mu and lambda, all times V tau / h."""
    mu, lame = 0.5 * values[9], values[10]
    if FEATURE.material == HOOKEAN:
        mu, lame = values[9], values[10] - values[9]
    mu, lame = scaled(values[12], rate, mu, lame)
    e = strain(f)
    _, n = resisted(
        (e[0] - before[0], e[1] - before[1], e[2] - before[2], e[3] - before[3], e[4] - before[4], e[5] - before[5]),
        mu, lame,
    )  # fmt: skip
    return n, mu, lame


@formula
def element(points, values, before, corner, rate):
    """Contribution of a tetrahedron to the nine sums of its corner.

    `before`: E at the start of the substep, read only with a damper; `rate`: 1 / h.
    """
    f = gradient(points[0], points[1], points[2], points[3], values)
    p, g, r, pull = stress(f, values[9], values[10], values[11])
    x, y, z = row(values, corner)
    if FEATURE.damped:
        n, mu, lame = damping(f, before, values, rate)
        p = stressed(p, f, n)
    fx, fy, fz = times(p, x, y, z)
    gx, gy, gz = times(g, x, y, z)
    shape, pressure, excess = values[9], values[10], pull - values[9]
    shear = shape * dot(x, y, z, x, y, z)
    px, py, pz = pressure * gx, pressure * gy, pressure * gz
    xx, yy, zz, xy, xz, yz = shear + px * gx, shear + py * gy, shear + pz * gz, px * gy, px * gz, py * gz
    if FEATURE.material == COROTATED:
        turn = turning(f, r, x, y, z, excess)
        xx, yy, zz = xx + turn[0], yy + turn[1], zz + turn[2]
        xy, xz, yz = xy + turn[3], xz + turn[4], yz + turn[5]
    if FEATURE.damped:
        nx, ny, nz = symmetric(n, x, y, z)
        shear = max(dot(x, y, z, nx, ny, nz), 0.0)
        h = block(
            (shear, 0.0, 0.0, 0.0, shear, 0.0, 0.0, 0.0, shear),
            f,
            squared(f),
            (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            mu,
            lame,
            (x, y, z),
            (x, y, z),
        )
        xx, yy, zz = xx + h[0], yy + h[4], zz + h[8]
        xy, xz, yz = xy + h[1], xz + h[2], yz + h[5]
    return fx, fy, fz, xx, yy, zz, xy, xz, yz


@formula
def row(values, corner):
    """b of corner 0 to 3 of a tetrahedron."""
    if corner == 1:
        return values[0], values[1], values[2]
    if corner == 2:
        return values[3], values[4], values[5]
    if corner == 3:
        return values[6], values[7], values[8]
    x, y, z = values[0] + values[3], values[1] + values[4], values[2] + values[5]
    return -x - values[6], -y - values[7], -z - values[8]


@formula
def turning(f, r, x, y, z, excess):
    """`excess` times b' dR/dF b = ((b'Gb) G - (Gb)(Gb)') / det G with G = tr S - S, all rotated by R; six
    numbers."""
    xx, yy, zz = (
        dot(f[0], f[1], f[2], r[0], r[1], r[2]), dot(f[3], f[4], f[5], r[3], r[4], r[5]),
        dot(f[6], f[7], f[8], r[6], r[7], r[8]),
    )  # fmt: skip
    xy, xz = -dot(f[0], f[1], f[2], r[3], r[4], r[5]), -dot(f[0], f[1], f[2], r[6], r[7], r[8])
    yz = -dot(f[3], f[4], f[5], r[6], r[7], r[8])
    xx, yy, zz = yy + zz, xx + zz, xx + yy
    bx, by, bz = times(r, x, y, z)
    gx, gy, gz = symmetric((xx, yy, zz, xy, xz, yz), bx, by, bz)
    determinant = dot(xx, xy, xz, yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    scale = 0.0
    if (excess > 0.0) & (determinant > 0.0):
        scale = excess / determinant
    along = scale * dot(bx, by, bz, gx, gy, gz)
    gx, gy, gz, hx, hy, hz = scale * gx, scale * gy, scale * gz, gx, gy, gz
    return (
        along * xx - gx * hx, along * yy - gy * hy, along * zz - gz * hz, along * xy - gx * hy, along * xz - gx * hz,
        along * yz - gy * hz,
    )  # fmt: skip


@formula
def added(a, b):
    """Elementwise sum of nine numbers and nine more."""
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
        a[8] + b[8],
    )  # fmt: skip


@formula
def moved(point, inertial, weight, scale, sums):
    """Position of the vertex at `point` after its visit.

    `inertial`: y; `weight`: the mean mass over the vertex's; `scale`: h^2 over the mean mass. The block is
    symmetric and no less than I, so that L D L' needs no pivots.
    """
    softness = weight * scale
    gx = (point[0] - inertial[0]) + softness * sums[0]
    gy = (point[1] - inertial[1]) + softness * sums[1]
    gz = (point[2] - inertial[2]) + softness * sums[2]
    xx, yy, zz = 1.0 + softness * sums[3], 1.0 + softness * sums[4], 1.0 + softness * sums[5]
    xy, xz, yz = softness * sums[6], softness * sums[7], softness * sums[8]
    first = 1.0 / xx
    yx, zx = xy * first, xz * first
    second = 1.0 / (yy - yx * xy)
    below = yz - yx * xz
    zy = below * second
    third = 1.0 / ((zz - zx * xz) - zy * below)
    by = gy - yx * gx
    bz = ((gz - zx * gx) - zy * by) * third
    by = by * second - zy * bz
    bx = (gx * first - yx * by) - zx * bz
    return point[0] - bx, point[1] - by, point[2] - bz


@formula
def coasted(before, velocity, h):
    """Position of a vertex without any force."""
    return before[0] + h * velocity[0], before[1] + h * velocity[1], before[2] + h * velocity[2]


@formula
def carried(inertial, now, before):
    return inertial + (now - before)
