"""The record of constants that every kernel reads. They are computed in float64 and rounded once, the same on every
backend."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.errors import SceneError
from softlab.model.base.table import Part
from softlab.model.base.types import Real
from softlab.model.core.integrators import damping_rate
from softlab.model.core.own_forces import force_fields, force_names, force_values
from softlab.model.scene.scene import Scene

PARAMETERS = (
    "dt",  # s
    "half_dt",
    "half_dt_squared",
    "sixth_dt",
    "third_dt",
    "first_step",  # origin of time, a step number,
    "first_time",  # and that step's time, s
    "stiffness",  # spring stiffness over mass, 1/s^2
    "stiffness_rest",  # times the rest length, m/s^2
    "damping",  # damping rate, 1/s
    "inverse_damping",  # 1 / (1 + dt rate / 2)
    "gravity",  # m/s^2, along +y (so negative)
    *force_names(2),  # of forces on a mass alone, over mass, m/s^2
    "stiff",  # stiffness of every second spring over mass, 1/s^2
    "stiff_rest",  # times the rest length, m/s^2
)
ODD = 20.0  # decades that a mass must be farther from 1 than the field itself, to be named as the cause
FIELDS = {  # the scene's field, by the value that follows from it
    "dt": "method.dt",
    "half_dt_squared": "method.dt",
    "stiffness": "springs.stiffness",
    "stiffness_rest": "springs.rest_length",
    "damping": "damping.coefficient",
    "gravity": "gravity.acceleration",
    **force_fields(),
    "stiff": "springs.stiffness_ratio",
    "stiff_rest": "springs.stiffness_ratio",
}


def parameter_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return the record of constants that every kernel reads: (1,), a field for each of PARAMETERS, in the arithmetic
    `real`.

    Computed in float64 and rounded once, so that both backends use the same bits. Raises SceneError for a value that
    the arithmetic cannot represent (it overflows, or vanishes where it must not).
    """
    springs, dt, mass = scene.springs, scene.method.dt, scene.grid.mass
    rate = damping_rate(scene)
    values = {
        "dt": dt,
        "half_dt": dt / 2,
        "half_dt_squared": dt * dt / 2,
        "sixth_dt": dt / 6,
        "third_dt": dt / 3,
        **clock.values(dt),
        "stiffness": springs.stiffness / mass if springs else 0.0,
        "stiffness_rest": springs.stiffness * springs.rest_length / mass if springs else 0.0,
        "damping": rate,
        "inverse_damping": 1 / (1 + dt * rate / 2),
        "gravity": -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0,
        **force_values(scene, poke, 2),
        "stiff": springs.largest_stiffness / mass if springs else 0.0,
        "stiff_rest": springs.largest_stiffness * springs.rest_length / mass if springs else 0.0,
    }
    assert tuple(values) == PARAMETERS, f"{set(values) ^ set(PARAMETERS)} or their order differ"
    return rounded_record(scene, values, FIELDS, real)


def rounded_record(scene: Scene, values: Mapping[str, float], fields: Mapping[str, str], real: Real) -> np.ndarray:
    """Return `values` (name -> float64) as a record in the arithmetic `real`, (1,), in their order.

    `fields`: the scene's field that a value follows from. Raises SceneError for a value that the arithmetic cannot
    represent.
    """
    limits = np.finfo(real)
    record: np.ndarray = np.zeros(1, record_type(tuple(values), real))
    with np.errstate(over="ignore", under="ignore"):
        for name, exact in values.items():
            record[name] = exact
            rounded = float(record[0][name])
            if name in fields and (not math.isfinite(rounded) or (exact != 0 and abs(rounded) < float(limits.tiny))):
                field, value = _oddest(scene, fields[name], exact)
                other = "" if field != fields[name] else " (or the mass)"
                raise SceneError(
                    field,
                    value,
                    f"{name} = {exact:.3g} is outside what {np.dtype(real).name} can hold "
                    f"({float(limits.tiny):.2g} to {float(limits.max):.2g}); change it{other}, or use float64",
                )
    return record


def require_representable(name: str, part: Part, real: Real) -> None:
    """Raise SceneError for the first number of a scene's part that is too large for the arithmetic `real`."""
    largest = float(np.finfo(real).max)
    for field, value in part.model_dump().items():
        numbers = value if isinstance(value, list | tuple) else [value]
        if any(isinstance(number, float) and abs(number) > largest for number in numbers):
            reason = f"is more than {np.dtype(real).name} can hold ({largest:.2g}); use a smaller number, or float64"
            raise SceneError(f"{name}.{field}", list(value) if isinstance(value, tuple) else value, reason)


def _oddest(scene: Scene, field: str, exact: float) -> tuple[str, object]:
    """Return (field, its value) to blame for a constant that cannot be represented.

    It is `field`, from which the constant follows, or a mass or a density of the scene where one is farther from 1 in
    its unit, as constants follow from masses, too.
    """
    tables = scene.as_dict()
    part, _, key = field.partition(".")
    value = tables.get(part, {}).get(key, exact)
    candidates = [(_decades(value), field, value)]
    for name, table in tables.items():
        for mass in ("mass", "density", "spacing") if isinstance(table, dict) else ():
            one = table.get(mass)
            if isinstance(one, float) and one != 1.0:
                candidates.append((_decades(one), f"{name}.{mass}", one))
    worst = max(candidates, key=lambda one: one[0])
    return (field, value) if worst[0] <= candidates[0][0] + ODD else worst[1:]


def _decades(value: object) -> float:
    """Return the distance of a number from 1 in powers of ten; 0 for 0 and for values that are not finite numbers."""
    return abs(math.log10(abs(value))) if isinstance(value, int | float) and value and math.isfinite(value) else 0.0


@cache
def record_type(names: tuple[str, ...], real: Real) -> np.dtype:
    """Return the structured type of such a record. It is aligned: without alignment, compilers read single bytes."""
    taken = set(names) & set(dir(np.record))
    assert not taken, f"{taken}: attributes of every record of numpy"
    return np.dtype((np.record, np.dtype([(name, real) for name in names], align=True)))
