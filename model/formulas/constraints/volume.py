"""Volume of a tetrahedron a, b, c, d, values (6 V0 [m^3], 36 V0 [m^3]), V0 the volume at rest.

The constraint is six times the volume, C = e . (f x g) - 6 V0 with the edges e, f, g from a to b, c, d. Its gradients
by b, c, d are f x g, g x e, e x f (J. Bender et al., "A Survey on Position-Based Simulation Methods in Computer
Graphics", Comput. Graph. Forum 33 (2014), section 4.3, there with the 1/6). The energy K/2 (V - V0)^2 / V0 = K / (36
V0) C^2 / 2 of a bulk modulus K [Pa] gives the compliance 36 V0 / K (Macklin et al., XPBD, 2016, eq. 4).
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.bending import shift, softness
from softlab.model.formulas.distance import reciprocal
from softlab.model.formulas.lengths import cross, dot

OPERATIONS = (
    123  # 9 differences, 27 for the products, 5 + 1 the constraint, 6 + 27 the weight, 6 the change, 42 to apply it
)


@formula
def change_of(sixfold, rest, inverse, compliance, multiplier):
    """Change of the multiplier."""
    return (-(sixfold - rest) - compliance * multiplier) * inverse


@formula
def project(points, before, weights, values, multipliers, constants):
    a, b, c, d = points
    wa, wb, wc, wd = weights
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    fx, fy, fz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    gx, gy, gz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    bx, by, bz = cross(fx, fy, fz, gx, gy, gz)
    cx, cy, cz = cross(gx, gy, gz, ex, ey, ez)
    dx, dy, dz = cross(ex, ey, ez, fx, fy, fz)
    ax, ay, az = -(bx + cx) - dx, -(by + cy) - dy, -(bz + cz) - dz
    weight = (wa * dot(ax, ay, az, ax, ay, az) + wb * dot(bx, by, bz, bx, by, bz)) + (
        wc * dot(cx, cy, cz, cx, cy, cz) + wd * dot(dx, dy, dz, dx, dy, dz)
    )
    compliance = softness(constants[0], values[1])
    inverse = reciprocal(weight, constants[2], compliance)
    multiplier = multipliers[0]
    change = change_of(dot(ex, ey, ez, bx, by, bz), values[0], inverse, compliance, multiplier)
    moved = (
        shift(a, wa, ax, ay, az, change), shift(b, wb, bx, by, bz, change), shift(c, wc, cx, cy, cz, change),
        shift(d, wd, dx, dy, dz, change),
    )  # fmt: skip
    return moved, (multiplier + change,)
