"""The stages without neighbours of a position-based sheet: loads, prediction, velocity, each over the whole sheet."""

from __future__ import annotations

from types import SimpleNamespace

from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas import distance


def make_point_stages(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the stages without neighbours. Arrays are (axes, rows, columns), `weights` (rows, columns)."""
    kernel = compiler.kernel
    formulas = compiler.formulas(distance, real)
    kicked, damping_factor, predicted, rate, added = (
        formulas.kicked, formulas.damping_factor, formulas.predicted, formulas.rate, formulas.added
    )  # fmt: skip
    has_load, has_damping = "load" in parts, "damping" in parts
    zero, one = real(0), real(1)

    @kernel
    def add_weighed(acceleration, weights, force):
        axes, rows, columns = acceleration.shape
        for i in prange(rows):
            for j in range(columns):
                for axis in range(axes):
                    now = acceleration[axis, i, j]
                    acceleration[axis, i, j] = added(now, weights[i, j], force[axis, i, j])

    @kernel
    def predict(position, velocity, before, acceleration, weights, record):
        """Predict positions; pinned masses stay."""
        axes, rows, columns = position.shape
        for i in prange(rows):
            for j in range(columns):
                w, factor = weights[i, j], one
                if has_damping:
                    factor = damping_factor(record[0].braking, w) if has_load else record[0].keep
                for axis in range(axes):
                    p = position[axis, i, j]
                    v = kicked(velocity[axis, i, j], factor, record[0].dt, acceleration[axis, i, j])
                    before[axis, i, j] = p
                    position[axis, i, j] = predicted(p, record[0].dt, v) if w > zero else p

    @kernel
    def update_velocity(position, velocity, before, weights, record):
        axes, rows, columns = position.shape
        for i in prange(rows):
            for j in range(columns):
                for axis in range(axes):
                    v = rate(position[axis, i, j], before[axis, i, j], record[0].inverse_substep)
                    velocity[axis, i, j] = v if weights[i, j] > zero else zero

    return SimpleNamespace(
        add_weighed=add_weighed, predict=predict,
        update_velocity=update_velocity,
    )  # fmt: skip
