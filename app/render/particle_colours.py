"""Colours of the particles and the clusters of a scene's bodies: of whatever a particle belongs to."""

from __future__ import annotations

import numpy as np

from app.render import colours
from model.scene.scene import Scene
from model.shape_matching.crowd import Crowd

COLOURINGS = ("body", "group", "cluster")  # the first is how bodies are shown at first


def of_numbers(number: np.ndarray) -> np.ndarray:
    """(n, 3) float32: the colours of numbers (n,), which repeat."""
    found: np.ndarray = np.array(colours.BODIES, np.float32)[np.asarray(number) % len(colours.BODIES)]
    return found


def particle_colours(scene: Scene, colouring: str) -> np.ndarray:
    """(particles, 3) float32: by `body`, by the `group` that contacts know it by, or by the `cluster` whose middle is nearest
    at rest, of those that it is in."""
    crowd = scene.crowd
    if colouring == "group":
        groups = np.array([scene.bodies[copy.name].group for copy in crowd.copies])
        return of_numbers(np.unique(groups, return_inverse=True)[1][crowd.body])
    if colouring == "cluster":
        return cluster_colours(crowd)[nearest_clusters(crowd)]
    return of_numbers(crowd.body)


def cluster_colours(crowd: Crowd) -> np.ndarray:
    """(clusters, 3) float32: by their numbers in their body."""
    return of_numbers(np.concatenate([np.arange(copy.baked.clusters.count) for copy in crowd.in_cluster_order]))


def nearest_clusters(crowd: Crowd) -> np.ndarray:
    """(particles,) int64: of the clusters that a particle is in the one whose middle is nearest to it at rest; 0 of an
    orphan."""
    clusters = crowd.clusters
    away = np.linalg.norm(clusters.rest, axis=1)
    order = np.lexsort((away, clusters.indices))
    particles, first = np.unique(clusters.indices[order], return_index=True)
    found = np.zeros(crowd.particle_count, np.int64)
    found[particles] = clusters.owner[order][first]
    return found
