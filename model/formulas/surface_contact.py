"""Contact of bodies' surfaces: the side of a closed surface on which a vertex lies, and the direction out of it.

The vector from the nearest point of a closed surface to a vertex decides the side: along the triangle's normal where
the point lies in a face, and within the cone of the adjacent normals where it lies on an edge or a corner (J. A.
Baerentzen, H. Aanaes, "Signed Distance Computation Using the Angle Weighted Pseudonormal", IEEE TVCG 11 (2005)). One
triangle alone is used here: outward edges are not much sharper than a voxel's, so that an outside point is never far
behind the triangle. The rest of a contact: model/formulas/contact.py.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula
from softlab.model.formulas.contact import away, inverse, nearest, slip
from softlab.model.formulas.lengths import cross, dot, length

ALIGNED = 0.99999  # cosine of n with the triangle's normal above which n is that normal
PAST = 2.0**-10  # of a triangle beyond its edges, so that a path through an edge passes one of its triangles
NONE, BY_TRIANGLE, PASSED, NEAREST = range(4)  # what a contact's depth is checked against, see `checked`
SPLIT_OFFSET = 0.25  # added to a corner's weight where its particle's mass is split: levers act at weight 0, too


@formula
def outward(r, distance, u, v, flat):
    """Return (True if the vertex lies inside, unit direction out of the body).

    r: from the nearest point to the vertex, of length `distance`; u, v: the triangle's edges, in the order that is
    counterclockwise from outside. Below `flat`, where r is rounding, the direction is the triangle's normal. It is
    0 where the triangle has no area.
    """
    rx, ry, rz = r
    nx, ny, nz = cross(u[0], u[1], u[2], v[0], v[1], v[2])
    size = length(nx, ny, nz)
    if size <= 0.0:
        return False, 0.0, 0.0, 0.0
    nx, ny, nz = nx / size, ny / size, nz / size
    side = dot(nx, ny, nz, rx, ry, rz)
    if distance <= flat:
        return side < 0.0, nx, ny, nz
    if side < -(0.25 * distance):
        return True, -(rx / distance), -(ry / distance), -(rz / distance)
    return False, rx / distance, ry / distance, rz / distance


@formula
def load(weight, press):
    """Part of a corner of this weight in the split of its particle's mass, where surfaces rub; that of the vertex is
    the contact's normal impulse `press`. So all contacts of a particle get to Coulomb's limit together."""
    return press * (weight + SPLIT_OFFSET)


@formula
def split(weight, load, total):
    """Inverse mass of the piece of a particle with that load in one contact and the `total` load in all."""
    return weight * (total / load)


@formula
def scaled_length(ratio, length):
    """Length of a contact for a vertex whose lengths are `ratio` times those of the surfaces."""
    return ratio * length


@formula
def along(a, b):
    return dot(a[0], a[1], a[2], b[0], b[1], b[2])


@formula
def over(p, u, v):
    """Return (b, c, h): weights of the second and third corner of p's projection on the triangle's plane, and p's
    height over it [m].

    p, u, v: from the first corner. All are 0 where the triangle has no area.
    """
    m = cross(u[0], u[1], u[2], v[0], v[1], v[2])
    squared = along(m, m)
    s = 1.0 / squared if squared > 0.0 else 0.0
    b, c = along(cross(v[0], v[1], v[2], m[0], m[1], m[2]), p), along(cross(m[0], m[1], m[2], u[0], u[1], u[2]), p)
    return s * b, s * c, sqrt(s) * along(m, p)


@formula
def through(early, late):
    """True if a vertex has passed the triangle, or just beyond its edge, between two positions as computed by
    `over`."""
    if (early[2] >= 0.0) == (late[2] >= 0.0):
        return False
    part = early[2] / (early[2] - late[2])
    b, c = early[0] + part * (late[0] - early[0]), early[1] + part * (late[1] - early[1])
    return b >= -PAST and c >= -PAST and b + c <= 1.0 + PAST


@formula
def apart(p, q, w):
    """Distance of p from a triangle of the edges q and w, all from its first corner [m]."""
    _, b, c = nearest(q[0], q[1], q[2], w[0], w[1], w[2], p[0], p[1], p[2])
    x, y, z = away(p[0], q[0], w[0], b, c), away(p[1], q[1], w[1], b, c), away(p[2], q[2], w[2], b, c)
    return length(x, y, z)


@formula
def checked(n, r, u, v, p, q, w, depth, distance):
    """Return the check that limits `depth` > 0 [m], by a contact's plane, to the distance that the vertex lacks.

    n and the triangle's point are fixed for the substep, and the plane has no end: it reports a depth beside the
    triangle, too, where the two are apart. r: from that point to the vertex at the substep's start; u, v: the
    triangle's edges then; q, w: its edges now; p: from its first corner to the vertex.

    NONE: the vertex began inside, and is as deep as n says. BY_TRIANGLE: depth <= distance - `apart` of the triangle.
    PASSED: so, unless the vertex, now behind the plane, came `through` this triangle or one that shares a corner
    with it: then it is as deep as n says. NEAREST: so, with `apart` of the nearest of these triangles: n is the
    triangle's own normal, and the vertex is beside it, where the surface may go on.
    """
    if along(n, r) <= 0.0:
        return NONE
    b, c, _ = over(p, q, w)
    m = cross(u[0], u[1], u[2], v[0], v[1], v[2])
    if (b < 0.0 or c < 0.0 or b + c > 1.0) and abs(along(n, m)) >= ALIGNED * length(m[0], m[1], m[2]):
        return NEAREST
    return PASSED if depth > distance else BY_TRIANGLE


@formula
def times(part, a):
    return part * a[0], part * a[1], part * a[2]


@formula
def less(a, part, b):
    """a - part b."""
    return a[0] - part * b[0], a[1] - part * b[1], a[2] - part * b[2]


@formula
def across(a, r):
    """Component of a perpendicular to r."""
    squared = along(r, r)
    return less(a, along(a, r) / squared if squared > 0.0 else 0.0, r)


@formula
def gradients(r, q, w):
    """Return (g_2, g_3, lift): gradients [1/m] of the weights of corners two and three of a triangle with the edges q
    and w, and the component of r along its normal [m].

    Where r is longer than the triangle is high, the gradients are shortened: the corners would magnify a force.
    """
    m = cross(q[0], q[1], q[2], w[0], w[1], w[2])
    squared = along(m, m)
    s = 1.0 / squared if squared > 0.0 else 0.0
    b, c = cross(w[0], w[1], w[2], m[0], m[1], m[2]), cross(m[0], m[1], m[2], q[0], q[1], q[2])
    up, high = s * along(m, r), (s * s) * (along(r, r) * max(along(b, b), along(c, c)))
    s = s / sqrt(high) if high > 1.0 else s
    return times(s, b), times(s, c), times(up, m)


@formula
def levers(r, f, second, third, lift):
    """Forces on corners two and three that, in addition to their weights of a force f at r from the triangle's
    point, have its moment; corner one gets minus both.

    `second`, `third`, `lift`: from `gradients`. e_k = (g_k . r) f' - (g_k . f') lift, f' the component of f
    perpendicular to r: the e_k sum to 0, and sum x_k x e_k = r x f.
    """
    x = across(f, r)
    return (
        less(times(along(second, r), x), along(second, x), lift),
        less(times(along(third, r), x), along(third, x), lift),
    )  # fmt: skip


@formula
def carried(r, d, e, second, third, lift):
    """Displacement, relative to the triangle's point, of a point at r from it [m]: the transpose of `levers`. d, e:
    displacements of its second and third corner relative to the first one."""
    x, y = times(along(second, r), d), times(along(third, r), e)
    sum_of = x[0] + y[0], x[1] + y[1], x[2] + y[2]
    return across(less(less(sum_of, along(lift, d), second), along(lift, e), third), r)


@formula
def response(f, x, y, weights, masses):
    """Relative displacement by the force f at the vertex, times f: |f|^2/m_0 + sum |A_k f|^2/m_k. x, y: `levers`."""
    (a, b, c) = weights
    fa = a * f[0] - (x[0] + y[0]), a * f[1] - (x[1] + y[1]), a * f[2] - (x[2] + y[2])
    fb, fc = less(x, -b, f), less(y, -c, f)
    return (masses[0] * along(f, f) + masses[1] * along(fa, fa)) + (
        masses[2] * along(fb, fb) + masses[3] * along(fc, fc)
    )


@formula
def rub(n, r, slid, impulses, weights, masses, edges, before, static_friction, dynamic_friction):
    """Return (j, second, third): displacement of the contact's vertex, and levers on corners two and three, for a
    weight of 1, by friction after the sweeps that push.

    `n`: the contact's normal; `r`: from the triangle's point to the vertex; `slid`: the change of that in the
    substep [m]; `impulses`: (the normal impulse, the friction (3)) of the substep so far; `weights`
    of the corners; `masses`: inverse ones of the vertex and the corners, as split among contacts; `edges`: of the
    triangle, (q, w), and `before`, at the substep's start, (u, v).

    Friction acts at the vertex, on the slip there. A force f at the vertex gives -A_k f to corner k, A_k f = b_k f
    + lever k of f. The slip is the transpose of that, s = d_0 - sum A_k^T d_k of the displacements d, its
    tangential part. The impulse p f changes sum m d^2/2 by p f.s + p^2 Y/2, Y = `response` of f. This is least at
    p = -f.s/Y, and no gain from 0 to there. With f = -s this p stops the slip. Coulomb's law limits the friction of
    the substep, not that of the sweep: where the sum would exceed static_friction times the normal impulse, f leads
    to the nearest sum of dynamic_friction times it, and p is at most 1. So no contact gains energy by friction. Nor
    do all at once: a particle moves by the mean displacement of its pieces, and the energy of a mean is at most the
    mean energy (R. Tonge et al., SIGGRAPH 2012, on splitting).
    """
    (q, w), (u, v), (press, used) = edges, before, impulses
    second, third, lift = gradients(r, q, w)
    d, e = less(q, 1.0, u), less(w, 1.0, v)
    s = less(slid, 1.0, carried(r, d, e, second, third, lift))
    s = less(s, along(n, s), n)
    x, y = levers(r, s, second, third, lift)
    stops = along(s, s) * inverse(response(s, x, y, weights, masses))
    total = less(used, stops, s)
    part = slip(length(total[0], total[1], total[2]), press, static_friction, dynamic_friction)
    if part == 1.0:
        return times(-stops, s), times(-stops, x), times(-stops, y)
    f = less(times(part, total), 1.0, used)
    x, y = levers(r, f, second, third, lift)
    p = min(max(-(along(s, f) * inverse(response(f, x, y, weights, masses))), 0.0), 1.0)
    return times(p, f), times(p, x), times(p, y)
