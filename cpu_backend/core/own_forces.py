"""Forces on single particles (model/core/own_forces.py) on CPU threads: along a row, and as stages."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.simulation import RowsSimulation
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine, row_routine
from softlab.model.core.own_forces import WINDOW, OwnForce, accelerated, force_flags, particle_forces
from softlab.model.core.plan import Moment, StageRun

particle_force = Open("particle_force(a, k, weight, parameters, integers, step): of `with_forces`")


@row_routine
def add_2d(count, first, step, parameters, integers, x, y):
    """Add to a row's sums of accelerations, one array per axis, for `count` particles from number `first` on."""
    for j in range(count):
        x[j], y[j] = particle_force((x[j], y[j]), first + j, 1.0, parameters, integers, step)


@row_routine
def add_3d(count, first, step, parameters, integers, x, y, z):
    """Add as `add_2d` does, along three axes."""
    for j in range(count):
        x[j], y[j], z[j] = particle_force((x[j], y[j], z[j]), first + j, 1.0, parameters, integers, step)


@routine
def stage(acceleration, weights, record, integers, step):
    """Add one force on every mass.

    `acceleration` (axes, rows, columns) [m/s^2]; `weights` (rows, columns): factors by which masses are lighter than
    the sheet's, if they differ (FEATURE.load).
    """
    _, rows, columns = acceleration.shape
    for i in prange(rows):
        for j in range(columns):
            weight = weights[i, j] if FEATURE.load else 1.0
            z = acceleration[2, i, j] if FEATURE.axes == 3 else 0.0
            a = acceleration[0, i, j], acceleration[1, i, j]
            acceleration_now = particle_force(
                a if FEATURE.axes == 2 else (a[0], a[1], z), i * columns + j, weight, record[0], integers, step
            )
            for axis in range(FEATURE.axes):
                acceleration[axis, i, j] = acceleration_now[axis]


@routine
def gravity(acceleration, record):
    for i in prange(acceleration.shape[1]):
        for j in range(acceleration.shape[2]):
            acceleration[1, i, j] += record[0].gravity


def with_forces(kernel: Callable, parts: frozenset[str]) -> Callable:
    """Return a kernel whose `particle_force` is the sum of the forces on single particles in `parts`."""
    return filled(kernel, {"particle_force": accelerated(parts)})


@cache
def _make_stage(real: Real, math: str, axes: int, force: OwnForce, has_load: bool, window: frozenset[str]) -> Callable:
    """Compile `stage` of a force; `window`: {WINDOW} if the sheet is one, else empty."""
    compiler = Compiler(f"{force.part}_{axes}d_{np.dtype(real).name}_{math}", math)
    parts = window | {force.part} | ({"load"} if has_load else set())
    variant = compiler.variant_of(real, force_flags(axes, parts))
    return compiler.kernel(variant.copied(with_forces(stage, parts)))


@cache
def _make_gravity(real: Real, math: str) -> Callable:
    compiler = Compiler(f"gravity_{np.dtype(real).name}_{math}", math)
    return compiler.kernel(compiler.variant_of(real).copied(gravity))


def bind_forces(
    sim: RowsSimulation, acceleration: np.ndarray, weights: np.ndarray | None = None
) -> dict[str, StageRun]:
    """Return the stages of `sim` for single masses: gravity and these forces; `weights` if masses differ."""
    gravity = _make_gravity(sim.real, sim.options.math)
    alike = np.zeros((1, 1), sim.real) if weights is None else weights

    def bound(force: OwnForce) -> StageRun:
        stage = _make_stage(
            sim.real, sim.options.math, len(acceleration), force, weights is not None, sim.plan.parts & {WINDOW}
        )
        return lambda moment: stage(acceleration, alike, sim.record, sim.integers, moment.step)

    def add_gravity(moment: Moment) -> None:
        gravity(acceleration, sim.record)

    return {"gravity": add_gravity, **{force.stage: bound(force) for force in particle_forces(sim.plan.parts)}}
