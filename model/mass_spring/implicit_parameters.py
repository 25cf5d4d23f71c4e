"""The constants of implicit Euler's matrix: the cloth's record with a spring's constants as the matrix has them, and more.

A spring's three constants are called as `model/mass_spring/cloth_parameters.py` has them, times dt^2 (stiffness) or dt
(damping), so that the formulas of springs read either record.
"""

from __future__ import annotations

import numpy as np

from model.core.parameters import rounded_record
from model.mass_spring.cloth_parameters import CLOTH_PARAMETERS, FIELDS, cloth_values
from model.scene.cloth import SPRING_KINDS
from model.scene.scene import Scene

OWN = (  # what only the matrix has
    "damping_of_step",  # dt rate
    "mass_entry",  # 1 + dt rate: a mass's entry without springs
    "speed_squared",  # of all masses: the speed [m/s] that springs of twice their length would give in a step
    "roundoff",  # half of the distance from 1 to the next number
)
SYSTEM_PARAMETERS = (*OWN, *CLOTH_PARAMETERS)


def system_record(scene: Scene, real: type) -> np.ndarray:
    """(1,): SYSTEM_PARAMETERS in the arithmetic `real`: computed in float64, rounded once. Raises SceneError."""
    dt = scene.method.dt
    given = cloth_values(scene, 1, (0.0, 0.0, 0.0))
    values = dict.fromkeys(SYSTEM_PARAMETERS, 0.0)
    values["dt"] = dt
    for kind in SPRING_KINDS:
        values[kind] = dt * dt * given[kind]
        values[f"{kind}_rest"] = dt * dt * given[f"{kind}_rest"]
        values[f"{kind}_damping"] = dt * given[f"{kind}_damping"]
    speed = dt * 4 * sum(given[f"{kind}_rest"] for kind in SPRING_KINDS)
    values["damping_of_step"] = dt * given["damping"]
    values["mass_entry"] = 1 + dt * given["damping"]
    values["speed_squared"] = scene.grid.particle_count * speed**2
    values["roundoff"] = float(np.finfo(real).eps) / 2
    return rounded_record(scene, values, FIELDS | {"damping_of_step": FIELDS["damping"]}, real)


# How sums over all masses are taken, so that both backends round them alike (see cpu_backend/mass_spring/cloth/sums.py):
LANES = 32  # running sums of a segment
SEGMENT = 256  # columns at most
TREE = 256  # running sums of all segments
SUMS = 3  # at most, at a time


def segments_of(rows: int, columns: int) -> int:
    """Segments of a sheet."""
    return rows * -(-columns // SEGMENT)


def without_dampers(parts: frozenset[str]) -> frozenset[str]:
    """The parts that change a kernel's code: dampers are in every system, with a coefficient of 0 where there is none."""
    return frozenset(part for part in parts if not part.endswith("damping"))
