"""The constants of implicit Euler's matrix: the cloth's record with the springs' constants as in the matrix, and more.

A spring's three constants have the names of `model/contact/cloth_parameters.py`, times dt^2 (stiffness) or dt
(damping), so that the formulas of springs read either record.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS, FIELDS, cloth_values
from softlab.model.core.parameters import rounded_record
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import SPRING_KINDS

MATRIX_PARAMETERS = (  # only in the matrix
    "damping_of_step",  # dt rate
    "mass_entry",  # 1 + dt rate: diagonal entry of a mass without springs
    "speed_squared",  # of all masses: the speed [m/s] that springs of twice their length would cause in a step
    "roundoff",  # half of the distance from 1 to the next number
)
SYSTEM_PARAMETERS = (*MATRIX_PARAMETERS, *CLOTH_PARAMETERS)


def system_record(scene: Scene, real: Real) -> np.ndarray:
    """Return SYSTEM_PARAMETERS in the arithmetic `real`, (1,): computed in float64, rounded once. Raises SceneError."""
    dt = scene.method.dt
    cloth = cloth_values(scene, 1, (0.0, 0.0, 0.0))
    values = dict.fromkeys(SYSTEM_PARAMETERS, 0.0)
    values["dt"] = dt
    for kind in SPRING_KINDS:
        values[kind] = dt * dt * cloth[kind]
        values[f"{kind}_rest"] = dt * dt * cloth[f"{kind}_rest"]
        values[f"{kind}_damping"] = dt * cloth[f"{kind}_damping"]
    speed = dt * 4 * sum(cloth[f"{kind}_rest"] for kind in SPRING_KINDS)
    values["damping_of_step"] = dt * cloth["damping"]
    values["mass_entry"] = 1 + dt * cloth["damping"]
    values["speed_squared"] = scene.grid.particle_count * speed**2
    values["roundoff"] = float(np.finfo(real).eps) / 2
    return rounded_record(scene, values, FIELDS | {"damping_of_step": FIELDS["damping"]}, real)


# Order of sums over all masses, so that both backends round them alike (see cpu_backend/mass_spring/cloth/sums.py):
LANES = 32  # partial sums of a segment
SEGMENT = 256  # columns at most
TREE = 256  # partial sums of all segments
SUMS = 3  # at most, at a time


def segments_of(rows: int, columns: int) -> int:
    """Return the number of segments of a sheet."""
    return rows * -(-columns // SEGMENT)


def without_dampers(parts: frozenset[str]) -> frozenset[str]:
    """Return the parts that change a kernel's code: every system has dampers, with a coefficient of 0 where there is
    none."""
    return frozenset(part for part in parts if not part.endswith("damping"))
