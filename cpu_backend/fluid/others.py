"""Functions of other packages that a fluid's kernels call: their open names, and the functions for them."""

from __future__ import annotations

from typing import Any

from softlab.cpu_backend.contact.colliders import make_collide_mass, make_collide_row, make_instants, make_push
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import make_particle_force
from softlab.model.base.types import Real
from softlab.model.base.variant import Open

collide = Open("collide(bodies, kinds, step, parameters, blocks, source, here, plane, target, there, target_plane)")
instants = Open("instants(step, parameters): of make_instants")
particle_force = Open("particle_force(a, k, weight, parameters, integers, step): of make_particle_force")
point = Open("point(body, time): of make_push")
touch = Open("touch(bodies, kinds, step, parameters, a, p, v): of make_collide_mass")


def functions_of_others(compiler: Compiler, real: Real, parts: frozenset[str]) -> dict[str, Any]:
    """Return the functions for the open names above."""
    return {
        "collide": make_collide_row(compiler, real, parts),
        "instants": make_instants(compiler, real, parts),
        "particle_force": make_particle_force(compiler, real, 2 if "flat" in parts else 3, parts - {"load"}),
        "point": make_push(compiler, real, parts).point,
        "touch": make_collide_mass(compiler, real, parts),
    }
