"""Colours of the particles and the clusters of a scene's bodies: of whatever a particle belongs to."""

from __future__ import annotations

import numpy as np

from softlab.app.render import colours
from softlab.model.particles.body_set import BodySet
from softlab.model.scene.scene import Scene

COLOURINGS = ("body", "group", "cluster")  # the first is how bodies are shown at first


def of_numbers(number: np.ndarray) -> np.ndarray:
    """(n, 3) float32: the colours of numbers (n,), which repeat."""
    found: np.ndarray = np.array(colours.BODIES, np.float32)[np.asarray(number) % len(colours.BODIES)]
    return found


def particle_colours(scene: Scene, colouring: str) -> np.ndarray:
    """(particles, 3) float32: by `body`, by the `group` that contacts know it by, or by the `cluster` whose middle is nearest
    at rest, of those that it is in."""
    body_set = scene.body_set
    if colouring == "group":
        groups = np.array([scene.bodies[copy.name].group for copy in body_set.copies])
        return of_numbers(np.unique(groups, return_inverse=True)[1][body_set.body])
    if colouring == "cluster":
        return cluster_colours(body_set)[nearest_clusters(body_set)]
    return of_numbers(body_set.body)


def cluster_colours(body_set: BodySet) -> np.ndarray:
    """(clusters, 3) float32: by their numbers in their body."""
    return of_numbers(np.concatenate([np.arange(copy.baked.clusters.count) for copy in body_set.in_cluster_order]))


def nearest_clusters(body_set: BodySet) -> np.ndarray:
    """(particles,) int64: of the clusters that a particle is in the one whose middle is nearest to it at rest; 0 of an
    orphan."""
    clusters = body_set.clusters
    away = np.linalg.norm(clusters.rest, axis=1)
    order = np.lexsort((away, clusters.indices))
    particles, first = np.unique(clusters.indices[order], return_index=True)
    found = np.zeros(body_set.particle_count, np.int64)
    found[particles] = clusters.owner[order][first]
    return found
