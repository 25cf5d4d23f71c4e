"""The family of tetrahedral bodies by vertex block descent on the energy of a step of backward Euler.

An incomplete solution is an error of this step, not of the material: a pinned body at rest stays there with any number
of sweeps. A free one falls exactly, but conserves its momentum only as far as sweeps converge (a deformed body lost 7 %
in one sweep, 0.3 % in four, 1e-7 in sixteen). Colliders are springs within a visit, with friction; the remaining
penetration is removed at the end of a substep. Contacts of surfaces are projected after each sweep, outside the energy:
two cubes of 0.3 m, one on the other, keep 18, 20, 23 and 25 mm at 1, 2, 4 and 16 substeps of a frame, where
position-based ones keep 26.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import XPBD_FIELDS, xpbd_values
from softlab.model.core.parameters import rounded_record
from softlab.model.core.stability.projection import with_limit
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import through_note
from softlab.model.tetrahedra.descent import SCALE, vbd_plan
from softlab.model.tetrahedra.descent_partitions import descended
from softlab.model.tetrahedra.family import TETRAHEDRA
from softlab.model.tetrahedra.newton import CONSTANTS
from softlab.model.tetrahedra.partitions import partitions_by


def vbd_record(scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START) -> np.ndarray:
    """Return SCALE, h^2 over the mean mass, by which stiffnesses times volumes [J] are multiplied, then the constants
    of every position-based solver, (1,)."""
    h = scene.method.dt / scene.method.substeps
    fields = {**XPBD_FIELDS, SCALE: "method.dt"}
    constants = dict(zip((SCALE, *CONSTANTS), (h**2 / scene.grid.mass, scene.grid.mass / h**2, 1 / h), strict=True))
    return rounded_record(scene, constants | xpbd_values(scene, poke, clock), fields, real)


def vbd_note(scene: Scene) -> str:
    """Return a line on the method's effect on a motion."""
    text = "backward Euler's energy, vertex by vertex, at any step size; first order, and damped by it"
    return with_limit(scene, text) + through_note(scene)


TETRAHEDRA_VBD = replace(
    TETRAHEDRA,
    name="tetrahedral body by vertex block descent",
    accepts=lambda scene: bool(scene.tetrahedra) and scene.method.solver == "vbd",
    plan=vbd_plan,
    record=vbd_record,
    note=vbd_note,
    solvers={
        "cpu": "softlab.cpu_backend.tetrahedra.descent:VertexBlockDescent",
        "gpu": "softlab.gpu_backend.tetrahedra.descent:VertexBlockDescent",
    },
    partitions=lambda scene: partitions_by(scene, descended),
    passes={"cpu": "softlab.app.plan.mesh:vertices_on_cpu", "gpu": "softlab.app.plan.mesh:vertices_on_gpu"},
)
