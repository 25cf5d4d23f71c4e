"""Subsets of a scene's tetrahedra, for sharing whole bodies or parts of their meshes."""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.sharing.bodies import Apart, require_apart
from softlab.model.particles.tetrahedra.topology import bodies_of_particles
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene
from softlab.model.tables.attachment import pins


def tetrahedra_apart(scene: Scene) -> Apart:
    """Return the bodies of a scene, balanced by their tetrahedra.

    Raises SceneError for parts that let them act on each other, and for those that depend on all vertices.
    """
    require_apart(scene)
    if scene.mesh is not None:
        raise SceneError(
            f"{scene.name_of('mesh')}.kind",
            "mesh",
            "a cloth beside bodies is not supported on several GPUs or processes; run the scene on one",
        )
    if scene.external is not None and scene.external.magnitude > 0:
        reason = (
            "draws a random number for each vertex of all bodies; leave it out, or run the scene on one GPU or process"
        )
        raise SceneError(f"{scene.name_of('external')}.kind", "external", reason)
    for name, attachment in scene.attachment_parts.items():
        if not pins(attachment, scene.holdable):
            reason = "uses springs; several GPUs or processes support only pins and attachments to colliders"
            raise SceneError(f"{name}.kind", "attachment", reason)
    body_set = scene.tetrahedra_set
    return Apart(
        body_set.names, np.bincount(body_set.body, minlength=len(body_set.names)), "tetrahedra",
        np.array([*body_set.first_particle, body_set.particle_count]), "tetrahedra_set",
        lambda first, end: _whole_bodies(body_set, first, end),
        lambda first, end: np.zeros(0, np.int64),
    )  # fmt: skip


def none_apart(scene: Scene) -> NoReturn:
    """Raise SceneError for a solver that solves for all bodies together."""
    reason = "solves for all bodies at once, and stops by what is left of all: --set method.solver=xpbd to share them"
    raise SceneError("method.solver", scene.method.solver, reason)


def some_tetrahedra(whole: TetrahedraSet, particles: np.ndarray, tetrahedra: np.ndarray) -> TetrahedraSet:
    """Return the set of those `particles` and `tetrahedra`, renumbered from 0, as are their bodies.

    Both are (n,) int64, ascending; the corners of the tetrahedra are among the particles. Every value is the whole
    set's, including its mean mass and edge, on which kernels depend.
    """
    body = bodies_of_particles(whole.first_particle, whole.particle_count)[particles]
    bodies, first = np.unique(body, return_index=True)
    inside = np.isin(whole.surface, particles).all(axis=1)

    def numbered(corners: np.ndarray) -> np.ndarray:
        return np.searchsorted(particles, corners).astype(np.int32)

    part = replace(
        whole,
        names=tuple(whole.names[k] for k in bodies),
        parts=tuple(whole.parts[k] for k in bodies),
        position=whole.position[particles],
        velocity=whole.velocity[particles],
        masses=whole.masses[particles],
        pinned_vertices=np.flatnonzero(np.isin(particles, whole.pinned_vertices)),
        body=np.searchsorted(bodies, whole.body[tetrahedra]).astype(np.int32),
        tetrahedra=numbered(whole.tetrahedra[tetrahedra]),
        rest_inverse=whole.rest_inverse[tetrahedra],
        volume=whole.volume[tetrahedra],
        fraction=whole.fraction[tetrahedra],
        surface=numbered(whole.surface[inside]),
        first_particle=first,
        voxel=whole.voxel[tetrahedra],
        run=whole.run[tetrahedra],
        mesh_position=whole.mesh_position[particles],
        matter=whole.matter.some(tetrahedra),
        attachments={},
        whole=whole,
        of_whole=(particles, tetrahedra),
    )
    vars(part).update(mass=whole.mass, spacing=whole.spacing)
    return part


def _whole_bodies(whole: TetrahedraSet, first: int, end: int) -> TetrahedraSet:
    """Return bodies `first` to before `end`."""
    ends = [*whole.first_particle, whole.particle_count]
    particles = np.arange(ends[first], ends[end])
    return some_tetrahedra(whole, particles, np.arange(*np.searchsorted(whole.body, (first, end))))
