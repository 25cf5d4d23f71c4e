"""A contact of two particles, and a particle at the substep's end, compiled by both backends.

`record`: numbers of model/contact/particle_parameters.py.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.contact.particle_parameters import (
    H_ASLEEP,
    H_DYNAMIC,
    H_FASTEST,
    H_PUSH,
    H_RESTITUTION,
    H_SETTLING,
    H_STATIC,
)
from softlab.model.formulas.particle_contact import (
    added,
    added_friction,
    direction,
    enforced_distance,
    far,
    grip,
    lacking,
    parting,
    rested,
    shortened,
    slip,
)
from softlab.model.formulas.particle_contact import depth as depth_of
from softlab.model.formulas.shape_matching.couple import levered


@inlined_routine
def contact_added(sums, d, b, is_first, distance, pull, fraction, record):
    """Return (displacement, couple, depth): the sums (displacement, couple) of a particle plus those of a contact.

    d, b: from the other particle to this one, now and before the substep; `is_first`: its number is the smaller one.
    """
    (x, y, z), couple = sums
    enforced = enforced_distance(distance, b[0], b[1], b[2], record[H_PUSH])
    length, nx, ny, nz = direction(d[0], d[1], d[2], distance, is_first)
    depth = depth_of(length, enforced, distance, pull)
    if FEATURE.contact_friction:
        if depth > 0.0 or pull > 0.0:
            sx, sy, sz = slip(d[0], d[1], d[2], b[0], b[1], b[2], nx, ny, nz)
            gripped = grip(sx, sy, sz, depth, pull, record[H_STATIC], record[H_DYNAMIC])
            x = added_friction(x, fraction, depth, nx, gripped, sx)
            y = added_friction(y, fraction, depth, ny, gripped, sy)
            z = added_friction(z, fraction, depth, nz, gripped, sz)
            if FEATURE.couples:
                u, v, w = couple
                u = levered(u, fraction, length, gripped, ny, sz, nz, sy)
                v = levered(v, fraction, length, gripped, nz, sx, nx, sz)
                couple = u, v, levered(w, fraction, length, gripped, nx, sy, ny, sx)
            return (x, y, z), couple, depth
    return (added(x, fraction, depth, nx), added(y, fraction, depth, ny), added(z, fraction, depth, nz)), couple, depth


@inlined_routine
def lack_along(n, before, now, are_rigid, record, pressed):
    """Return how much faster two touching particles must separate along n, by their relative velocities `before` the
    substep and `now`. Two particles of rigid bodies separate as those do, even without restitution."""
    e, settling = record[H_RESTITUTION], record[H_SETTLING]
    if FEATURE.rigid_bounce:
        if are_rigid:
            return parting(before, now, n, e, settling, pressed)
        return lacking(before, now, n, e, settling) if e > 0.0 else 0.0
    return lacking(before, now, n, e, settling)


@inlined_routine
def calmed(b, p, record):
    """Return the position of a particle at p after the speed limit and sleeping; b: at the start of the substep."""
    x, y, z = p[0], p[1], p[2]
    if FEATURE.speed_limit or FEATURE.sleeping:
        length = far(x - b[0], y - b[1], z - b[2])
        if FEATURE.speed_limit:
            fastest = record[H_FASTEST]
            x, y = shortened(x, b[0], length, fastest), shortened(y, b[1], length, fastest)
            z = shortened(z, b[2], length, fastest)
        if FEATURE.sleeping:
            asleep = record[H_ASLEEP]
            x, y, z = rested(x, b[0], length, asleep), rested(y, b[1], length, asleep), rested(z, b[2], length, asleep)
    return x, y, z
