"""Colliders in the energy that a step minimises, on CPU threads: a spring pushes a particle inside a collider out.

The remaining penetration is removed after the step, as in all solvers; without the spring this would strain a stiff
body.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.contact.colliders import make_collide_mass
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.elastic import newton
from softlab.model.tables.cloth import COLLIDER_KINDS


def make_contact(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `within`, `nearly_within` and `pressed`. `has_bodies`: true if there are colliders.

    `within(k, number, position, before, holds, colliders)`: penetration of particle k (a vector) and contact stiffness [N/m];
    `nearly_within`: if there is none, that of its position a little later. `pressed(first, last, ...)`: at a substep's
    end, velocities including the push of colliders, so that friction knows the normal impulse. `holds` (particles, 1):
    stiffness that holds each [N/m]; `colliders`: (parameters, bodies, kinds).
    """
    compiled, formulas = compiler.compiled, compiler.formulas(newton, real)
    inertia_of, moved = formulas.inertia_of, formulas.moved
    has_bodies, zero = bool(parts & set(COLLIDER_KINDS)), real(0)
    contact, soon = real(newton.CONTACT), real(newton.SOON)
    touch = make_collide_mass(compiler, real, parts - {FRICTION_IN_PLACE})  # friction acts after the solve

    @compiled
    def depth(k, number, x, y, z, before, holds, colliders):
        parameters, bodies, kinds = colliders
        start = before[k, 0], before[k, 1], before[k, 2]
        (p, q, r), _ = touch(bodies, kinds, number, parameters, start, (x, y, z), (zero, zero, zero))
        return x - p, y - q, z - r, contact * (holds[k, 0] + inertia_of(parameters.newton_inertia, before[k, 3]))

    @compiled
    def within(k, number, position, before, holds, colliders):
        return depth(k, number, position[k, 0], position[k, 1], position[k, 2], before, holds, colliders)

    @compiled
    def nearly_within(k, number, position, target, before, holds, colliders):
        x, y, z = position[k, 0], position[k, 1], position[k, 2]
        p, q, r, hard = depth(k, number, x, y, z, before, holds, colliders)
        if (p == zero) & (q == zero) & (r == zero):
            x, y, z = (
                moved(x, soon, target[k, 0] - x),
                moved(y, soon, target[k, 1] - y),
                moved(z, soon, target[k, 2] - z),
            )
            return depth(k, number, x, y, z, before, holds, colliders)
        return p, q, r, hard

    @compiled
    def pressed(first, last, number, position, velocity, before, holds, colliders):
        parameters, _, _ = colliders
        for k in range(first, last):
            if before[k, 3] > zero:
                x, y, z, hard = within(k, number, position, before, holds, colliders)
                rate = hard / (inertia_of(parameters.newton_inertia, before[k, 3])) * parameters.newton_rate
                velocity[k, 0] = velocity[k, 0] + rate * x
                velocity[k, 1] = velocity[k, 1] + rate * y
                velocity[k, 2] = velocity[k, 2] + rate * z

    return SimpleNamespace(has_bodies=has_bodies, within=within, nearly_within=nearly_within, pressed=pressed)
