"""Some of a scene's tetrahedral bodies as a set of their own, for those who share bodies that never meet."""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

import numpy as np

from model.core.errors import SceneError
from model.domains.bodies import Apart, require_apart
from model.scene.attachment import pins
from model.scene.scene import Scene
from model.tetrahedra.body_set import TetrahedraSet


def tetrahedra_apart(scene: Scene) -> Apart:
    """The bodies of a scene, balanced by their tetrahedra. Raises SceneError for what lets them act on each other, and what
    is of all vertices."""
    require_apart(scene)
    if scene.mesh is not None:
        raise SceneError(f"{scene.name_of('mesh')}.kind", "mesh", "a cloth beside bodies is not shared: run it as one")
    if scene.external is not None and scene.external.magnitude > 0:
        told = "draws a number for each vertex of all bodies: leave it out, or run it as one"
        raise SceneError(f"{scene.name_of('external')}.kind", "external", told)
    for name, held in scene.held_parts.items():
        if not pins(held, scene.holdable):
            told = (
                "ties what it holds by springs: shared bodies are pinned alone, or follow a collider; or run it as one"
            )
            raise SceneError(f"{name}.kind", "attachment", told)
    found = scene.tetrahedra_set
    return Apart(
        found.names, np.bincount(found.body, minlength=len(found.names)), "tetrahedra",
        np.array([*found.first_particle, found.particle_count]), "tetrahedra_set",
        lambda first, end: some_tetrahedra(found, first, end),
        lambda first, end: np.zeros(0, np.int64),
    )  # fmt: skip


def none_apart(scene: Scene) -> NoReturn:
    """Of a solver that looks at all bodies together. Raises SceneError."""
    told = "solves for all bodies at once, and stops by what is left of all: --set method.solver=xpbd to share them"
    raise SceneError("method.solver", scene.method.solver, told)


def some_tetrahedra(whole: TetrahedraSet, first: int, end: int) -> TetrahedraSet:
    """Bodies `first` to before `end`, numbered from 0 on as are their particles. Every value is the whole set's, its mean
    mass and edge too, in which kernels count."""
    ends = [*whole.first_particle, whole.particle_count]
    begin, stop = int(ends[first]), int(ends[end])
    mine = slice(*np.searchsorted(whole.body, (first, end)).tolist())
    pinned = whole.pinned_vertices
    found = replace(
        whole,
        names=whole.names[first:end],
        parts=whole.parts[first:end],
        position=whole.position[begin:stop],
        velocity=whole.velocity[begin:stop],
        masses=whole.masses[begin:stop],
        pinned_vertices=pinned[(pinned >= begin) & (pinned < stop)] - begin,
        body=whole.body[mine] - np.int32(first),
        tetrahedra=whole.tetrahedra[mine] - np.int32(begin),
        rest_inverse=whole.rest_inverse[mine],
        volume=whole.volume[mine],
        surface=whole.surface[(whole.surface[:, 0] >= begin) & (whole.surface[:, 0] < stop)] - np.int32(begin),
        first_particle=whole.first_particle[first:end] - begin,
        voxel=whole.voxel[mine],
        run=whole.run[mine],
        own=whole.own[begin:stop],
        matter=whole.matter.some(mine),
        attachments={},
        whole=whole,
        begins=(begin, mine.start),
    )
    vars(found).update(mass=whole.mass, spacing=whole.spacing)
    return found
