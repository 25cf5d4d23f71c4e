"""Device functions of other packages that a fluid's kernels call: their open names, and the functions for them."""

from __future__ import annotations

from functools import cache
from typing import Any

from softlab.gpu_backend.contact.colliders import make_collide, make_place_of
from softlab.gpu_backend.core.forces import make_particle_force
from softlab.gpu_backend.core.integers import make_clock
from softlab.model.base.types import Real
from softlab.model.base.variant import Open

clock = Open("clock(counter, place, substeps, substep): of make_clock")
collide = Open("collide(before, px, py, pz, vx, vy, vz, world, step): of make_collide")
particle_force = Open("particle_force(a, k, weight, parameters, integers, step): of make_particle_force")
place_of = Open("place_of(bodies, at, time): of make_place_of")


@cache
def functions_of_others(real: Real, math: str, parts: frozenset[str]) -> dict[str, Any]:
    """Return the functions for the open names above."""
    return {
        "clock": make_clock(math, parts),
        "collide": make_collide(real, math, parts),
        "particle_force": make_particle_force(real, math, 2 if "flat" in parts else 3, parts),
        "place_of": make_place_of(real, math),
    }
