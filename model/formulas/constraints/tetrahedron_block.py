"""The shape of a tetrahedron as a block: F - R as nine rows, R held, that share one 3 x 3 system; see tetrahedron.py.

A damper's rate is that of the stretch S = R'F in the material's own frame: h times it is R (S - S0) = F - R R0' F0, with F0
at the substep's start and R0 its rotation. A rigid turn, whose S stays, is not damped (objective rates: J. Simo, T. Hughes,
"Computational Inelasticity", Springer 1998, section 7.2).
"""

from __future__ import annotations

from model.formulas.elastic.deformation import make_framed, make_rotation
from model.formulas.lengths import make as make_lengths

OPERATIONS = 18 + 75 + 39 + 45 + 33 + 24 + 9  # right side, H + alpha~, its inverse, x, corners, to apply, to keep
OPERATIONS_DAMPER = 36 + 90 + 27  # besides a rotation: F of before, R R0' F0, the differences


def make_block(real, compiled, damped):
    """block(points, before, weights, values, compliance, multipliers, gamma) -> (points, nine multipliers): F - R at once."""
    elastic, rotation, one = make_framed(real, compiled), make_rotation(real, compiled), real(1)
    gradient, corners, dot = elastic.gradient, elastic.corners, make_lengths(real, compiled).dot
    system = make_system(real, compiled)

    @compiled
    def asked(violation, compliance, multiplier):
        return -violation - compliance * multiplier

    @compiled
    def drawn(violation, gamma, now, before):
        """With what a damper adds."""
        return violation + gamma * (now - before)

    @compiled
    def turned(q, a):
        """Q A, nine numbers."""
        return (
            dot(q[0], q[1], q[2], a[0], a[3], a[6]), dot(q[0], q[1], q[2], a[1], a[4], a[7]),
            dot(q[0], q[1], q[2], a[2], a[5], a[8]), dot(q[3], q[4], q[5], a[0], a[3], a[6]),
            dot(q[3], q[4], q[5], a[1], a[4], a[7]), dot(q[3], q[4], q[5], a[2], a[5], a[8]),
            dot(q[6], q[7], q[8], a[0], a[3], a[6]), dot(q[6], q[7], q[8], a[1], a[4], a[7]),
            dot(q[6], q[7], q[8], a[2], a[5], a[8]),
        )  # fmt: skip

    @compiled
    def transposed(a):
        return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]

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
            p = turned(r, turned(transposed(rotation(p)), p))
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
        wa, wb, wc, wd = corners(x, values)
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
        a = -rest[0], -(rest[1] + rest[3]), -(rest[2] + rest[4]) - rest[5]
        b, c, d = (rest[0], rest[1], rest[2]), (zero, rest[3], rest[4]), (zero, zero, rest[5])
        return inverse_of(
            stiffening * weighted(weights, a, b, c, d, 0, 0) + compliance, stiffening * weighted(weights, a, b, c, d, 0, 1),
            stiffening * weighted(weights, a, b, c, d, 0, 2),
            stiffening * weighted(weights, a, b, c, d, 1, 1) + compliance,
            stiffening * weighted(weights, a, b, c, d, 1, 2),
            stiffening * weighted(weights, a, b, c, d, 2, 2) + compliance,
        )  # fmt: skip

    return system
