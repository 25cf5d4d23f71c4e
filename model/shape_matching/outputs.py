"""Outputs of `Simulation.read` for bodies of clusters."""

from __future__ import annotations

import numpy as np

from softlab.model.core.family import Output, on_host
from softlab.model.core.state import every_plastic
from softlab.model.scene.scene import Scene

ROTATION = Output(
    "rotation",
    "(clusters, 4)",
    "1",
    "unit quaternions (w, x, y, z) of clusters",
    on_host(lambda one: one.read_clusters()[0]),
)
CENTRE = Output(
    "centre", "(clusters, 3)", "m", "centres of mass of clusters", on_host(lambda one: one.read_clusters()[1])
)
DEFORMATION = Output(
    "deformation", "(clusters, 3, 3)", "1", "matrices from rest offsets to goal offsets of clusters",
    on_host(lambda one: one._read_deformation()),
)  # fmt: skip
PLASTIC = Output(
    "plastic", "(clusters, 3, 3)", "1", "plastic deformation of rest offsets, of determinant 1",
    on_host(lambda one: np.asarray(every_plastic(one._download_plastic(), one._cluster_count()))),
)  # fmt: skip


def of_bodies(scene: Scene) -> tuple[Output, ...]:
    """Return the outputs of a scene with bodies of clusters."""
    is_plastic = "plastic" in scene.body_set.clusters.parts
    return ROTATION, CENTRE, DEFORMATION, *((PLASTIC,) if is_plastic else ())
