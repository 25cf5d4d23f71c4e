"""Checks of a scene's fluids against each other, their domain and solids."""

from __future__ import annotations

from collections.abc import Mapping
from sys import float_info

from softlab.model.base.errors import SceneError
from softlab.model.base.memory import MAX_PARTICLES, available_bytes, require
from softlab.model.geometry.arithmetic.functions import whole_power
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.fluid import REPEATED, WIDER, Domain, Fluid

PARTICLE_BYTES = 700  # on the host: state, sorted copies, a list of 64 neighbours
OF_ALL = ("dimensions", "rest_distance", "support_radius")  # fields in which fluids of a scene must agree
MAX_FLUIDS = 64
LIGHTEST = float_info.min  # kg: of a particle, so that its inverse is a number


def particle_count(parts: Mapping[str, Fluid]) -> int:
    """Return the number of particles of fluids, before any is made."""
    return sum(part.most for part in parts.values())


def check_fluids(parts: Mapping[str, Fluid], domain: Domain | None, domain_name: str) -> None:
    """Raise SceneError for fluids that disagree in common fields, are too many, or do not fit into memory or into their
    box."""
    (first, one), *others = parts.items()
    for name, other in others:
        for field in OF_ALL:
            if getattr(other, field) != getattr(one, field):
                reason = f"must be that of {first}, {getattr(one, field):g}: fluids of a scene meet"
                raise SceneError(f"{name}.{field.removesuffix('_radius')}", getattr(other, field), reason)
    for name, part in parts.items():
        mass = part.density * whole_power(part.rest_distance, part.dimensions)
        if not LIGHTEST <= mass <= 1 / LIGHTEST:
            reason = f"gives particles of {mass:.3g} kg; a particle has {LIGHTEST:.3g} to {1 / LIGHTEST:.3g} kg"
            raise SceneError(f"{name}.density", part.density, reason)
    if len(parts) > MAX_FLUIDS:
        raise SceneError(first, len(parts), f"at most {MAX_FLUIDS} fluids")
    count = particle_count(parts)
    field, amount = f"{first}.rest_distance", f"{one.rest_distance:g} m, {count} particles"
    if count > MAX_PARTICLES:
        raise SceneError(field, amount, f"at most {MAX_PARTICLES} particles (32-bit indices)")
    require(count * PARTICLE_BYTES, available_bytes(), field, amount, "main memory")
    for name, part in parts.items():
        if part.vortices and (domain is None or not {"x", "y"} <= set(domain.repeats)):
            raise SceneError(f"{name}.vortices", part.vortices, "needs a domain that repeats along x and y")
    if domain is None:
        return
    if len(domain.size) < one.dimensions:
        raise SceneError(f"{domain_name}.size", list(domain.size), f"must have {one.dimensions} numbers")
    if one.dimensions == 2 and "z" in domain.repeats:
        reason = f'must be of x and y in 2 dimensions, such as repeats = ["{domain.repeats[0]}"]'
        raise SceneError(f"{domain_name}.repeats", list(domain.repeats), reason)
    least = REPEATED * WIDER * one.support_radius
    for axis in domain.repeats:
        if domain.size["xyz".index(axis)] < least:
            reason = f"must be {REPEATED} supports long at least where it repeats, {least:g} m along {axis}"
            raise SceneError(f"{domain_name}.size", list(domain.size), reason)


def check_among_solids(scene: SceneParts) -> None:
    """Raise SceneError for a scene of fluids that cannot interact with solids."""
    if scene.dimensions == 2:
        reason = "must be 3 where a fluid meets solids, which lie in space"
        raise SceneError(f"{next(iter(scene.fluids))}.dimensions", 2, reason)
    if scene.domain is not None:
        reason = "is not supported together with solids, which have no periodic sides; leave it out"
        raise SceneError(f"{scene.name_of('domain')}.kind", "domain", reason)
    if scene.method.scheme != "macklin":
        raise SceneError("method.scheme", scene.method.scheme, "must be macklin where a fluid meets solids")
