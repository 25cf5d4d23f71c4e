"""Constants for the kernels of position-based solvers, per substep: those of a cloth, and those of its constraints.

The constants of model/contact/cloth_parameters.py are included, computed for the substep instead of the step. Grids
have them too: forces and colliders read them under these names.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.model.assets.clusters import matching_factor
from softlab.model.base.clock import START, Clock
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS, FIELDS, REST_LENGTHS, cloth_values
from softlab.model.core.integrators import damping_rate
from softlab.model.core.parameters import rounded_record
from softlab.model.core.stability.springs import matching_stiffness
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import CONSTRAINT_KINDS

OF_SHEETS = ("structural", "stiff", "shear", "bending")  # stiff: every second structural one, where a grid's alternate
CONSTRAINTS = (*OF_SHEETS, *(kind for kind in CONSTRAINT_KINDS if kind not in OF_SHEETS))


class Constants(NamedTuple):
    """Constants of a kind of constraints."""

    rest: float  # m
    compliance: float  # alpha m / h^2, dimensionless; 0: inextensible
    damping: float  # gamma = alpha beta / h
    stiffening: float  # 1 + gamma; in PBD 1 / stiffness
    both: float  # 1 / (2 stiffening + compliance): the reciprocal between two free masses with the sheet's mass
    one: float  # the same with one of them pinned


CONSTANTS = Constants._fields
NAMES = {kind: tuple(f"constraint_{kind}_{constant}" for constant in CONSTANTS) for kind in CONSTRAINTS}
XPBD_PARAMETERS = (
    "inverse_substep",  # 1/h, 1/s
    "keep",  # damping factor of a velocity in a substep: 1 - h c / m
    "braking",  # h c / m
    *(name for kind in CONSTRAINTS for name in NAMES[kind]),
    "matching",  # fraction of the displacement to the goals of their clusters by which masses move per iteration
    "matching_rest",  # m, between neighbours of a cluster at rest
    *CLOTH_PARAMETERS,  # last: numba would take a record that begins as a cloth's for one, and warn
)


SOLVER_FIELDS = {  # the scene's field, by the value that follows from it
    "inverse_substep": "method.dt",
    "braking": "damping.coefficient",
    **{f"constraint_{kind}_compliance": f"{kind}.stiffness" for kind in CONSTRAINT_KINDS},
    "constraint_stiff_compliance": "springs.stiffness_ratio",
    "matching": "springs.stiffness",
}
XPBD_FIELDS = FIELDS | SOLVER_FIELDS


def constraint_constants(scene: Scene, kind: str) -> tuple[float, ...]:
    """Return the CONSTANTS of a kind of constraints, in float64; 0 where the scene has none of it."""
    grid, method = scene.grid, scene.method
    if scene.springs and kind in ("structural", "stiff"):
        softness = scene.springs.softness(scene.springs.stiffness_ratio if kind == "stiff" else 1.0)
        rest, damping = scene.springs.rest_length, 0.0
    elif kind in scene.constraints:
        part = scene.constraints[kind]
        softness, damping = part.softness(), getattr(part, "damping", 0.0)
        rest = REST_LENGTHS.get(kind, 0.0) * grid.spacing
    else:
        return (0.0,) * len(CONSTANTS)
    h = method.dt / method.substeps
    compliance, gamma, stiffening = softness * grid.mass / h**2, softness * damping / h, 1 / method.pbd_stiffness
    if method.solver == "pbd":
        compliance = gamma = 0.0
    stiffening += gamma
    return rest, compliance, gamma, stiffening, 1 / (2 * stiffening + compliance), 1 / (stiffening + compliance)


def constants_of(record: np.ndarray, kind: str) -> Constants:
    """Return the constants of a kind of constraints, from a record of these parameters."""
    return Constants(*(record[0][name] for name in NAMES[kind]))


def xpbd_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return XPBD_PARAMETERS in the arithmetic `real`, (1,): computed in float64, rounded once. Raises SceneError.

    `poke`: as many components [N] as the scene has dimensions.
    """
    return rounded_record(scene, xpbd_values(scene, poke, clock), XPBD_FIELDS, real)


def xpbd_values(scene: Scene, poke: tuple[float, ...], clock: Clock) -> dict[str, float]:
    """Return XPBD_PARAMETERS in float64."""
    h = scene.method.dt / scene.method.substeps
    braking = damping_rate(scene) * h
    values = {"inverse_substep": 1 / h, "keep": 1 - braking, "braking": braking}
    for kind in CONSTRAINTS:
        constants = constraint_constants(scene, kind)
        values |= {f"constraint_{kind}_{name}": value for name, value in zip(CONSTANTS, constants, strict=True)}
    method, matching = scene.method, 0.0
    if method.matches_shapes:
        matching = matching_factor(matching_stiffness(scene), h, method.iterations)
    rest = scene.springs.rest_length if scene.springs else scene.grid.spacing
    values |= {"matching": matching, "matching_rest": rest}
    values |= cloth_values(scene, scene.method.substeps, (*poke, 0.0)[:3], clock)
    assert tuple(values) == XPBD_PARAMETERS, f"{set(values) ^ set(XPBD_PARAMETERS)} or their order differ"
    return values
