"""The surfaces of bodies that meet: on which side of a closed surface a vertex lies, and which way leads out.

Of the nearest point of a closed surface the way to a vertex tells the side: along the triangle's normal where the point lies
in a face, and within the cone of the normals around where it lies on an edge or a corner (J. A. Baerentzen, H. Aanaes,
"Signed Distance Computation Using the Angle Weighted Pseudonormal", IEEE TVCG 11 (2005)). One triangle alone is asked here:
edges that point outward are not much sharper than a voxel's, so that what lies outside is never far behind it. What else a
contact is: model/formulas/contact.py.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.lengths import make as make_lengths


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

    return SimpleNamespace(outward=outward, kept_by=kept_by)
