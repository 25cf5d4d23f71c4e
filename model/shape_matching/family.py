"""The shape-matching families: windows of a grid, and bodies of clusters; in the substeps of the position-based
solvers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.model.scene.checks.fit import OF_BODIES
from softlab.model.scene.checks.solver import MATCHED
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.apart import bodies_apart
from softlab.model.shape_matching.energy import goal_strain, window_energy
from softlab.model.shape_matching.outputs import of_bodies
from softlab.model.xpbd.family import SHEET


def _stored_in_windows(
    scene: Scene, position: np.ndarray, plastic: np.ndarray | None
) -> tuple[float, dict[str, float]]:
    return window_energy(scene, position), {}


def _stored_in_bodies(scene: Scene, position: np.ndarray, plastic: np.ndarray | None) -> tuple[float, dict[str, float]]:
    """Return the energy of clusters and links [J]."""
    links = scene.body_set.links.energy(position)
    return scene.body_set.clusters.energy(position, plastic) + links, {}


WINDOWS = replace(
    SHEET,
    name="shape-matching grid",
    knows=frozenset(MATCHED),
    accepts=lambda scene: scene.method.matches_shapes and not (scene.bodies or scene.tetrahedra or scene.fluids),
    stored=_stored_in_windows,
    solvers={
        backend: f"softlab.{backend}_backend.shape_matching.grid_solver:ShapeMatching" for backend in ("cpu", "gpu")
    },
    reference="softlab.bench.reference.shape_matching",
    stencil=None,
    unknown="clusters are another material than springs and have no converged reference; --set method.solver=mass-spring "
    "solves the springs, softlab bar compares the two",
)

BODIES = replace(
    SHEET,
    name="bodies",
    knows=frozenset(OF_BODIES),
    accepts=lambda scene: bool(scene.bodies),
    limited_by_net=False,
    stored=_stored_in_bodies,
    strain=lambda scene, position, kind, plastic: goal_strain(scene, position, plastic),
    spring_count=lambda scene: 0,
    solvers={backend: f"softlab.{backend}_backend.shape_matching.solver:Bodies" for backend in ("cpu", "gpu")},
    passes={"cpu": "softlab.app.plan.xpbd:bodies_on_cpu", "gpu": "softlab.app.plan.xpbd:bodies_on_gpu"},
    reference="softlab.bench.reference.shape_matching",
    stencil=None,
    outputs=of_bodies,
    apart=bodies_apart,
    unknown="shape-matching bodies have no converged reference: clusters are their material; softlab bar compares it with "
    "closed forms, softlab throughput measures its speed",
)
