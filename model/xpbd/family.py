"""The families of PBD and XPBD: sheets of rows and columns (grid or cloth), and meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.model.contact.substep_parameters import xpbd_record
from softlab.model.core.family import ANY_SHEET, Arrays, SolverFamily
from softlab.model.core.sharing.decomposition import Stencil, require_local
from softlab.model.core.stability.projection import projection_limit, projection_note
from softlab.model.core.stability.springs import sheet_spring_count, sheet_strain, stored_in_springs
from softlab.model.position_based.mesh_constraints import constraint_sets, edge_strain, mesh_energy
from softlab.model.position_based.mesh_plan import xpbd_mesh_plan
from softlab.model.position_based.plan import xpbd_parts, xpbd_plan
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS, CONSTRAINT_KINDS, SPRING_KINDS
from softlab.model.xpbd.reach import period, substep_rows


def _stored_in_mesh(scene: Scene, position: np.ndarray, arrays: Arrays) -> tuple[float, dict[str, float]]:
    by_kind = {kind: mesh_energy(scene, position, kind) for kind in scene.constraints}
    return sum(by_kind.values()), by_kind


def _sheet_stencil(scene: Scene) -> Stencil:
    """Return the rows that a substep reads in its iterations; windows may exchange after each.

    Raises SceneError for parts that depend on a mass's number in the whole sheet, or connect masses across it.
    """
    require_local(scene)
    parts = xpbd_parts(scene)
    rows, more = substep_rows(parts, scene.method.iterations)
    return Stencil(rows, more=more, unit=period(parts), parts=scene.method.substeps)


SHEET = SolverFamily(
    name="position-based sheet",
    knows=ANY_SHEET
    | {"grid", "springs", "cloth", "wind", "motion", "fold"}
    | set(SPRING_KINDS)
    | set(COLLIDER_KINDS)
    | {"load", "attachments", "self_collision"},
    accepts=lambda scene: (
        scene.method.position_based
        and not (scene.method.matches_shapes or scene.mesh or scene.tetrahedra or scene.fluids or scene.is_world)
    ),
    plan=xpbd_plan,
    record=xpbd_record,
    limit=projection_limit,
    limited_by_net=True,
    note=projection_note,
    stored=stored_in_springs,
    strain=sheet_strain,
    spring_count=sheet_spring_count,
    solvers={
        "cpu": "softlab.cpu_backend.xpbd.solver:PositionBased",
        "gpu": "softlab.gpu_backend.xpbd.solver:PositionBased",
    },
    passes={"cpu": "softlab.app.plan.xpbd:xpbd_on_cpu", "gpu": "softlab.app.plan.xpbd:xpbd_on_gpu"},
    reference="softlab.bench.reference.xpbd",
    stencil=_sheet_stencil,
)

MESH = replace(
    SHEET,
    name="position-based mesh",
    presentation="softlab.app.families.sheets:MESH",
    knows=ANY_SHEET | {"mesh", "wind", "attachments", *COLLIDER_KINDS, *CONSTRAINT_KINDS} - {"shear"},
    accepts=lambda scene: scene.mesh is not None and not scene.tetrahedra,
    plan=xpbd_mesh_plan,
    limited_by_net=False,
    stored=_stored_in_mesh,
    strain=lambda scene, position, kind, arrays: edge_strain(scene, position, kind),
    spring_count=lambda scene: sum(len(one.corners) for one in constraint_sets(scene)),
    solvers={backend: f"softlab.{backend}_backend.position_based.mesh:MeshPositionBased" for backend in ("cpu", "gpu")},
    passes={"cpu": "softlab.app.plan.mesh:mesh_on_cpu", "gpu": "softlab.app.plan.mesh:mesh_on_gpu"},
    reference="softlab.bench.reference.xpbd_mesh",
    stencil=None,
    unknown="a mesh has no converged reference; grids and cloths of rows and columns have one, and a [cloth] is such a sheet",
)
