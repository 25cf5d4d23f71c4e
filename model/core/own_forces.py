"""Forces that depend on one particle alone, not on its neighbours: written once for both backends, for two axes and
three.

A new one is an entry of PARTICLE_FORCES: every plan gets its part and stage from it, and every record its constants. Kernels
call the formula `accelerated` and do not depend on which forces there are, separate or fused, on threads or on CUDA.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softlab.model.base.types import Feature
from softlab.model.base.variant import FEATURE, Open, check_returns, filled, formula
from softlab.model.core.plan import Plan
from softlab.model.formulas.distance import added
from softlab.model.formulas.random import OPERATIONS, add_external, philox
from softlab.model.scene.scene import Scene

# indices into the integers that kernels read; POKED: 1 + the particle, 0 for none; FIRST: window's first particle
# (grids)
EXTERNAL_SEED, POKED, FIRST = 0, 1, 2
WINDOW = "window"  # the part of a plan whose particles are not numbered from the sheet's first


@dataclass(frozen=True)
class OwnForce:
    """A force on one particle.

    `part`: of the plan, present where `present(scene, live)`; `stage`: its name. `force(k, parameters, integers, step)`: a
    formula, its acceleration of particle k [m/s^2], a tuple of FEATURE.axes numbers, for the sheet's mass. `names`: names
    of its constants in the kernels; `values(scene, poke, axes)`: these in float64, `poke` the applied force [N]; `field`:
    the scene's field that they follow from. `traffic`: numbers per mass and axis that its stage reads and writes;
    `operations`: per mass. `changes`: True if it depends on the step number, so that velocity Verlet's two adjacent kicks
    each need their own.
    """

    part: str
    stage: str
    present: Callable[[Scene, frozenset[str]], bool]
    force: Callable[..., tuple[float, ...]]
    names: tuple[str, ...]
    values: Callable[[Scene, Sequence[float], int], dict[str, float]]
    field: str
    operations: int = 0
    traffic: int = 0
    changes: bool = False

    def __post_init__(self) -> None:
        for axes in (2, 3):
            check_returns(self.force, axes, {"axes": axes})


@formula
def external(k, parameters, integers, step):
    """Random force, uniform in (-1, 1) per axis times the magnitude; see model/formulas/random.py."""
    words, most = philox(integers[EXTERNAL_SEED], np.uint64(step), np.uint64(k)), parameters.external
    x, y = add_external(0.0, most, words[0]), add_external(0.0, most, words[1])
    if FEATURE.axes == 2:
        return x, y
    return x, y, add_external(0.0, most, words[2])


@formula
def poke(k, parameters, integers, step):
    """Force that acts on one particle until it is released."""
    poked = np.int64(integers[POKED]) == k + 1  # explicit int64: mixed integer kinds would be converted to doubles
    x, y = parameters.poke_x if poked else 0.0, parameters.poke_y if poked else 0.0
    if FEATURE.axes == 2:
        return x, y
    return x, y, parameters.poke_z if poked else 0.0


def _external_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    return {"external": scene.external.magnitude / scene.grid.mass if scene.external else 0.0}


def _poke_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    return {f"poke_{axis}": force / scene.grid.mass for axis, force in zip("xyz"[:axes], poke, strict=True)}


PARTICLE_FORCES = (
    OwnForce(
        "external",
        "external force",
        lambda scene, live: scene.external is not None and scene.external.magnitude > 0,
        external,
        ("external",),
        _external_values,
        "external.magnitude",
        operations=OPERATIONS,
        traffic=1,
        changes=True,
    ),
    OwnForce(
        "poke", "poke", lambda scene, live: "poke" in live, poke, ("poke_x", "poke_y", "poke_z"), _poke_values, "poke"
    ),
)


def force_features(scene: Scene, live: frozenset[str]) -> set[str]:
    """Return the parts of the forces that the scene has, or that may be switched on."""
    return {force.part for force in PARTICLE_FORCES if force.present(scene, live)}


def force_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    """Return the constants of all these forces over mass [m/s^2], 0 where the scene has none."""
    values: dict[str, float] = {}
    for force in PARTICLE_FORCES:
        values |= force.values(scene, poke, axes)
    return values


def force_names(axes: int) -> tuple[str, ...]:
    """Return the names of the constants."""
    return tuple(name for force in PARTICLE_FORCES for name in force.names if axes == 3 or not name.endswith("_z"))


def force_fields() -> dict[str, str]:
    """Return the scene's field that each constant follows from."""
    return {name: force.field for force in PARTICLE_FORCES for name in force.names}


def particle_forces(parts: frozenset[str]) -> tuple[OwnForce, ...]:
    """Return the forces on single particles that `parts` names, in the order in which they are added."""
    return tuple(force for force in PARTICLE_FORCES if force.part in parts)


def particle_forces_change(parts: frozenset[str]) -> bool:
    """Return True if one of them depends on the step number."""
    return any(force.changes for force in particle_forces(parts))


@formula
def add(a, weight, f):
    """The sum of the acceleration `a` and `f` [m/s^2], which is multiplied by the `weight` where the scene has a `load`."""
    if FEATURE.axes == 2:
        if FEATURE.load:
            return added(a[0], weight, f[0]), added(a[1], weight, f[1])
        return a[0] + f[0], a[1] + f[1]
    if FEATURE.load:
        return added(a[0], weight, f[0]), added(a[1], weight, f[1]), added(a[2], weight, f[2])
    return a[0] + f[0], a[1] + f[1], a[2] + f[2]


before = Open("before(a, k, weight, parameters, integers, step): the acceleration by the forces before this one")
force = Open("force(k, parameters, integers, step): of an OwnForce")


@formula
def unforced(a, k, weight, parameters, integers, step):
    return a


@formula
def with_force(a, k, weight, parameters, integers, step):
    return add(before(a, k, weight, parameters, integers, step), weight, force(k, parameters, integers, step))


@formula
def in_sheet(a, k, weight, parameters, integers, step):
    """The same force for particles that are numbered in a window."""
    return before(a, np.int64(k) + np.int64(integers[FIRST]), weight, parameters, integers, step)


def accelerated(parts: frozenset[str]) -> Callable[..., tuple[float, ...]]:
    """Return the formula (a, k, weight, parameters, integers, step) -> the acceleration `a` of particle k plus these
    forces. `a`: FEATURE.axes numbers [m/s^2]; `weight`: the sheet's mass over the particle's, where the scene has a
    `load`."""
    result: Callable[..., tuple[float, ...]] = unforced
    for each in particle_forces(parts):
        result = filled(with_force, {"before": result, "force": each.force})
    return filled(in_sheet, {"before": result}) if WINDOW in parts else result


def force_flags(axes: int, parts: frozenset[str]) -> dict[str, Feature]:
    """Return the features of the formulas above."""
    return {"axes": axes, "load": "load" in parts}


def in_window(plan: Plan, first_particle: int | None) -> Plan:
    """Return the plan for particles of a window that begins with `first_particle` of the sheet (None: the whole sheet).

    Only a force that uses particle numbers makes a difference.
    """
    if first_particle is None or not particle_forces(plan.parts):
        return plan
    return replace(plan, parts=plan.parts | {WINDOW})
