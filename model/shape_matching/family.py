"""The shape-matching families: windows of a grid, and bodies of clusters; in the substeps of the position-based
solvers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.model.contact.substep_parameters import xpbd_record
from softlab.model.core.family import Arrays, SolverFamily
from softlab.model.core.stability.projection import projection_limit, projection_note
from softlab.model.core.stability.springs import sheet_spring_count, sheet_strain
from softlab.model.scene.checks.fit import OF_BODIES
from softlab.model.scene.checks.solver import MATCHED
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.apart import bodies_apart
from softlab.model.shape_matching.energy import goal_strain, window_energy
from softlab.model.shape_matching.fields import of_bodies
from softlab.model.shape_matching.plan import body_plan, window_plan


def _stored_in_bodies(scene: Scene, position: np.ndarray, arrays: Arrays) -> tuple[float, dict[str, float]]:
    """Return the energy of clusters and links [J]."""
    links = scene.body_set.links.energy(position)
    return scene.body_set.clusters.energy(position, arrays.get("plastic")) + links, {}


WINDOWS = SolverFamily(
    name="shape-matching grid",
    knows=frozenset(MATCHED),
    accepts=lambda scene: scene.method.matches_shapes and not (scene.bodies or scene.tetrahedra or scene.fluids),
    plan=window_plan,
    record=xpbd_record,
    limit=projection_limit,
    limited_by_net=True,
    note=projection_note,
    stored=lambda scene, position, arrays: (window_energy(scene, position), {}),
    strain=sheet_strain,
    spring_count=sheet_spring_count,
    solvers={
        "cpu": "softlab.cpu_backend.shape_matching.grid_solver:ShapeMatching",
        "gpu": "softlab.gpu_backend.xpbd.solver:PositionBased",
    },
    clusters={"gpu": "softlab.gpu_backend.shape_matching.matching:Matching"},
    passes={"cpu": "softlab.app.plan.xpbd:xpbd_on_cpu", "gpu": "softlab.app.plan.xpbd:xpbd_on_gpu"},
    reference="softlab.bench.reference.shape_matching",
    unknown="clusters are another material than springs and have no converged reference; --set method.solver=mass-spring "
    "solves the springs, softlab bar compares the two",
)

BODIES = replace(
    WINDOWS,
    name="bodies",
    knows=frozenset(OF_BODIES),
    accepts=lambda scene: bool(scene.bodies),
    presentation="softlab.app.families.bodies:BODIES",
    plan=body_plan,
    limited_by_net=False,
    stored=_stored_in_bodies,
    strain=lambda scene, position, kind, arrays: goal_strain(scene, position, arrays.get("plastic")),
    spring_count=lambda scene: 0,
    solvers={backend: f"softlab.{backend}_backend.shape_matching.solver:Bodies" for backend in ("cpu", "gpu")},
    passes={"cpu": "softlab.app.plan.xpbd:bodies_on_cpu", "gpu": "softlab.app.plan.xpbd:bodies_on_gpu"},
    clusters={},
    fields=of_bodies,
    apart=bodies_apart,
    unknown="shape-matching bodies have no converged reference: clusters are their material; softlab bar compares it with "
    "closed forms, softlab throughput measures its speed",
)
