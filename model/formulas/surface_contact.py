"""The surfaces of bodies that meet: on which side of a closed surface a vertex lies, and which way leads out.

Of the nearest point of a closed surface the way to a vertex tells the side: along the triangle's normal where the point lies
in a face, and within the cone of the normals around where it lies on an edge or a corner (J. A. Baerentzen, H. Aanaes,
"Signed Distance Computation Using the Angle Weighted Pseudonormal", IEEE TVCG 11 (2005)). One triangle alone is asked here:
edges that point outward are not much sharper than a voxel's, so that what lies outside is never far behind it. What else a
contact is: model/formulas/contact.py.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from model.formulas import plain
from model.formulas.contact import make as make_contact
from model.formulas.lengths import make as make_lengths

UPRIGHT = 0.99999  # cosine of n with the normal of the triangle, from which n holds wherever the vertex slides
PAST = 1 / 16  # of a triangle beyond its edges, where what comes through its plane comes through a neighbour, or nearly
OPERATIONS_LEVERS = 130


def make(real, compiled=plain):
    """`outward`, `kept_by`, in the arithmetic `real`. Vectors are three numbers."""
    zero, behind = real(0), real(0.25)
    lengths = make_lengths(real, compiled)
    dot, cross, length = lengths.dot, lengths.cross, lengths.length

    @compiled
    def outward(rx, ry, rz, distance, ux, uy, uz, vx, vy, vz, flat):
        """(whether the vertex lies inside, the unit direction out of the body). r: from the nearest point to the vertex, so
        long; u, v: the triangle's edges, in whose order it is seen from outside; nearer than `flat`, where r is rounding, the
        triangle's normal is the way. No way where the triangle has no area."""
        nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
        size = length(nx, ny, nz)
        if size <= zero:
            return False, zero, zero, zero
        nx, ny, nz = nx / size, ny / size, nz / size
        side = dot(nx, ny, nz, rx, ry, rz)
        if distance <= flat:
            return side < zero, nx, ny, nz
        if side < -(behind * distance):
            return True, -(rx / distance), -(ry / distance), -(rz / distance)
        return False, rx / distance, ry / distance, rz / distance

    @compiled
    def kept_by(ratio, length):
        """A length of a contact, of a vertex that keeps `ratio` of what surfaces do."""
        return ratio * length

    return SimpleNamespace(outward=outward, kept_by=kept_by, **vars(make_current(real, compiled)))


def make_current(real, compiled=plain):
    """`still_deep`, `levers`: of a contact where its four particles are now. Vectors are tuples of three numbers."""
    zero, one, upright, past = real(0), real(1), real(UPRIGHT), real(PAST)
    lengths, search = make_lengths(real, compiled), make_contact(real, compiled)
    dot, cross, length = lengths.dot, lengths.cross, lengths.length
    nearest, away = search.nearest, search.away

    @compiled
    def along(a, b):
        return dot(a[0], a[1], a[2], b[0], b[1], b[2])

    @compiled
    def over(p, u, v):
        """(b, c, h): weights of the second and third corner of what of p, from the first one, lies in the triangle's plane,
        and the way from there [m]; nothing where the triangle has no area."""
        m = cross(u[0], u[1], u[2], v[0], v[1], v[2])
        squared = along(m, m)
        s = one / squared if squared > zero else zero
        b, c = along(cross(v[0], v[1], v[2], m[0], m[1], m[2]), p), along(cross(m[0], m[1], m[2], u[0], u[1], u[2]), p)
        return s * b, s * c, sqrt(s) * along(m, p)

    @compiled
    def through(early, late):
        """Whether a vertex has come through the triangle, or just past its edge, between two places told by `over`."""
        if (early[2] >= zero) == (late[2] >= zero):
            return False
        part = early[2] / (early[2] - late[2])
        b, c = early[0] + part * (late[0] - early[0]), early[1] + part * (late[1] - early[1])
        return b >= -past and c >= -past and b + c <= one + past

    @compiled
    def still_deep(n, r, s, t, u, v, p, q, w, depth, distance):
        """The `depth` [m] of a contact, no more than the vertex lacks of the `distance` from where the triangle is now.

        n is held for the substep and leans, beyond an edge, over what the vertex passes by: its plane then calls deep what is
        apart. r: from the triangle's point, of the weights s and t, to the vertex as the substep began, u, v: its edges then;
        q, w: its edges now, p: from its first corner to the vertex. What has come through the triangle is as deep as n says;
        so is what began inside, and what n holds in the triangle's own plane, which goes on in other triangles.
        """
        m = cross(u[0], u[1], u[2], v[0], v[1], v[2])
        if along(n, r) <= zero or abs(along(n, m)) >= upright * length(m[0], m[1], m[2]):
            return depth
        early = r[0] + (s * u[0] + t * v[0]), r[1] + (s * u[1] + t * v[1]), r[2] + (s * u[2] + t * v[2])
        if through(over(early, u, v), over(p, q, w)):
            return depth
        _, b, c = nearest(q[0], q[1], q[2], w[0], w[1], w[2], p[0], p[1], p[2])
        x, y, z = away(p[0], q[0], w[0], b, c), away(p[1], q[1], w[1], b, c), away(p[2], q[2], w[2], b, c)
        return min(depth, distance - length(x, y, z))

    @compiled
    def levers(r, j, q, w):
        """What corners two and three of a triangle (edges q, w) get beside their weights of the displacement j [m] of a
        vertex that is r from its point (both of a weight of 1), so that nothing has a moment; corner one gets minus both.

        With g_k the gradients of the weights and m the normal, e_k = (g_k . r) j - (m . r) (g_k . j) m: the e_k add up to 0
        and sum x_k x e_k = r x j. Of j only what is across r has a moment. Where r is longer than the triangle is high, the
        moment is left in part: levers would magnify j.
        """
        m = cross(q[0], q[1], q[2], w[0], w[1], w[2])
        squared, reach = along(m, m), along(r, r)
        s = one / squared if squared > zero else zero
        b, c = cross(w[0], w[1], w[2], m[0], m[1], m[2]), cross(m[0], m[1], m[2], q[0], q[1], q[2])
        t = along(j, r) / reach if reach > zero else zero
        x, y, z = j[0] - t * r[0], j[1] - t * r[1], j[2] - t * r[2]
        up, across = s * along(m, r), (x, y, z)
        high = (s * s) * (reach * max(along(b, b), along(c, c)))
        s = s / sqrt(high) if high > one else s
        rb, rc, jb, jc = s * along(b, r), s * along(c, r), up * (s * along(b, across)), up * (s * along(c, across))
        return (
            (rb * x - jb * m[0], rb * y - jb * m[1], rb * z - jb * m[2]),
            (rc * x - jc * m[0], rc * y - jc * m[1], rc * z - jc * m[2]),
        )  # fmt: skip

    return SimpleNamespace(still_deep=still_deep, levers=levers)
