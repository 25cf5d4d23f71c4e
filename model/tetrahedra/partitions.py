"""The meshes of tetrahedral bodies in parts: where they are cut, and the data that a substep reads for some
vertices.

A substep predicts each vertex alone, sweeps over colours, and ends, again vertex by vertex. Traced backwards, the
vertices needed after a colour need, before it, all corners of the constraints (xpbd), or of the tetrahedra of the
vertices (vbd), of that colour that touch them; and so on to the substep's start. Positions at its start, multipliers
and earlier iterates of accelerated sweeps are needed by the same constraints and vertices.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.model.core.sharing.partitions import SharedMesh, Window
from softlab.model.particles.tetrahedra.topology import bodies_of_particles, neighbours
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.apart import some_tetrahedra, tetrahedra_apart
from softlab.model.tetrahedra.constraints import SLEEPING, constraint_sets, tetrahedra_of_sets, tetrahedra_parts

ALIKE = 1e-6  # of a mean edge: vertices this near to each other along a body are in one layer


def partitions_by(scene: Scene, walk: Callable[[Scene, np.ndarray], Window]) -> SharedMesh:
    """Return the meshes of a scene for any solver.

    `walk(scene, needed)`: the particles that its sweeps read so that the `needed` ones, (particles,) bool, are as in
    the whole mesh. Raises SceneError for parts that let bodies act on each other, and for those that depend on all
    vertices.
    """
    tetrahedra_apart(scene)
    body_set = scene.tetrahedra_set

    def window(owned: np.ndarray) -> Window:
        return walk(scene, _looked_at(scene, owned))

    weights = np.bincount(body_set.tetrahedra.ravel(), minlength=body_set.particle_count) / 4
    return SharedMesh(
        layers_of(body_set), weights, window, len(body_set.tetrahedra), "tetrahedra", scene.method.substeps,
        "tetrahedra_set", lambda window: some_tetrahedra(body_set, *window),
    )  # fmt: skip


def layers_of(body_set: TetrahedraSet) -> np.ndarray:
    """Return each particle's layer across the longest axis of its body, (particles,) int64, one body after the
    other."""
    body = bodies_of_particles(body_set.first_particle, body_set.particle_count)
    along = np.empty(body_set.particle_count)
    for number in range(len(body_set.names)):
        of_body = body == number
        position = body_set.mesh_position[of_body]
        along[of_body] = position[:, np.ptp(position, axis=0).argmax()]
    order = np.lexsort((along, body))
    apart = (np.diff(along[order]) > ALIKE * body_set.spacing) | (np.diff(body[order]) != 0)
    layers = np.empty(body_set.particle_count, np.int64)
    layers[order] = np.concatenate([[0], np.cumsum(apart)])
    return layers


def _looked_at(scene: Scene, owned: np.ndarray) -> np.ndarray:
    """Return the particles that must be right after the sweeps, so that the `owned` ones are at the substep's end,
    (particles,) bool: sleeping depends on neighbours."""
    needed = owned.copy()
    if SLEEPING in tetrahedra_parts(scene):
        near = neighbours(scene.tetrahedra_set.tetrahedra, len(owned))
        needed[near.indices[np.repeat(owned, near.lengths)]] = True
    return needed


def projected(scene: Scene, needed: np.ndarray) -> Window:
    """Return the window that all iterations of a substep read so that the `needed` (particles,) bool are as in the
    whole."""
    body_set = scene.tetrahedra_set
    needed, touched = needed.copy(), np.zeros(len(body_set.tetrahedra), bool)
    for _ in range(scene.method.iterations):
        before = needed.sum()
        for which, one in zip(reversed(tetrahedra_of_sets(body_set)), reversed(constraint_sets(scene)), strict=True):
            for colour in reversed(range(one.colours)):
                run = slice(one.starts[colour], one.starts[colour + 1])
                corners = one.corners[run].reshape(-1, one.run * one.corners.shape[1])
                hit = needed[corners].any(axis=1)
                needed[corners[hit]] = True
                touched[which[run].reshape(-1, one.run)[hit]] = True
        if needed.sum() == before:  # earlier sweeps need no more
            break
    return np.flatnonzero(needed), np.flatnonzero(touched)
