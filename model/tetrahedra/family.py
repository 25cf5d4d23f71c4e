"""The family of tetrahedral bodies, solved position-based with two constraints each, and a cloth beside them."""

from __future__ import annotations

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.types import Real
from softlab.model.contact.attachments import KIND, stored
from softlab.model.contact.substep_parameters import XPBD_FIELDS, xpbd_values
from softlab.model.core.family import Arrays, SolverFamily
from softlab.model.core.parameters import rounded_record
from softlab.model.core.stability.projection import projection_limit, projection_note
from softlab.model.geometry.measures import edge_lengths
from softlab.model.position_based.mesh_constraints import mesh_energy
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS, CONSTRAINT_KINDS
from softlab.model.tables.motion import RELEASE
from softlab.model.tetrahedra.apart import tetrahedra_apart
from softlab.model.tetrahedra.constraints import CONSTANTS, constraint_sets, tetrahedra_plan, through_note
from softlab.model.tetrahedra.contact_sag import sag_lines
from softlab.model.tetrahedra.damping_load import damping_lines
from softlab.model.tetrahedra.material import energies
from softlab.model.tetrahedra.partitions import partitions_by, projected


def tetrahedra_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return CONSTANTS, then those of every position-based solver, (1,). Compliances [1/J] are in units of h^2 over the
    mean mass."""
    h = scene.method.dt / scene.method.substeps
    constants = dict(zip(CONSTANTS, (scene.grid.mass / h**2, 1 / h, 1.0), strict=True))
    return rounded_record(scene, constants | xpbd_values(scene, poke, clock), XPBD_FIELDS, real)


def _stored(scene: Scene, position: np.ndarray, arrays: Arrays) -> tuple[float, dict[str, float]]:
    body_set = scene.tetrahedra_set
    cloth_position = position[body_set.first_particle[-1] :]
    cloth = {kind: mesh_energy(scene, cloth_position, kind) for kind in scene.constraints}
    return float(energies(body_set, position).sum()) + stored(body_set, position) + sum(cloth.values()), cloth


def _strain(scene: Scene, position: np.ndarray, kind: str, arrays: Arrays) -> np.ndarray:
    ends, rest = scene.tetrahedra_set.edges
    return edge_lengths(np.asarray(position, np.float64), ends) / rest - 1


TETRAHEDRA = SolverFamily(
    name="tetrahedral body",
    knows=frozenset(
        {
            "tetrahedral_body",
            "contact",
            "gravity",
            "external",
            "damping",
            "method",
            "motion",
            "region",
            "attachment",
            "material",
            RELEASE,
            "mesh",
            "wind",
            *CONSTRAINT_KINDS,
            *COLLIDER_KINDS,
        }
    ),
    accepts=lambda scene: bool(scene.tetrahedra) and scene.method.solver == "xpbd",
    plan=tetrahedra_plan,
    record=tetrahedra_record,
    limit=projection_limit,
    limited_by_net=False,
    note=lambda scene: projection_note(scene) + through_note(scene),
    warnings=lambda scene: damping_lines(scene) + sag_lines(scene),
    stored=_stored,
    strain=_strain,
    spring_count=lambda scene: sum(len(one.corners) for one in constraint_sets(scene) if one.kind != KIND),
    solvers={backend: f"softlab.{backend}_backend.tetrahedra.solver:Tetrahedra" for backend in ("cpu", "gpu")},
    passes={"cpu": "softlab.app.plan.mesh:mesh_on_cpu", "gpu": "softlab.app.plan.mesh:tetrahedra_on_gpu"},
    reference="softlab.bench.reference.tetrahedra",
    presentation="softlab.app.families.tetrahedra:TETRAHEDRA",
    apart=tetrahedra_apart,
    partitions=lambda scene: partitions_by(scene, projected),
    unknown="tetrahedra have no converged reference; softlab tetrahedra measures how far a bar is from rest",
)
