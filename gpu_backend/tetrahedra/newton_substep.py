"""Start and end of a solve of Newton's method, on CUDA, for one particle: the inertial or driven position, the velocity.

As cpu_backend/tetrahedra/newton_steps.py.
"""

from __future__ import annotations

from softlab.gpu_backend.contact.motion import collide, predict, rate_of
from softlab.gpu_backend.contact.pins import follow
from softlab.gpu_backend.core.forces import add_gravity, add_particle_force
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_contact import pressed
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.contact.cloth_parameters import P_MOTION
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.distance import slowed
from softlab.model.formulas.elastic.stages import ahead


@inlined_routine
def driven(k, b, pins, world, number):
    """Return (x, y, z, vx, vy, vz) of the pinned particle k at the end of substep `number`: at rest at `b` (a quad), where
    it was, unless it follows a motion."""
    x, y, z, vx, vy, vz = b[0], b[1], b[2], 0.0, 0.0, 0.0
    pin = pins[k]
    if pin > 0:
        if world.colliders[pin + P_MOTION] >= 0.0:
            parameters = world.parameters
            time = instant(number + 1, parameters.dt, parameters.first_step, parameters.first_time)
            x, y, z, vx, vy, vz = follow(world.colliders, pin, time)
    return x, y, z, vx, vy, vz


@inlined_routine
def begin_stage(k, p, w, v, h, number):
    """Start a stage of a substep. The first one stores its velocities; the second one starts from an extrapolation of the
    first one's end. For dampers both store their positions."""
    if FEATURE.damped:
        store_quad(v.first_start if number % 2 == 0 else v.first_end, k, p[0], p[1], p[2], 0.0)
    if number % 2 == 0:
        store_quad(v.first_velocity, k, w[0], w[1], w[2], 0.0)
    elif p[3] != 0.0:
        s = load_quad(v.first_velocity, k)
        (x, vx), (y, vy), (z, vz) = ahead(p[0], w[0], s[0], h), ahead(p[1], w[1], s[1], h), ahead(p[2], w[2], s[2], h)
        p, w = (x, y, z, p[3]), (vx, vy, vz, w[3])
        store_quad(v.position, k, x, y, z, p[3])
    return p, w


@inlined_routine
def begin(k, solver, world, time):
    """Write the inertial or driven position of particle k."""
    v = solver.vectors
    p, w = load_quad(v.position, k), load_quad(v.velocity, k)
    if FEATURE.two_stages:
        p, w = begin_stage(k, p, w, v, world.parameters.dt, time.number)
    ax, ay, az = add_gravity(0.0, 0.0, 0.0, world.parameters)
    ax, ay, az = add_particle_force(ax, ay, az, k, p[3], world.parameters, world.integers, time.step)
    if FEATURE.body_damping:
        h = world.parameters.dt
        w = slowed(w[0], w[3], h), slowed(w[1], w[3], h), slowed(w[2], w[3], h), w[3]
    x, y, z = predict(p, w, ax, ay, az, world.parameters)
    store_quad(v.before, k, p[0], p[1], p[2], p[3])
    if FEATURE.motion:
        if p[3] == 0.0:
            x, y, z, _, _, _ = driven(k, p, solver.pins, world, time.number)
            store_quad(v.position, k, x, y, z, p[3])
    store_quad(v.target, k, x, y, z, p[3])


@inlined_routine
def finish(k, solver, world, number):
    """Write the velocity of particle k after colliders and motions."""
    v = solver.vectors
    b, p, rate = load_quad(v.before, k), load_quad(v.position, k), 0.0
    x, y, z = p[0], p[1], p[2]
    vx, vy, vz = 0.0, 0.0, 0.0
    if FEATURE.motion:
        if b[3] == 0.0:
            x, y, z, vx, vy, vz = driven(k, p, solver.pins, world, number)
    if b[3] != 0.0:
        vx, vy, vz = rate_of(p, b, world.parameters)
        if FEATURE.colliders:
            vx, vy, vz = pressed(b, p, (vx, vy, vz), solver.matrix.stiffness[k], world, number)
            x, y, z, vx, vy, vz = collide(b, p, vx, vy, vz, world, number)
    store_quad(v.position, k, x, y, z, b[3])
    if FEATURE.body_damping:
        rate = load_quad(v.velocity, k)[3]
    store_quad(v.velocity, k, vx, vy, vz, rate)
