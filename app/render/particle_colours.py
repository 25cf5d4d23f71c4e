"""Colours of the particles and clusters of a scene's bodies."""

from __future__ import annotations

import numpy as np

from softlab.app.render import colours
from softlab.model.particles.body_set import BodySet
from softlab.model.scene.scene import Scene

COLOURINGS = ("body", "group", "cluster")  # the first is how bodies are shown at first


def of_numbers(number: np.ndarray) -> np.ndarray:
    """Return the colours (n, 3) float32 of numbers (n,); colours repeat."""
    repeated: np.ndarray = np.array(colours.BODIES, np.float32)[np.asarray(number) % len(colours.BODIES)]
    return repeated


def particle_colours(scene: Scene, colouring: str) -> np.ndarray:
    """Return the colours (particles, 3) float32 by `body`, by `group` of contacts, or by the `cluster` of the particle
    whose centre is nearest at rest."""
    body_set = scene.body_set
    if colouring == "group":
        groups = np.array([scene.bodies[copy.name].group for copy in body_set.copies])
        return of_numbers(np.unique(groups, return_inverse=True)[1][body_set.body])
    if colouring == "cluster":
        return cluster_colours(body_set)[nearest_clusters(body_set)]
    return of_numbers(body_set.body)


def cluster_colours(body_set: BodySet) -> np.ndarray:
    """Return the colours (clusters, 3) float32 by the clusters' numbers in their body."""
    return of_numbers(np.concatenate([np.arange(copy.baked.clusters.count) for copy in body_set.in_cluster_order]))


def nearest_clusters(body_set: BodySet) -> np.ndarray:
    """Return for each particle (particles,) int64 the cluster whose centre is nearest at rest; 0 for a particle without
    one."""
    clusters = body_set.clusters
    away = np.linalg.norm(clusters.rest, axis=1)
    order = np.lexsort((away, clusters.indices))
    particles, first = np.unique(clusters.indices[order], return_index=True)
    nearest = np.zeros(body_set.particle_count, np.int64)
    nearest[particles] = clusters.owner[order][first]
    return nearest
