"""Causes of a divergence, or of a refused step size, and remedies with numbers, for `Diverged` and `UnstableTimeStep`.

A cause is a function that examines a Situation and returns its Diagnosis, or None where it does not apply. CAUSES lists
them by name, the most specific first; a solver with failures of its own passes `diagnose` a table of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, isfinite, log10, sqrt

import numpy as np

from softlab.model.base.errors import SceneError, UnstableTimeStep
from softlab.model.base.table import Part
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene

FAST = 0.5  # spacings per step: a faster mass passes its neighbours before their springs can deflect it
MUCH = 2.0  # another integrator is recommended if its step size is this many times as large
HALVINGS = 40  # bisections of the range of the largest stable ratio
LEAST_STEP = 1e-9  # s: shorter steps are useless, 1e9 to a second
LIGHT = ("mass", "density", "compliance")  # fields that allow longer steps the larger they are
STIFF = (  # fields that allow longer steps the smaller they are
    "stiffness",
    "link_stiffness",
    "cluster_stiffness",
    "young_modulus",
    "coefficient",
    "damping",
    "mass_damping",
)
FOLLOWS = {"stiffness": "compliance", "mass": "density"}  # in a part that has both
DECADES = 6  # decades from 1 within which a stable value of such a field is searched
ODD = 35.0  # decades from 1: numbers of float32 end at 38
ROUNDING = 1e-12  # of the limit: a step size that exceeds it by less does not count


@dataclass(frozen=True)
class Diagnosis:
    """A diagnosis: `cause` and `remedy`, each a clause of one line; `name`: of the cause, as in CAUSES."""

    cause: str
    remedy: str
    name: str = ""


@dataclass(frozen=True)
class Situation:
    """Input of the causes: a scene that diverged, or would, at its step size. `limit` [s]: the largest stable step size
    in any state; `position`, `velocity` (particles, dimensions) [m, m/s]: the last good state, None where there is
    none."""

    scene: Scene
    limit: float
    velocity: np.ndarray | None = None
    position: np.ndarray | None = None

    @property
    def dt(self) -> float:
        """Step size [s]."""
        return self.scene.method.dt

    @property
    def integrator(self) -> str:
        """Name of the integrator, or of the solver where it has none."""
        return self.scene.method.name

    @property
    def over(self) -> bool:
        """True if the step size exceeds the limit."""
        return self.dt > self.limit * (1 + ROUNDING)

    @cached_property
    def other(self) -> tuple[str, float]:
        """Return (integrator, dt [s]) with one force evaluation and the largest stable step size, except the
        hand-out's, which solves another equation."""
        able = [i for i in INTEGRATORS.values() if i.forces == 1 and i.order > 0]
        limits = {i.name: stability_limit(self.scene.replace({"method.integrator": i.name})) for i in able}
        best = max(able, key=lambda i: (limits[i.name], i.order))
        return best.name, limits[best.name]

    @property
    def remedy(self) -> str:
        """Remedy: the stable step size, and the integrator whose limit is much larger, if there is one."""
        remedy = f"use dt <= {self.limit:.6g} s"
        if self.scene.method.position_based:
            substeps = ceil(self.scene.method.substeps * self.dt / self.limit)
            return f"{remedy}, or --set method.substeps={substeps}: the masses' dampers are explicit"
        name, largest = self.other
        if largest > MUCH * self.limit:
            remedy += f", or {name}, which holds to {largest:.6g} s (--set method.integrator={name})"
        return remedy

    @cached_property
    def displacement(self) -> float:
        """Displacement per step of the fastest mass of the last good state [spacings]; 0 where that is not known."""
        if self.velocity is None or not len(self.velocity):
            return 0.0
        displacement = float(np.abs(self.velocity.astype(np.float64)).max()) * self.dt / self.scene.grid.spacing
        return displacement if isfinite(displacement) else 0.0

    @property
    def under(self) -> str:
        """Clause on a step size below the limit."""
        if not isfinite(self.limit):
            return "no linear limit is known for it"
        return f"dt is under the linear limit of {self.limit:.6g} s"


Cause = Callable[[Situation], Diagnosis | None]


def beyond_numbers(at: Situation) -> Diagnosis | None:
    """Diagnose a squared frequency of a spring, stiffness over mass, that overflows: every integrator's limit is 0."""
    if at.limit > 0 or at.scene.method.position_based or at.other[1] > 0:
        return None
    sheet = at.scene.name_of("grid", "cloth") or "grid"
    return Diagnosis(
        f"stiffness over mass is beyond the numbers of a computer here, so that no step size is stable; {sheet}.mass is "
        f"{at.scene.grid.mass:g} kg",
        "use a larger mass, or less stiffness",
    )


def no_usable_step(at: Situation) -> Diagnosis | None:
    """Diagnose stable steps that are too short to be used, because of the mass, density, stiffness or damper farthest
    from 1 in its unit with which the step size could be stable. The remedy is a power of ten for it."""
    if not at.over or at.limit >= LEAST_STEP:
        return None
    fields = [(name, field) for name, part in at.scene.parts.items() for field in _numbers_of(part)]
    values = {(name, field): float(getattr(at.scene.parts[name], field)) for name, field in fields}
    for (name, field), value in sorted(values.items(), key=lambda item: -abs(log10(item[1]))):
        holds = _power_that_holds(at.scene, f"{name}.{field}", value, field in LIGHT)
        if holds is not None:
            steps = f"steps of {at.limit:.3g} s" if at.limit > 0 else "steps shorter than any floating-point number"
            wrong, bound = ("small", "least") if field in LIGHT else ("large", "most")
            return Diagnosis(
                f"{name}.{field} = {value:g} is too {wrong}: {at.integrator} would need {steps}",
                f"use at {bound} {holds:g}, which holds (--set {name}.{field}={holds:g})",
            )
    return None


def no_step_size(at: Situation) -> Diagnosis | None:
    """Diagnose an integrator that is unstable at any step size: explicit Euler without a damper."""
    if at.limit > 0:
        return None
    name, largest = at.other
    return Diagnosis(
        f"{at.integrator} grows at every step size here",
        f"use {name} with dt <= {largest:.6g} s (--set method.integrator={name})",
    )


def stiffness_ratio(at: Situation) -> Diagnosis | None:
    """Diagnose a step size over the limit of the stiff springs, but not of the soft ones."""
    springs = at.scene.springs
    if not at.over or springs is None or not springs.alternate:
        return None
    soft = _limit_at(at.scene, 1.0)
    if at.dt > soft:
        return None
    ratio = _largest_ratio(at.scene)
    return Diagnosis(
        f"stiffness ratio {springs.stiffness_ratio:g}: dt is {at.dt / at.limit:.4g} times the stability limit of "
        f"{at.integrator}, which the springs of {springs.largest_stiffness:g} N/m set; those of {springs.stiffness:g} N/m "
        f"alone hold to {soft:.6g} s",
        f"{at.remedy}, or a stiffness ratio of at most {ratio:g}, which holds at {at.dt:g} s "
        f"(--set springs.stiffness_ratio={ratio:g})",
    )


def odd_number(at: Situation) -> Diagnosis | None:
    """Diagnose a number of the scene so far from 1 in its unit that a step cannot be computed with it."""
    candidates = []
    for name, table in at.scene.as_dict().items():
        for field, value in table.items() if isinstance(table, dict) else ():
            numbers = value if isinstance(value, list | tuple) else [value]
            candidates += [(abs(log10(abs(x))), f"{name}.{field}", x) for x in numbers if isinstance(x, float) and x]
    decades, field, value = max(candidates, default=(0.0, "", 0.0))
    if decades < ODD:
        return None
    return Diagnosis(f"no step can be computed with {field} = {value:g}", "use a number nearer to 1")


def over_the_limit(at: Situation) -> Diagnosis | None:
    """Diagnose a step size above the explicit limit."""
    if not at.over:
        return None
    return Diagnosis(f"dt is {at.dt / at.limit:.4g} times the stability limit of {at.integrator}", at.remedy)


def fast_masses(at: Situation) -> Diagnosis | None:
    """Diagnose a step size below the limit at which a mass passes its neighbours before their springs can deflect
    it."""
    if at.displacement <= FAST:
        return None
    return Diagnosis(
        f"{at.under}, but a mass moved {at.displacement:.3g} spacings a step in the last good state",
        f"use dt <= {at.dt * FAST / at.displacement:.3g} s, or weaker forces",
    )


def violent_forces(at: Situation) -> Diagnosis:
    """Diagnose the remaining cases."""
    return Diagnosis(
        f"{at.under}, so the forces on it are too violent", f"use dt <= {at.dt / 2:.6g} s, or weaker forces"
    )


CAUSES: dict[str, Cause] = {
    "beyond numbers": beyond_numbers,
    "no usable step": no_usable_step,
    "no step size": no_step_size,
    "stiffness ratio": stiffness_ratio,
    "odd number": odd_number,
    "explicit limit": over_the_limit,
    "fast masses": fast_masses,
    "violent forces": violent_forces,
}


def diagnose(
    scene: Scene,
    limit: float,
    velocity: np.ndarray | None = None,
    position: np.ndarray | None = None,
    causes: Mapping[str, Cause] = CAUSES,
) -> Diagnosis:
    """Return the diagnosis of a scene that diverged at its step size, from the first of `causes` that applies. `limit`,
    `velocity`, `position`: see Situation."""
    at = Situation(scene, limit, velocity, position)
    for name, cause in causes.items():
        diagnosis = cause(at)
        if diagnosis is not None:
            return Diagnosis(diagnosis.cause, diagnosis.remedy, name)
    return Diagnosis("the cause is unknown", f"use dt <= {at.dt / 2:.6g} s")


def refusal(scene: Scene) -> UnstableTimeStep | None:
    """Return the error for a scene whose step size exceeds its limit when it is opened; None where it is stable."""
    limit = stability_limit(scene)
    at = Situation(scene, limit)
    if not at.over:
        return None
    diagnosis = beyond_numbers(at) or no_usable_step(at) or stiffness_ratio(at)
    clauses = (diagnosis.cause, diagnosis.remedy) if diagnosis else ()
    return UnstableTimeStep(at.dt, limit, at.integrator, *clauses)


def _numbers_of(part: Part) -> list[str]:
    """Return the fields of LIGHT and STIFF of a part that are over 0, without those that follow from another of them: a
    stiffness from a compliance, a mass from a density."""
    positive = [field for field in (*LIGHT, *STIFF) if (getattr(part, field, None) or 0) > 0]
    follow = [field for field, cause in FOLLOWS.items() if cause in positive]
    return [field for field in positive if field not in follow]


def _power_that_holds(scene: Scene, path: str, value: float, light: bool) -> float | None:
    """Return the power of ten next to `value`, larger if `light`, else smaller, with which the scene's step size is
    stable; None where there is none within DECADES of 1."""
    sign = 1 if light else -1
    near, far = floor(sign * log10(value)), DECADES

    def holds(power: int) -> bool:
        try:
            changed = scene.replace({path: float(f"1e{sign * power}")})
        except SceneError:  # another rule forbids the value
            return False
        return scene.method.dt <= stability_limit(changed)

    if near >= far or not holds(far):
        return None
    while far - near > 1:
        middle = (near + far) // 2
        near, far = (near, middle) if holds(middle) else (middle, far)
    return float(f"1e{sign * far}")


def _limit_at(scene: Scene, ratio: float) -> float:
    """Return the largest stable step size [s] of the scene with this stiffness ratio."""
    return stability_limit(scene.replace({"springs.stiffness_ratio": ratio}))


def _largest_ratio(scene: Scene) -> float:
    """Return the largest stiffness ratio, to three digits, at which the scene's step size is stable."""
    assert scene.springs is not None
    low, high = 1.0, scene.springs.stiffness_ratio
    for _ in range(HALVINGS):
        middle = sqrt(low * high)
        if scene.method.dt <= _limit_at(scene, middle):
            low = middle
        else:
            high = middle
    unit = 10.0 ** (floor(log10(low)) - 2)
    return max(1.0, float(f"{floor(low / unit) * unit:.3g}"))
