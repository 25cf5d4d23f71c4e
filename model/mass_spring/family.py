"""Mass-spring: the grid in a plane and the cloth in space, stepped by an integrator."""

from __future__ import annotations

from dataclasses import replace

from model.core.errors import SceneError
from model.core.family import ANY_SHEET, SolverFamily
from model.core.integrators import explicit_limit, integrators_for
from model.core.parameters import parameter_record
from model.domains.decomposition import Reach
from model.mass_spring.cloth_parameters import cloth_record
from model.mass_spring.cloth_plan import cloth_plan
from model.mass_spring.energy import sheet_spring_count, sheet_strain, stored_in_springs
from model.mass_spring.plan import mass_spring_plan
from model.scene.cloth import COLLIDER_KINDS, SPRING_KINDS
from model.scene.scene import Scene


def _note(scene: Scene) -> str:
    return integrators_for(scene)[scene.method.integrator].note


def _is_stepped(scene: Scene) -> bool:
    return not (scene.bodies or scene.tetrahedra or scene.fluids) and not scene.method.position_based


def _grid_reach(scene: Scene) -> Reach:
    """Springs reach the next row. Raises SceneError for a force that asks for a mass's row."""
    if scene.manufactured:
        raise SceneError(
            scene.name_of("manufactured"), None, "asks where in the grid a mass is: run it as one, not shared"
        )
    integrator = integrators_for(scene)[scene.method.integrator]
    alternate = scene.springs is not None and scene.springs.alternate
    return Reach(1, integrator.forces, scene.method.integrator == "velocity-verlet", alternate)


GRID = SolverFamily(
    name="mass-spring grid",
    accepts=lambda scene: _is_stepped(scene) and not scene.cloth,
    knows=ANY_SHEET | {"grid", "springs", "manufactured"},
    plan=mass_spring_plan,
    record=parameter_record,
    limit=explicit_limit,
    limited_by_net=True,
    note=_note,
    stored=stored_in_springs,
    strain=sheet_strain,
    spring_count=sheet_spring_count,
    solvers={
        "cpu": "cpu_backend.mass_spring.grid.solver:MassSpring",
        "gpu": "gpu_backend.mass_spring.grid.solver:MassSpring",
    },
    passes={"cpu": "app.plan.grid:grid_on_cpu", "gpu": "app.plan.grid:grid_on_gpu"},
    reference="bench.reference.mass_spring",
    reach=_grid_reach,
)

CLOTH = replace(
    GRID,
    name="mass-spring cloth",
    accepts=lambda scene: _is_stepped(scene) and scene.cloth is not None,
    reach=None,
    knows=ANY_SHEET | {"cloth", "wind", "motion", "fold", *SPRING_KINDS, *COLLIDER_KINDS},
    plan=cloth_plan,
    record=cloth_record,
    solvers={
        "cpu": "cpu_backend.mass_spring.cloth.solver:ClothMassSpring",
        "gpu": "gpu_backend.mass_spring.cloth.solver:ClothMassSpring",
    },
    passes={"cpu": "app.plan.cloth:cloth_on_cpu", "gpu": "app.plan.cloth:cloth_on_gpu"},
)
