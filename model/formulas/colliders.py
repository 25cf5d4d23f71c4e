"""Colliders as signed distances, and what a mass does that comes too near one.

Each distance function takes a point and the collider's own lengths and returns (distance, nx, ny, nz): the way to the
surface, negative inside, and the unit normal that leads out. Distances: J. C. Hart, "Sphere tracing", The Visual Computer
12 (1996), appendix. Response: R. Bridson, R. Fedkiw and J. Anderson, "Robust treatment of collisions, contact and
friction for cloth animation", SIGGRAPH 2002, section 7.2 (inelastic, Coulomb friction by the change of normal velocity);
bouncing: M. Mueller et al., "Detailed Rigid Body Simulation with Extended Position Based Dynamics", SCA 2020, section 3.6.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from model.formulas import joined, plain

# Per mass and collider, contact included. Of a mesh, of a mass that rests on the 8192 triangles of soft-on-mesh and is looked
# at twice: its way meets the boxes of 24 nodes (6 comparisons each) and half a triangle (110), its thickness those of 32 (14)
# and 3 triangles (150). Of a field, of one that is looked at twice, and where its way began: 3 samples (75).
OPERATIONS = {"plane": 40, "sphere": 60, "capsule": 65, "box": 60, "mesh_collider": 2200, "distance_field": 350}
OPERATIONS_SLID = 20  # friction on positions


def make(real, compiled=plain):
    """What `make_distances` makes, `respond`, and of colliders that give back `rebound`, `settling_speed`; `slid`, where
    friction acts on positions, too; in the arithmetic `real`."""
    zero, one, two = real(0), real(1), real(2)

    @compiled
    def root(squared):
        return sqrt(squared)

    @compiled
    def respond(vx, vy, vz, cx, cy, cz, nx, ny, nz, static_friction, dynamic_friction):
        """The velocity of a touching mass: nothing into the collider (which moves at c), the rest slowed by friction.

        The normal velocity that is taken away, times the coefficient, is what friction may take from the tangential one:
        all of it, if the static coefficient allows.
        """
        rx, ry, rz = vx - cx, vy - cy, vz - cz
        normal = (rx * nx + ry * ny) + rz * nz
        if normal < zero:
            rx, ry, rz = rx - normal * nx, ry - normal * ny, rz - normal * nz
            tangential = root((rx * rx + ry * ry) + rz * rz)
            if tangential <= -normal * static_friction:
                rx, ry, rz = zero, zero, zero
            elif dynamic_friction > zero:
                keep = one - dynamic_friction * -normal / tangential
                rx, ry, rz = keep * rx, keep * ry, keep * rz
        return cx + rx, cy + ry, cz + rz

    @compiled
    def settling_speed(gravity, dt):
        """Twice what `gravity` [m/s^2] adds within a step of `dt` [s]: who comes no faster rests, and must not jitter."""
        return two * abs(gravity) * dt

    @compiled
    def rebound(vx, vy, vz, cx, cy, cz, nx, ny, nz, static_friction, dynamic_friction, restitution, settling):
        """As `respond`, and of the normal velocity the share `restitution` comes back, where it is more than `settling`
        [m/s]. Friction is limited by the whole change of the normal velocity."""
        rx, ry, rz = vx - cx, vy - cy, vz - cz
        normal = (rx * nx + ry * ny) + rz * nz
        if normal < zero:
            back = restitution * -normal if -normal > settling else zero
            taken = back - normal
            rx, ry, rz = rx - normal * nx, ry - normal * ny, rz - normal * nz
            tangential = root((rx * rx + ry * ry) + rz * rz)
            if tangential <= taken * static_friction:
                rx, ry, rz = zero, zero, zero
            elif dynamic_friction > zero:
                keep = one - dynamic_friction * taken / tangential
                rx, ry, rz = keep * rx, keep * ry, keep * rz
            rx, ry, rz = rx + back * nx, ry + back * ny, rz + back * nz
        return cx + rx, cy + ry, cz + rz

    @compiled
    def slid(h, ux, uy, uz, vx, vy, vz, nx, ny, nz):
        """The displacement [m] by which friction holds a mass back in a substep of h [s] as it changes its velocity from v to
        u: a particle that sticks is where it was, one that slides went at its new speed (Mueller et al. 2020, eq. 30)."""
        x, y, z = ux - vx, uy - vy, uz - vz
        along = (x * nx + y * ny) + z * nz
        return h * (x - along * nx), h * (y - along * ny), h * (z - along * nz)

    answers = SimpleNamespace(respond=respond, rebound=rebound, settling_speed=settling_speed, slid=slid)
    return joined(make_distances(real, compiled, root), answers)


def make_distances(real, compiled, root):
    """Distances `plane`, `sphere`, `capsule`, `box`, and `sphere_entry` (swept), in the arithmetic `real`."""
    zero, one = real(0), real(1)
    touching = real(1e-3)  # of the squared reach: so near to a ball a mass is in contact

    @compiled
    def from_center(dx, dy, dz, radius):
        """Distance and normal of a ball of `radius` around the origin; upward at its very centre."""
        length = root((dx * dx + dy * dy) + dz * dz)
        if length > zero:
            return length - radius, dx / length, dy / length, dz / length
        return -radius, zero, one, zero

    @compiled
    def plane(dx, dy, dz, nx, ny, nz):
        """`d`: from a point of the plane to the mass; `n`: its unit normal."""
        return (dx * nx + dy * ny) + dz * nz, nx, ny, nz

    @compiled
    def capsule(dx, dy, dz, ex, ey, ez, radius):
        """`d`: from the segment's start to the mass; `e`: from its start to its end."""
        squared = (ex * ex + ey * ey) + ez * ez
        part = zero
        if squared > zero:
            part = min(max(((dx * ex + dy * ey) + dz * ez) / squared, zero), one)
        return from_center(dx - part * ex, dy - part * ey, dz - part * ez, radius)

    @compiled
    def box(dx, dy, dz, hx, hy, hz):
        """`d`: from the centre; `h`: half the edges. Inside, out by the nearest face."""
        qx, qy, qz = abs(dx) - hx, abs(dy) - hy, abs(dz) - hz
        sx, sy, sz = one if dx >= zero else -one, one if dy >= zero else -one, one if dz >= zero else -one
        if qx <= zero and qy <= zero and qz <= zero:
            if qx >= qy and qx >= qz:
                return qx, sx, zero, zero
            if qy >= qz:
                return qy, zero, sy, zero
            return qz, zero, zero, sz
        ox, oy, oz = sx * max(qx, zero), sy * max(qy, zero), sz * max(qz, zero)
        return from_center(ox, oy, oz, zero)

    @compiled
    def sphere_entry(ax, ay, az, bx, by, bz, reach):
        """The part of the way from a to b (relative to the ball's centre) after which a mass is within `reach` of it;
        1 where it is not, began inside, or ends in the half it came from inside the ball (where pushing it out is right) or
        having begun in contact. Whether a mass in contact is a rounding outside or inside must not matter: both count as
        outside, and one that would pass through is held where it is.

        |a + t (b - a)|^2 = reach^2, the smaller root: what keeps a fast ball from passing between two steps.
        """
        dx, dy, dz = bx - ax, by - ay, bz - az
        squared = (dx * dx + dy * dy) + dz * dz
        toward = (ax * dx + ay * dy) + az * dz
        outside = (ax * ax + ay * ay) + az * az - reach * reach
        beyond = (ax * bx + ay * by) + az * bz
        inside_end = (bx * bx + by * by) + bz * bz < reach * reach
        contact = touching * reach * reach
        discriminant = toward * toward - squared * outside
        if (
            outside < -contact
            or toward >= zero
            or discriminant <= zero
            or (beyond > zero and (inside_end or outside < contact))
        ):
            return one
        return min(max((-toward - root(discriminant)) / squared, zero), one)

    return SimpleNamespace(plane=plane, sphere=from_center, capsule=capsule, box=box, sphere_entry=sphere_entry)
