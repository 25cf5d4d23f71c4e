"""Frame of a collider that moves and rotates: a mass's path in it, and the transformation back into the world.

The path leads from the mass's old position, in the collider's old frame, to its new position, in the collider's new
frame, so that a moving collider sweeps masses along.
"""

from __future__ import annotations

from softlab.model.base.variant import Open, formula
from softlab.model.formulas.cloth import moved
from softlab.model.formulas.lengths import cross
from softlab.model.formulas.motion import sine_cosine


@formula
def rotated(x, y, z, ux, uy, uz, sine, cosine):
    """Return (x, y, z) rotated about the unit axis u: O. Rodrigues' a' = a + sin t + (1 - cos) n, t = u x a, n = u x
    t."""
    tx, ty, tz = cross(ux, uy, uz, x, y, z)
    nx, ny, nz = cross(ux, uy, uz, tx, ty, tz)
    lifted = 1.0 - cosine
    return x + (sine * tx + lifted * nx), y + (sine * ty + lifted * ny), z + (sine * tz + lifted * nz)


settle = Open(
    "settle(numbers, place, surface, spin, velocity, a, p, v) -> (True if it was touched, p, v), in its frame"
)


@formula
def touch(numbers, place, surface, path, begin, end, a, p, v):
    """Return (p, v) of a mass that was at a [m] at the time `begin` [s] and is at p, moving at v, at `end`.

    `place`: the index in `numbers` at which the collider's begin; `surface`: its thickness, static and dynamic
    friction, restitution, and the `settling` of its response; `path`: its origin at time 0, its velocity, the
    unit axis about which it rotates, rad/s and 1/s. A collider that does not rotate adds no rounding to
    directions. A mass that does not touch it is unchanged.
    """
    (ox, oy, oz), (qx, qy, qz), (ex, ey, ez), spin, turns = path
    ax, ay, az = a[0] - moved(ox, qx, begin), a[1] - moved(oy, qy, begin), a[2] - moved(oz, qz, begin)
    ox, oy, oz = moved(ox, qx, end), moved(oy, qy, end), moved(oz, qz, end)
    x, y, z = p[0] - ox, p[1] - oy, p[2] - oz
    wx, wy, wz = v
    sine, cosine = 0.0, 1.0
    if spin != 0.0:
        sine, cosine = sine_cosine(turns * begin)
        ax, ay, az = rotated(ax, ay, az, ex, ey, ez, -sine, cosine)
        sine, cosine = sine_cosine(turns * end)
        x, y, z = rotated(x, y, z, ex, ey, ez, -sine, cosine)
        wx, wy, wz = rotated(wx, wy, wz, ex, ey, ez, -sine, cosine)
        qx, qy, qz = rotated(qx, qy, qz, ex, ey, ez, -sine, cosine)
    spins = spin * ex, spin * ey, spin * ez
    touched, (x, y, z), (wx, wy, wz) = settle(
        numbers, place, surface, spins, (qx, qy, qz), (ax, ay, az), (x, y, z), (wx, wy, wz)
    )
    if not touched:
        return (p[0], p[1], p[2]), (v[0], v[1], v[2])
    if spin != 0.0:
        x, y, z = rotated(x, y, z, ex, ey, ez, sine, cosine)
        wx, wy, wz = rotated(wx, wy, wz, ex, ey, ez, sine, cosine)
    return (ox + x, oy + y, oz + z), (wx, wy, wz)
