"""The stages of forces that look at one mass alone, for the teaching versions in rows and columns: gravity, the external
force, a poke. What they add to, `acceleration`, is (axes, rows, columns) [m/s^2]."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.core.compile import Compiler
from model.core.plan import Moment, StageRun
from model.formulas import distance, random

POKE = ("poke_x", "poke_y", "poke_z")


@cache
def make_force_stages(real: Any, math: str, has_load: bool) -> SimpleNamespace:
    """`gravity(acceleration, parameters)`; `external(acceleration, weights, parameters, integers, step)`: forces over the
    sheet's mass, on masses that are `weights` (rows, columns) times as light where they differ (`has_load`)."""
    compiler = Compiler(f"forces_{np.dtype(real).name}_{math}", math)
    compiled, kernel = compiler.compiled, compiler.kernel
    philox, add_external = random.make_philox(compiled), random.make(real, compiled).add_external
    added, zero = distance.make(real, compiled).added, real(0)

    def gravity(acceleration, record):
        for i in prange(acceleration.shape[1]):
            for j in range(acceleration.shape[2]):
                acceleration[1, i, j] += record[0].gravity

    def external(acceleration, weights, record, integers, step):
        axes, rows, columns = acceleration.shape
        for i in prange(rows):
            for j in range(columns):
                words = philox(integers[0], np.uint64(step), np.uint64(i * columns + j))
                for axis in range(axes):
                    force = add_external(zero, record[0].external, words[axis])
                    now = acceleration[axis, i, j]
                    acceleration[axis, i, j] = added(now, weights[i, j], force) if has_load else now + force

    return SimpleNamespace(gravity=kernel(gravity), external=kernel(external))


def bind_forces(sim: Any, acceleration: np.ndarray, weights: np.ndarray | None = None) -> dict[str, StageRun]:
    """What runs these stages for `sim`; `weights` where masses differ."""
    make = make_force_stages(sim.real, sim.options.math, weights is not None)
    added = distance.make(sim.real).added
    alike = np.zeros((1, 1), sim.real) if weights is None else weights

    def poke(moment: Moment) -> None:
        axes, _, columns = acceleration.shape
        if sim.integers[1] > 0:
            i, j = divmod(int(sim.integers[1]) - 1, columns)
            weight = sim.real(1) if weights is None else weights[i, j]
            for axis in range(axes):
                acceleration[axis, i, j] = added(acceleration[axis, i, j], weight, sim.parameters[POKE[axis]])

    return {
        "gravity": lambda moment: make.gravity(acceleration, sim.record),
        "external force": lambda moment: make.external(acceleration, alike, sim.record, sim.integers, moment.step),
        "poke": poke,
    }
