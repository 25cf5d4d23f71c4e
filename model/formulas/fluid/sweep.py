"""Entry of a particle's path within a substep into a capsule or a box, so that it does not pass thin or fast colliders.

All in the collider's own frame, so that a moving collider sweeps particles along. A box by its faces' slabs (T. Kay and
J. Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986); a capsule as a cylinder and two balls (`sphere_entry` of
model/formulas/colliders.py).
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.colliders import sphere_entry

CONTACT = (
    1e-3  # of half an edge: a particle this little inside counts as on the face, whatever rounding did to its position
)
OPERATIONS = 60


@formula
def capsule_entry(ax, ay, az, bx, by, bz, ex, ey, ez, radius):
    """Fraction of the segment from a to b after which it is within `radius` of the capsule's axis; 1 where
    `sphere_entry` gives 1.

    a, b: from the axis' start; e: from its start to its end.
    """
    squared = (ex * ex + ey * ey) + ez * ez
    if squared > 0.0:
        begin = ((ax * ex + ay * ey) + az * ez) / squared
        end = ((bx * ex + by * ey) + bz * ez) / squared
        part = sphere_entry(
            ax - begin * ex, ay - begin * ey, az - begin * ez, bx - end * ex, by - end * ey, bz - end * ez, radius
        )
        along = begin + part * (end - begin)
        if part < 1.0 and along >= 0.0 and along <= 1.0:
            return part
    first = sphere_entry(ax, ay, az, bx, by, bz, radius)
    return min(first, sphere_entry(ax - ex, ay - ey, az - ez, bx - ex, by - ey, bz - ez, radius))


@formula
def side_of(a):
    return 1.0 if a >= 0.0 else -1.0


@formula
def crossing(a, b, half):
    """Fraction of the segment from a to b, along one axis, at which it crosses the face on a's side; -1 where it
    does not."""
    side = side_of(a)
    out, inward = side * a - half, side * (a - b)
    if out < -CONTACT * half or inward <= 0.0:
        return -1.0
    return max(out, 0.0) / inward


@formula
def within(a, b, part, half):
    return abs(a + part * (b - a)) <= half


@formula
def box_face(ax, ay, az, bx, by, bz, hx, hy, hz):
    """Return (depth, nx, ny, nz) of a path from a to b that enters by the face of normal n and ends at that depth [m]
    behind it.

    a, b: from the centre; `h`: half the edges. n is 0 where the path does not enter, or ends inside and nearest to
    that face, by which the box's distance pushes it out anyway.
    """
    tx, ty, tz = crossing(ax, bx, hx), crossing(ay, by, hy), crossing(az, bz, hz)
    part = max(max(tx, ty), tz)
    if part < 0.0 or part > 1.0:
        return 0.0, 0.0, 0.0, 0.0
    qx, qy, qz = abs(bx) - hx, abs(by) - hy, abs(bz) - hz
    inside = qx <= 0.0 and qy <= 0.0 and qz <= 0.0
    if tx >= ty and tx >= tz:
        side = side_of(ax)
        led = inside and qx >= qy and qx >= qz and side_of(bx) == side
        if not led and within(ay, by, part, hy) and within(az, bz, part, hz):
            return hx - side * bx, side, 0.0, 0.0
    elif ty >= tz:
        side = side_of(ay)
        led = inside and qy > qx and qy >= qz and side_of(by) == side
        if not led and within(ax, bx, part, hx) and within(az, bz, part, hz):
            return hy - side * by, 0.0, side, 0.0
    else:
        side = side_of(az)
        led = inside and qz > qx and qz > qy and side_of(bz) == side
        if not led and within(ax, bx, part, hx) and within(ay, by, part, hy):
            return hz - side * bz, 0.0, 0.0, side
    return 0.0, 0.0, 0.0, 0.0
