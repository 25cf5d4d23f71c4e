"""The mass-spring families: the grid in a plane and the cloth in space, stepped by an integrator."""

from __future__ import annotations

from dataclasses import replace

from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import cloth_record
from softlab.model.contact.sheet_plan import cloth_parts
from softlab.model.core.family import ANY_SHEET, SolverFamily
from softlab.model.core.integrators import IMPLICIT, explicit_limit, integrators_for
from softlab.model.core.parameters import parameter_record
from softlab.model.core.sharing.decomposition import Stencil, require_local
from softlab.model.core.stability.springs import sheet_spring_count, sheet_strain, stored_in_springs
from softlab.model.mass_spring.cloth_plan import cloth_plan, kicks_coupled
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS, SPRING_KINDS


def _note(scene: Scene) -> str:
    return integrators_for(scene)[scene.method.integrator].note


def _is_stepped(scene: Scene) -> bool:
    return not (scene.bodies or scene.tetrahedra or scene.fluids) and not scene.method.position_based


def _grid_stencil(scene: Scene) -> Stencil:
    """Return the rows that a step reads: springs extend to the next row."""
    integrator = integrators_for(scene)[scene.method.integrator]
    alternate = scene.springs is not None and scene.springs.alternate
    verlet = scene.method.integrator == "velocity-verlet"
    return Stencil(1, integrator.forces, int(verlet), 2 if alternate else 1, numbered=True)


def _cloth_stencil(scene: Scene) -> Stencil:
    """Return the rows that a step reads: springs extend to the next row, those against bending to the one after it.

    Velocity Verlet evaluates forces twice if its kicks are not combined. Raises SceneError for parts that depend on a
    mass's number in the whole cloth, and for implicit Euler.
    """
    require_local(scene)
    name = scene.method.integrator
    if name in IMPLICIT:
        raise SceneError(
            "method.integrator",
            name,
            "solves for the whole cloth at once; choose another integrator for several GPUs or processes",
        )
    apart = name == "velocity-verlet" and not kicks_coupled(cloth_parts(scene))
    forces = 2 if apart else integrators_for(scene)[name].forces
    rows = 2 if "bending" in scene.cloth_springs else 1
    return Stencil(rows, forces, rows if name == "velocity-verlet" and not apart else 0)


GRID = SolverFamily(
    name="mass-spring grid",
    accepts=lambda scene: _is_stepped(scene) and not scene.cloth,
    knows=ANY_SHEET | {"grid", "springs"},
    plan=mass_spring_plan,
    record=parameter_record,
    limit=explicit_limit,
    limited_by_net=True,
    note=_note,
    stored=stored_in_springs,
    strain=sheet_strain,
    spring_count=sheet_spring_count,
    solvers={
        "cpu": "softlab.cpu_backend.mass_spring.grid.solver:MassSpring",
        "gpu": "softlab.gpu_backend.mass_spring.grid.solver:MassSpring",
    },
    passes={"cpu": "softlab.app.plan.grid:grid_on_cpu", "gpu": "softlab.app.plan.grid:grid_on_gpu"},
    reference="softlab.bench.reference.mass_spring",
    stencil=_grid_stencil,
)

CLOTH = replace(
    GRID,
    name="mass-spring cloth",
    accepts=lambda scene: _is_stepped(scene) and scene.cloth is not None,
    stencil=_cloth_stencil,
    knows=ANY_SHEET | {"cloth", "wind", "motion", "fold", *SPRING_KINDS, *COLLIDER_KINDS},
    plan=cloth_plan,
    record=cloth_record,
    solvers={
        "cpu": "softlab.cpu_backend.mass_spring.cloth.solver:ClothMassSpring",
        "gpu": "softlab.gpu_backend.mass_spring.cloth.solver:ClothMassSpring",
    },
    passes={"cpu": "softlab.app.plan.cloth:cloth_on_cpu", "gpu": "softlab.app.plan.cloth:cloth_on_gpu"},
)
