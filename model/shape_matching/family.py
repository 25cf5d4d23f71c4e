"""Shape matching: windows of a grid, and bodies of clusters."""

from __future__ import annotations

import numpy as np

from model.core.family import SolverFamily
from model.mass_spring.energy import sheet_spring_count, sheet_strain
from model.scene.scene import Scene
from model.shape_matching.energy import goal_strain, window_energy
from model.xpbd.family import projection_limit, projection_note
from model.xpbd.parameters import xpbd_record
from model.xpbd.plan import xpbd_plan


def _stored_in_windows(
    scene: Scene, position: np.ndarray, plastic: np.ndarray | None
) -> tuple[float, dict[str, float]]:
    return window_energy(scene, position), {}


def _stored_in_bodies(scene: Scene, position: np.ndarray, plastic: np.ndarray | None) -> tuple[float, dict[str, float]]:
    return scene.body_set.clusters.energy(position, plastic), {}


WINDOWS = SolverFamily(
    name="shape-matching grid",
    accepts=lambda scene: scene.method.matches_shapes and not scene.bodies,
    plan=xpbd_plan,
    record=xpbd_record,
    limit=projection_limit,
    limited_by_net=True,
    note=projection_note,
    stored=_stored_in_windows,
    strain=sheet_strain,
    spring_count=sheet_spring_count,
    solvers={
        "cpu": "cpu_backend.shape_matching.grid_solver:ShapeMatching",
        "gpu": "gpu_backend.xpbd.solver:PositionBased",
    },
    passes={"cpu": "app.plan.xpbd:xpbd_on_cpu", "gpu": "app.plan.xpbd:xpbd_on_gpu"},
    reference="bench.reference.shape_matching",
    unknown="clusters have no converged reference: they are another material than springs; --set method.solver=mass-spring "
    "asks about the springs, softlab bar tells how the two differ",
)

BODIES = SolverFamily(
    name="bodies",
    accepts=lambda scene: bool(scene.bodies),
    plan=xpbd_plan,
    record=xpbd_record,
    limit=projection_limit,
    limited_by_net=False,
    note=projection_note,
    stored=_stored_in_bodies,
    strain=lambda scene, position, kind, plastic: goal_strain(scene, position, plastic),
    spring_count=lambda scene: 0,
    solvers={"cpu": "cpu_backend.shape_matching.solver:Bodies", "gpu": "gpu_backend.shape_matching.solver:Bodies"},
    passes={"cpu": "app.plan.xpbd:bodies_on_cpu", "gpu": "app.plan.xpbd:bodies_on_gpu"},
    reference="bench.reference.shape_matching",
    unknown="no error can be told of bodies: clusters are their material, and have no converged reference; softlab bar holds "
    "that material against closed forms, softlab crowds times bodies, softlab run tells of this scene",
)
