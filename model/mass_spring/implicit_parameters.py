"""The constants of implicit Euler's matrix: a record like the cloth's, with every entry as the matrix has it.

A spring's three constants lie where `model/mass_spring/cloth_parameters.py` has them, times dt^2 (stiffness) or dt
(damping); some entries that the matrix has no use for hold what it needs besides.
"""

from __future__ import annotations

import numpy as np

from model.core.parameters import rounded_record
from model.mass_spring.cloth_parameters import (
    C_DAMPING,
    C_DT,
    C_GUST,
    C_GUST_TIME,
    C_INVERSE_DAMPING,
    CLOTH_PARAMETERS,
    FIELDS,
    cloth_values,
)  # fmt: skip
from model.scene.cloth import SPRING_KINDS
from model.scene.scene import Scene

S_DT = C_DT  # s
S_OWN = C_INVERSE_DAMPING  # 1 + dt rate: a mass's entry without springs
S_RATE = C_DAMPING  # dt rate
S_SPRINGS = C_GUST  # of all masses, squared: the speed [m/s] that springs of twice their length would give in a step
S_ROUNDOFF = C_GUST_TIME  # half of the distance from 1 to the next number


def system_record(scene: Scene, real: type) -> np.ndarray:
    """(len(CLOTH_PARAMETERS),) in the arithmetic `real`: computed in float64, rounded once. Raises SceneError."""
    dt = scene.method.dt
    given = cloth_values(scene, 1, (0.0, 0.0, 0.0))
    values = dict.fromkeys(CLOTH_PARAMETERS, 0.0)
    values["dt"] = dt
    for kind in SPRING_KINDS:
        values[kind] = dt * dt * given[kind]
        values[f"{kind}_rest"] = dt * dt * given[f"{kind}_rest"]
        values[f"{kind}_damping"] = dt * given[f"{kind}_damping"]
    values[CLOTH_PARAMETERS[S_RATE]] = dt * given["damping"]
    values[CLOTH_PARAMETERS[S_OWN]] = 1 + dt * given["damping"]
    speed = dt * 4 * sum(given[f"{kind}_rest"] for kind in SPRING_KINDS)
    values[CLOTH_PARAMETERS[S_SPRINGS]] = scene.grid.particle_count * speed**2
    values[CLOTH_PARAMETERS[S_ROUNDOFF]] = float(np.finfo(real).eps) / 2
    return rounded_record(scene, values, FIELDS, real)


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
