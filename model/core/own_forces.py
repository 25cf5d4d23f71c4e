"""Forces that look at one particle alone, whatever its neighbours do: written once for both backends, for two axes and three.

A new one is an entry of OWN_FORCES: from it follow the part and the stage of every plan, and the constants of every record.
Kernels call `own` of `make_own` and do not know which forces there are, plain or fused, on threads or on CUDA.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from model.core.plan import Plan
from model.formulas import distance, random
from model.scene.scene import Scene

# places in the integers that kernels read; POKED: 1 + the particle, 0 for none; FIRST: particle of a window, of grids alone
EXTERNAL_SEED, POKED, FIRST = 0, 1, 2
WINDOW = "window"  # the part of a plan whose particles are not counted from the sheet's first
Made = Callable[[Callable[..., Any]], Any]  # what a backend makes of a factory of formulas


@dataclass(frozen=True)
class OwnForce:
    """`part`: of the plan, there where `present(scene, live)`; `stage`: its name.

    `make(real, compiled, made, axes)` -> force(k, parameters, integers, step): what it accelerates particle k by [m/s^2], a
    tuple of `axes` numbers, counted by the sheet's mass. `names`: of its constants, under which kernels read them;
    `values(scene, poke, axes)`: these in float64, `poke` the force held [N]; `field`: that of the scene which they follow
    from. `traffic`: numbers of a mass and axis that its stage reads and writes; `operations` of a mass. `changes`: with the
    number of the step, so that velocity Verlet's two kicks that meet have each their own.
    """

    part: str
    stage: str
    present: Callable[[Scene, frozenset[str]], bool]
    make: Callable[[Any, Any, Made, int], Any]
    names: tuple[str, ...]
    values: Callable[[Scene, Sequence[float], int], dict[str, float]]
    field: str
    operations: int = 0
    traffic: int = 0
    changes: bool = False


def _external(real: Any, compiled: Any, made: Made, axes: int) -> Any:
    """Uniform in (-1, 1) per axis times the magnitude; see model/formulas/random.py."""
    philox, external, zero = random.make_philox(compiled), made(random.make).add_external, real(0)

    @compiled
    def force(k, parameters, integers, step):
        words, most = philox(integers[EXTERNAL_SEED], np.uint64(step), np.uint64(k)), parameters.external
        x, y = external(zero, most, words[0]), external(zero, most, words[1])
        if axes == 2:
            return x, y
        return x, y, external(zero, most, words[2])

    return force


def _poke(real: Any, compiled: Any, made: Made, axes: int) -> Any:
    """A force that is held on one particle until it is let go."""
    zero = real(0)

    @compiled
    def force(k, parameters, integers, step):
        poked = np.int64(integers[POKED]) == k + 1  # as they are, the two kinds of integer would meet as doubles
        x, y = parameters.poke_x if poked else zero, parameters.poke_y if poked else zero
        if axes == 2:
            return x, y
        return x, y, parameters.poke_z if poked else zero

    return force


def _external_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    return {"external": scene.external.magnitude / scene.grid.mass if scene.external else 0.0}


def _poke_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    return {f"poke_{axis}": force / scene.grid.mass for axis, force in zip("xyz"[:axes], poke, strict=True)}


OWN_FORCES = (
    OwnForce(
        "external",
        "external force",
        lambda scene, live: scene.external is not None and scene.external.magnitude > 0,
        _external,
        ("external",),
        _external_values,
        "external.magnitude",
        operations=random.OPERATIONS,
        traffic=1,
        changes=True,
    ),
    OwnForce(
        "poke", "poke", lambda scene, live: "poke" in live, _poke, ("poke_x", "poke_y", "poke_z"), _poke_values, "poke"
    ),
)


def own_parts(scene: Scene, live: frozenset[str]) -> set[str]:
    """The parts of those that the scene has, or that may be switched on."""
    return {force.part for force in OWN_FORCES if force.present(scene, live)}


def own_values(scene: Scene, poke: Sequence[float], axes: int) -> dict[str, float]:
    """The constants of all of them, 0 where the scene has none: over mass [m/s^2]."""
    found: dict[str, float] = {}
    for force in OWN_FORCES:
        found |= force.values(scene, poke, axes)
    return found


def own_names(axes: int) -> tuple[str, ...]:
    """What they are called."""
    return tuple(name for force in OWN_FORCES for name in force.names if axes == 3 or not name.endswith("_z"))


def own_fields() -> dict[str, str]:
    """The scene's field that each of them follows from."""
    return {name: force.field for force in OWN_FORCES for name in force.names}


def own_forces(parts: frozenset[str]) -> tuple[OwnForce, ...]:
    """Those among the parts, in the order in which they are added."""
    return tuple(force for force in OWN_FORCES if force.part in parts)


def own_changes(parts: frozenset[str]) -> bool:
    """Whether one of them changes with the number of the step."""
    return any(force.changes for force in own_forces(parts))


def make_add(compiled: Any, made: Made, axes: int, parts: frozenset[str]) -> Any:
    """add(a, weight, f) -> the acceleration `a` and `f` [m/s^2] (`axes` numbers each), counted by the `weight` where the
    scene has a `load`."""
    added, has_load = made(distance.make).added, "load" in parts

    @compiled
    def add(a, weight, f):
        if axes == 2:
            if has_load:
                return added(a[0], weight, f[0]), added(a[1], weight, f[1])
            return a[0] + f[0], a[1] + f[1]
        if has_load:
            return added(a[0], weight, f[0]), added(a[1], weight, f[1]), added(a[2], weight, f[2])
        return a[0] + f[0], a[1] + f[1], a[2] + f[2]

    return add


def make_own(real: Any, compiled: Any, made: Made, axes: int, parts: frozenset[str]) -> Any:
    """own(a, k, weight, parameters, integers, step) -> the acceleration `a` [m/s^2] (`axes` numbers) of particle k with all
    that acts on it by itself. `weight`: the sheet's mass over its own, where the scene has a `load`. `compiled`: decorates
    device functions; `made(factory)`: a backend's formulas."""
    add = make_add(compiled, made, axes, parts)

    @compiled
    def own(a, k, weight, parameters, integers, step):
        return a

    for force in own_forces(parts):
        own = _then(own, force.make(real, compiled, made, axes), add, compiled)
    return _counted_in_sheet(own, compiled) if WINDOW in parts else own


def _counted_in_sheet(own: Any, compiled: Any) -> Any:
    """`own` for particles that are counted in a window."""

    @compiled
    def own_of_window(a, k, weight, parameters, integers, step):
        return own(a, np.int64(k) + np.int64(integers[FIRST]), weight, parameters, integers, step)

    return own_of_window


def in_window(plan: Plan, first_particle: int | None) -> Plan:
    """The plan where its particles are those of a window that begins with `first_particle` of the sheet (None: it is the
    sheet). Only a force that asks for their numbers makes a difference."""
    if first_particle is None or not own_forces(plan.parts):
        return plan
    return replace(plan, parts=plan.parts | {WINDOW})


def _then(before: Any, force: Any, add: Any, compiled: Any) -> Any:
    @compiled
    def own(a, k, weight, parameters, integers, step):
        return add(before(a, k, weight, parameters, integers, step), weight, force(k, parameters, integers, step))

    return own
