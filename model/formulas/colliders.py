"""Colliders as signed distances, and the response of a mass that touches one.

Each distance function takes a point and the collider's own lengths and returns (distance, nx, ny, nz): the distance to
the surface, negative inside, and the outward unit normal. Distances: J. C. Hart, "Sphere tracing", The Visual Computer
12 (1996), appendix. Response: R. Bridson, R. Fedkiw and J. Anderson, "Robust treatment of collisions, contact and
friction for cloth animation", SIGGRAPH 2002, section 7.2 (inelastic, Coulomb friction by the change of normal
velocity). Bouncing: M. Mueller et al., "Detailed Rigid Body Simulation with Extended Position Based Dynamics", SCA
2020, section 3.6.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula

# Per mass and collider, contact included. Mesh: a mass that rests on the 8192 triangles of soft-on-mesh and is tested
# twice: its path meets the boxes of 24 nodes (6 comparisons each) and half a triangle (110), its thickness those of 32
# (14) and 3 triangles (150). Field: a mass that is tested twice, and the start of its path: 3 samples (75).
OPERATIONS = {"plane": 40, "sphere": 60, "capsule": 65, "box": 60, "mesh_collider": 2200, "distance_field": 350}
OPERATIONS_SLID = 20  # friction on positions
TOUCHING = 1e-3  # of the squared `radius`: a mass this near to a ball is in contact


@formula
def root(squared):
    return sqrt(squared)


@formula
def respond(v, c, n, static_friction, dynamic_friction):
    """Velocity of a touching mass (v): without its component into the collider (which moves at c), the rest slowed
    by friction.

    The normal velocity that is removed, times the coefficient, is the most that friction removes from the
    tangential one; it removes all of it if the static coefficient allows.
    """
    cx, cy, cz = c
    nx, ny, nz = n
    rx, ry, rz = v[0] - cx, v[1] - cy, v[2] - cz
    normal = (rx * nx + ry * ny) + rz * nz
    if normal < 0.0:
        rx, ry, rz = rx - normal * nx, ry - normal * ny, rz - normal * nz
        tangential = root((rx * rx + ry * ry) + rz * rz)
        if tangential <= -normal * static_friction:
            rx, ry, rz = 0.0, 0.0, 0.0
        elif dynamic_friction > 0.0:
            remaining = 1.0 - dynamic_friction * -normal / tangential
            rx, ry, rz = remaining * rx, remaining * ry, remaining * rz
    return cx + rx, cy + ry, cz + rz


@formula
def settling_speed(gravity, dt):
    """Twice the speed that `gravity` [m/s^2] adds within a step of `dt` [s]: slower impacts do not bounce, which
    avoids jitter."""
    return 2.0 * abs(gravity) * dt


@formula
def rebound(v, c, n, static_friction, dynamic_friction, restitution, settling):
    """Velocity as by `respond`, with the fraction `restitution` of a normal velocity above `settling` [m/s]
    returned.

    Friction is limited by the whole change of the normal velocity.
    """
    cx, cy, cz = c
    nx, ny, nz = n
    rx, ry, rz = v[0] - cx, v[1] - cy, v[2] - cz
    normal = (rx * nx + ry * ny) + rz * nz
    if normal < 0.0:
        back = restitution * -normal if -normal > settling else 0.0
        taken = back - normal
        rx, ry, rz = rx - normal * nx, ry - normal * ny, rz - normal * nz
        tangential = root((rx * rx + ry * ry) + rz * rz)
        if tangential <= taken * static_friction:
            rx, ry, rz = 0.0, 0.0, 0.0
        elif dynamic_friction > 0.0:
            remaining = 1.0 - dynamic_friction * taken / tangential
            rx, ry, rz = remaining * rx, remaining * ry, remaining * rz
        rx, ry, rz = rx + back * nx, ry + back * ny, rz + back * nz
    return cx + rx, cy + ry, cz + rz


@formula
def slid(h, u, v, n):
    """Displacement [m] that friction causes in a substep of h [s] as it changes a mass's velocity from v to u.

    A particle that sticks stays where it was; one that slides moved at its new speed (Mueller et al. 2020, eq. 30).
    """
    nx, ny, nz = n
    x, y, z = u[0] - v[0], u[1] - v[1], u[2] - v[2]
    along = (x * nx + y * ny) + z * nz
    return h * (x - along * nx), h * (y - along * ny), h * (z - along * nz)


@formula
def sphere(dx, dy, dz, radius):
    """Distance to and normal of a ball of `radius` around the origin. At its centre the normal is +y."""
    length = sqrt((dx * dx + dy * dy) + dz * dz)
    if length > 0.0:
        return length - radius, dx / length, dy / length, dz / length
    return -radius, 0.0, 1.0, 0.0


@formula
def plane(dx, dy, dz, nx, ny, nz):
    """Distance to and normal of a plane. `d`: from a point of the plane to the mass; `n`: its unit normal."""
    return (dx * nx + dy * ny) + dz * nz, nx, ny, nz


@formula
def capsule(dx, dy, dz, ex, ey, ez, radius):
    """Distance to and normal of a capsule. `d`: from the segment's start to the mass; `e`: from its start to its
    end."""
    squared = (ex * ex + ey * ey) + ez * ez
    part = 0.0
    if squared > 0.0:
        part = min(max(((dx * ex + dy * ey) + dz * ez) / squared, 0.0), 1.0)
    return sphere(dx - part * ex, dy - part * ey, dz - part * ez, radius)


@formula
def box(dx, dy, dz, hx, hy, hz):
    """Distance to and normal of a box. `d`: from the centre; `h`: half the edges. Inside, the nearest face
    decides."""
    qx, qy, qz = abs(dx) - hx, abs(dy) - hy, abs(dz) - hz
    sx, sy, sz = 1.0 if dx >= 0.0 else -1.0, 1.0 if dy >= 0.0 else -1.0, 1.0 if dz >= 0.0 else -1.0
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, sx, 0.0, 0.0
        if qy >= qz:
            return qy, 0.0, sy, 0.0
        return qz, 0.0, 0.0, sz
    ox, oy, oz = sx * max(qx, 0.0), sy * max(qy, 0.0), sz * max(qz, 0.0)
    return sphere(ox, oy, oz, 0.0)


@formula
def sphere_entry(ax, ay, az, bx, by, bz, radius):
    """Fraction of the segment from a to b (relative to the ball's centre) after which a mass comes within `radius`
    of the centre.

    It is 1 where the mass does not come that near or began inside. It is also 1 where the mass ends inside, in the
    half of the ball that it came from (where pushing it out is right), and where it ends in that half after it
    began in contact. A mass in contact may be outside or inside by rounding: both count as outside, and one that
    would pass through stops where it is. |a + t (b - a)|^2 = radius^2, the smaller root: this keeps a fast ball from
    passing between two steps.
    """
    dx, dy, dz = bx - ax, by - ay, bz - az
    squared = (dx * dx + dy * dy) + dz * dz
    toward = (ax * dx + ay * dy) + az * dz
    outside = (ax * ax + ay * ay) + az * az - radius * radius
    beyond = (ax * bx + ay * by) + az * bz
    inside_end = (bx * bx + by * by) + bz * bz < radius * radius
    contact = TOUCHING * radius * radius
    discriminant = toward * toward - squared * outside
    if (
        outside < -contact
        or toward >= 0.0
        or discriminant <= 0.0
        or (beyond > 0.0 and (inside_end or outside < contact))
    ):
        return 1.0
    return min(max((-toward - sqrt(discriminant)) / squared, 0.0), 1.0)
