"""Constants for a cloth's kernels: one record, and rows for colliders and for moving pins.

Constants that a grid has, too, have the names of the grid's record.
"""

from __future__ import annotations

from math import hypot, pi, sqrt

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.errors import SceneError, naming
from softlab.model.base.types import Real
from softlab.model.base.variant import plain_formulas
from softlab.model.core.build import Body
from softlab.model.core.integrators import damping_rate
from softlab.model.core.own_forces import force_fields, force_names, force_values
from softlab.model.core.parameters import PARAMETERS as GRID_PARAMETERS
from softlab.model.core.parameters import require_representable, rounded_record
from softlab.model.formulas import cloth as formulas_of_cloth
from softlab.model.formulas import motion
from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS, SURFACE_KINDS
from softlab.model.tables.colliders.surface_collider import SurfaceCollider
from softlab.model.tables.motion import motions_of_pins

CLOTH_PARAMETERS = (
    *GRID_PARAMETERS[:7],  # dt [s], values that follow from it, and the origin of time
    "damping",  # of the mass, 1/s
    "inverse_damping",  # 1 / (1 + dt rate / 2)
    "gravity",  # m/s^2, along +y (so negative)
    *force_names(3),  # of forces on a mass alone, over mass, m/s^2
    "structural",  # spring stiffness over mass, 1/s^2
    "structural_rest",  # times the rest length, m/s^2
    "structural_damping",  # of the spring, coefficient over mass, 1/s
    "shear",
    "shear_rest",
    "shear_damping",
    "bending",
    "bending_rest",
    "bending_damping",
    "wind_x",  # m/s, without gusts
    "wind_y",
    "wind_z",
    "drag",  # density / 2 * coefficient / mass / 6, 1/m^2
    "lift",
    "gust",  # of the wind, in [0, 1]
    "gust_time",  # s
)
FIELDS = {
    "dt": "method.dt",
    "half_dt_squared": "method.dt",
    "damping": "damping.coefficient",
    "gravity": "gravity.acceleration",
    **force_fields(),
    **{kind: f"{kind}.stiffness" for kind in ("structural", "shear", "bending")},
    **{f"{kind}_rest": f"{kind}.stiffness" for kind in ("structural", "shear", "bending")},
    **{f"{kind}_damping": f"{kind}.damping" for kind in ("structural", "shear", "bending")},
    **{f"wind_{axis}": "wind.velocity" for axis in "xyz"},
    "drag": "wind.drag",
    "lift": "wind.lift",
    "gust_time": "wind.gust_time",
}
REST_LENGTHS = {"structural": 1.0, "shear": sqrt(2), "bending": 2.0}  # rest length over spacing


def spring_constants(kind: str) -> tuple[str, str, str]:
    """Return the names of a kind's constants in the record: stiffness, rest length (times stiffness), damping."""
    return kind, f"{kind}_rest", f"{kind}_damping"


# Row of a collider, lengths in m and speeds in m/s, at time 0:
COLLIDER_FIELDS = 17
(
    B_X,  # a point of the plane, the centre, the capsule's start, or the mesh's origin
    B_Y,
    B_Z,
    B_U,  # the plane's unit normal, from the capsule's start to its end, half the box's edges, or the mesh's axis of spin
    B_V,
    B_W,
    B_RADIUS,
    B_VX,  # velocity
    B_VY,
    B_VZ,
    B_THICKNESS,
    B_STATIC,  # coefficients of friction
    B_DYNAMIC,
    B_SPIN,  # of a mesh, rad/s
    B_TURNS,  # 1/s
    B_TREE,  # index of its tree or its field, relative to its row
    B_RESTITUTION,
) = range(COLLIDER_FIELDS)


# Row of a motion:
MOTION_FIELDS = 13
(
    M_X,  # the initial centre, m
    M_Y,
    M_Z,
    M_U,  # unit axis
    M_V,
    M_W,
    M_VX,  # of the centre, m/s
    M_VY,
    M_VZ,
    M_SPIN,  # rad/s
    M_TURNS,  # 1/s
    M_START,  # s
    M_DURATION,
) = range(MOTION_FIELDS)

# Row of a pinned mass:
PIN_FIELDS = 4
(
    P_X,  # rest position, m
    P_Y,
    P_Z,
    P_MOTION,  # index of the row of its motion in `body_rows`, -1 for none
) = range(PIN_FIELDS)


def cloth_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return CLOTH_PARAMETERS in the arithmetic `real`, (1,): computed in float64, rounded once. Raises SceneError."""
    return rounded_record(scene, cloth_values(scene, 1, poke, clock), FIELDS, real)


def cloth_values(scene: Scene, substeps: int, poke: tuple[float, ...], clock: Clock = START) -> dict[str, float]:
    """Return CLOTH_PARAMETERS by name, in float64, for `substeps` substeps per step; for a grid those that it has."""
    cloth, wind, dt = scene.grid, scene.wind, scene.method.dt / substeps
    mass, rate = cloth.mass, damping_rate(scene)
    values = {
        "dt": dt,
        "half_dt": dt / 2,
        "half_dt_squared": dt * dt / 2,
        "sixth_dt": dt / 6,
        "third_dt": dt / 3,
        **clock.values(dt, substeps),
        "damping": rate,
        "inverse_damping": 1 / (1 + dt * rate / 2),
        "gravity": -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0,
        **force_values(scene, poke, 3),
    }
    for kind, rest_length in REST_LENGTHS.items():
        springs = scene.cloth_springs.get(kind)
        stiffness = springs.stiffness / mass if springs else 0.0
        values[kind] = stiffness
        values[f"{kind}_rest"] = stiffness * rest_length * cloth.spacing
        values[f"{kind}_damping"] = springs.damping / mass if springs else 0.0
    velocity = wind.velocity if wind else (0.0, 0.0, 0.0)
    values |= {f"wind_{axis}": speed for axis, speed in zip("xyz", velocity, strict=True)}
    corner = wind.density / 2 / mass / 6 if wind else 0.0
    values["drag"] = corner * wind.drag if wind else 0.0
    values["lift"] = corner * wind.lift if wind else 0.0
    values["gust"] = wind.gust if wind else 0.0
    values["gust_time"] = wind.gust_time if wind else 1.0
    assert tuple(values) == CLOTH_PARAMETERS, f"{set(values) ^ set(CLOTH_PARAMETERS)} or their order differ"
    return values


def collider_rows(scene: Scene, real: Real) -> np.ndarray:
    """Return the rows of colliders, (colliders, COLLIDER_FIELDS), in the arithmetic `real`, in the order of
    `scene.colliders`.

    B_TREE is 0. Raises SceneError for a number that the arithmetic cannot represent.
    """
    for name, kind in scene.kinds.items():
        if kind in COLLIDER_KINDS:
            require_representable(name, scene.parts[name], real)
    rows = np.zeros((len(scene.colliders), COLLIDER_FIELDS))
    for row, (kind, collider) in zip(rows, scene.colliders, strict=True):
        part = collider.model_dump()
        row[B_X : B_Z + 1] = part.get("center") or part.get("point") or part.get("origin") or part["start"]
        if kind == "plane":
            row[B_U : B_W + 1] = np.array(part["normal"]) / norm(part["normal"])
        elif kind == "capsule":
            row[B_U : B_W + 1] = np.subtract(part["end"], part["start"])
        elif kind == "box":
            row[B_U : B_W + 1] = part["half_size"]
        elif kind in SURFACE_KINDS:
            speed = hypot(*part["spin"])
            row[B_U : B_W + 1] = np.array(part["spin"]) / (speed or 1.0)
            row[B_SPIN], row[B_TURNS] = speed, speed / (2 * pi)
        row[B_RADIUS] = part.get("radius", 0.0)
        row[B_VX : B_VZ + 1] = part["velocity"]
        row[B_THICKNESS] = part["thickness"]
        row[B_STATIC], row[B_DYNAMIC] = part["static_friction"], part["dynamic_friction"]
        row[B_RESTITUTION] = collider.restitution
    return rows.astype(real)


def collider_numbers(scene: Scene, real: Real) -> np.ndarray:
    """Return `collider_rows` followed by the numbers of colliders made from meshes, flat.

    Raises SceneError (more numbers than the arithmetic can count, or a field that cannot be sampled), InputError (a
    file without a mesh).
    """
    rows = collider_rows(scene, real)
    end, most = rows.size, 2 ** (np.finfo(real).nmant + 1)  # integers are exact up to there
    surfaces = scene.parts_of(SurfaceCollider)
    names = [name for surface_kind in SURFACE_KINDS for name in surfaces if scene.kinds[name] == surface_kind]
    numbers = []
    for row, name in enumerate(names, len(rows) - len(names)):
        rows[row, B_TREE] = end - row * COLLIDER_FIELDS
        with naming(name):
            end += surfaces[name].number_count
            if end + MOTION_FIELDS * len(scene.motions) > most:
                field, value, remedy = surfaces[name].too_many()
                raise SceneError(field, value, f"{np.dtype(real).name} counts to {most}, and {remedy}")
            numbers.append(surfaces[name].numbers(real))
    return np.concatenate([rows.reshape(-1), *numbers])


def motion_rows(scene: Scene, real: Real) -> np.ndarray:
    """Return the rows of motions, (motions, MOTION_FIELDS), in the arithmetic `real`, in the order of `scene.motions`.

    Raises SceneError.
    """
    rows = np.zeros((len(scene.motions), MOTION_FIELDS))
    for row, (name, part) in zip(rows, scene.motions.items(), strict=True):
        row[M_X : M_Z + 1] = part.center
        row[M_U : M_W + 1] = np.array(part.axis) / hypot(*part.axis)
        row[M_VX : M_VZ + 1] = part.velocity
        row[M_SPIN], row[M_TURNS] = part.angular_velocity, part.angular_velocity / (2 * pi)
        row[M_START], row[M_DURATION] = part.start, part.duration
        if not np.abs(row).max() <= np.finfo(real).max:
            raise SceneError(name, float(np.abs(row).max()), f"{np.dtype(real).name} cannot hold it; use float64")
    return rows.astype(real)


def pin_rows(scene: Scene, body: Body, real: Real, first: int) -> np.ndarray:
    """Return the rows of pins, (pins, PIN_FIELDS), in the arithmetic `real`, in the order of `body.pinned`.

    Rows of motions begin at `first`.
    """
    rows = np.empty((len(body.pinned), PIN_FIELDS))
    rows[:, :P_MOTION] = body.position[body.pinned]  # pinned masses start at rest
    numbers = motions_of_pins(scene.grid, scene.motions)
    rows[:, P_MOTION] = np.where(numbers < 0, -1, first + numbers * MOTION_FIELDS)
    return rows.astype(real)


def body_rows(scene: Scene, body: Body, real: Real) -> tuple[np.ndarray, int]:
    """Return (colliders and pins, flat: `collider_numbers`, then rows of motions, then of pins; index of the first
    pin).

    Without motions there are no rows of motions and pins.
    """
    colliders = collider_numbers(scene, real)
    if not any(part.moves for part in scene.motions.values()):
        return colliders, 0
    motions, pins = motion_rows(scene, real), pin_rows(scene, body, real, colliders.size)
    return np.concatenate([array.reshape(-1) for array in (colliders, motions, pins)]), colliders.size + motions.size


def pin_velocity(bodies: np.ndarray, first: int, pins: int, step: int, record: np.ndarray) -> np.ndarray:
    """Return the velocity of the pinned masses at the start of `step`, (pins, 3) [m/s], in the arithmetic of `bodies`.

    It has the bits of `exact` kernels. `bodies`, `first`: from `body_rows`. Loaded states get it, since kernels read
    velocities of pins before they write them.
    """
    real = bodies.dtype.type
    formulas, instant = plain_formulas(motion, real), plain_formulas(formulas_of_cloth, real).instant
    clock = record[0]
    time = instant(step, clock.dt, clock.first_step, clock.first_time)
    rows = bodies[first : first + pins * PIN_FIELDS].reshape(pins, PIN_FIELDS)
    velocity = np.zeros((pins, 3), bodies.dtype)
    for place in np.unique(rows[:, P_MOTION]):
        if place >= 0:
            row, moving = bodies[int(place) :], rows[:, P_MOTION] == place
            now = formulas.turn(time, row[M_START], row[M_DURATION], row[M_TURNS])
            centre, axis, drift = row[M_X : M_Z + 1], row[M_U : M_W + 1], row[M_VX : M_VZ + 1]
            moved = formulas.placed(rows[moving, :P_MOTION].T, centre, axis, drift, row[M_SPIN], now)
            velocity[moving] = np.stack(np.broadcast_arrays(*moved), axis=1)[:, 3:]
    return velocity
