"""Velocity of a particle at the walls: after an impact, and without the rebound that a wall's push would give it.

An impact is inelastic unless the collider has a restitution: the place a particle is predicted at is first led out of the
colliders, which take the velocity into them, and corrections of density start there. What a wall adds to the density pushes
particles out by their own multiplier; a correction that a substep leaves undone comes back as a velocity in a later one. So
of what a particle has gained along the wall's normal, no more than the wall itself has pushed is taken back, until the
particle keeps its distance to the wall (J. Moreau's impact law with restitution 0, "Unilateral contact and dry friction in
finite freedom dynamics", CISM 302, 1988).
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.cloth import make as make_cloth


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero = real(0)
    cross = make_cloth(real, compiled).cross

    @compiled
    def after_impact(velocity, position, predicted, inverse_dt):
        """One axis of a velocity [m/s]: `velocity` that the colliders left at `predicted`, and the corrections since."""
        return velocity + (position - predicted) * inverse_dt

    @compiled
    def wall_push(multiplier, weight, slope, rate, inverse_dt):
        """Change of velocity by a wall [m/s], 0 or more, as `wall_added` moves by `slope` times the `rate` at which that
        wall counts among others; multiplier and slope are 0 or less."""
        return (weight * (multiplier * (slope * rate))) * inverse_dt

    @compiled
    def rebound(vx, vy, vz, ux, uy, uz, wx, wy, wz, nx, ny, nz, push):
        """Speed [m/s] along the wall's normal n to take back from v: what is faster outward than the velocity u before the
        corrections and than the wall's velocity w, `push` at most."""
        gained = (vx * nx + vy * ny) + vz * nz
        before, wall = (ux * nx + uy * ny) + uz * nz, (wx * nx + wy * ny) + wz * nz
        return min(max(gained - max(before, wall), zero), push)

    @compiled
    def without(velocity, speed, n):
        """One axis of a velocity without `speed` along n."""
        return velocity - speed * n

    @compiled
    def surface_velocity(qx, qy, qz, spin, ex, ey, ez, x, y, z, ox, oy, oz):
        """Velocity [m/s] of a collider's point (x, y, z) [m]; its origin o moves at q, it turns about e at `spin` [rad/s]."""
        tx, ty, tz = cross(spin * ex, spin * ey, spin * ez, x - ox, y - oy, z - oz)
        return qx + tx, qy + ty, qz + tz

    return SimpleNamespace(
        after_impact=after_impact, wall_push=wall_push, rebound=rebound, without=without,
        surface_velocity=surface_velocity,
    )  # fmt: skip
