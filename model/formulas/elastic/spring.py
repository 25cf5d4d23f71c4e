"""Spring between a vertex a and a place: a point p of the world, or the mean of four vertices with the weights s.

Energy k |C|^2 / 2, C = (a - sum s x) - p, with either s or p equal to 0. The derivative by a is k C, that by x of
weight s is -s k C, and all second derivatives are multiples of the identity.
"""

from __future__ import annotations

from softlab.model.base.variant import formula

CORNERS = 5  # the vertex, and four that carry it; without such a body, the vertex itself with weights of 0
AT_POINT, AT_STIFFNESS, COUNT = 4, 7, 8  # indices: after the weights, the point [m] and k [N/m]
OPERATIONS = 30  # for one corner


@formula
def mean(values, p, q, r, s):
    return (values[0] * p + values[1] * q) + (values[2] * r + values[3] * s)


@formula
def apart(points, values):
    """C of the five `points`."""
    a, p, q, r, s = points
    return (
        (a[0] - mean(values, p[0], q[0], r[0], s[0])) - values[4],
        (a[1] - mean(values, p[1], q[1], r[1], s[1])) - values[5],
        (a[2] - mean(values, p[2], q[2], r[2], s[2])) - values[6],
    )


@formula
def weight(values, corner):
    """Weight of a corner in C."""
    factor = 1.0
    if corner == 1:
        factor = -values[0]
    if corner == 2:
        factor = -values[1]
    if corner == 3:
        factor = -values[2]
    if corner == 4:
        factor = -values[3]
    return factor


@formula
def pull(points, values, corner):
    """Return (derivative by a corner, diagonal entry of its block, energy)."""
    x, y, z = apart(points, values)
    factor, hard = weight(values, corner), values[7]
    force = hard * factor
    energy = 0.5 * hard * ((x * x + y * y) + z * z)
    return force * x, force * y, force * z, force * factor, energy
