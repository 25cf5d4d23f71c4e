"""The stages without neighbours of a position-based sheet: loads, prediction, velocity, each over the whole sheet.

Arrays are (axes, rows, columns), `weights` (rows, columns).
"""

from __future__ import annotations

from types import SimpleNamespace

from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, routine
from softlab.model.formulas.distance import added, damping_factor, kicked, predicted, rate


@routine
def add_weighed(acceleration, weights, force):
    axes, rows, columns = acceleration.shape
    for i in prange(rows):
        for j in range(columns):
            for axis in range(axes):
                now = acceleration[axis, i, j]
                acceleration[axis, i, j] = added(now, weights[i, j], force[axis, i, j])


@routine
def predict(position, velocity, before, acceleration, weights, record):
    """Predict positions; pinned masses stay."""
    axes, rows, columns = position.shape
    for i in prange(rows):
        for j in range(columns):
            w, factor = weights[i, j], 1.0
            if FEATURE.damping:
                factor = damping_factor(record[0].braking, w) if FEATURE.load else record[0].keep
            for axis in range(axes):
                p = position[axis, i, j]
                v = kicked(velocity[axis, i, j], factor, record[0].dt, acceleration[axis, i, j])
                before[axis, i, j] = p
                position[axis, i, j] = predicted(p, record[0].dt, v) if w > 0.0 else p


@routine
def update_velocity(position, velocity, before, weights, record):
    axes, rows, columns = position.shape
    for i in prange(rows):
        for j in range(columns):
            for axis in range(axes):
                v = rate(position[axis, i, j], before[axis, i, j], record[0].inverse_substep)
                velocity[axis, i, j] = v if weights[i, j] > 0.0 else 0.0


def make_point_stages(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Compile these stages, by name."""
    variant = compiler.variant_of(real, features_of(parts))
    stages = add_weighed, predict, update_velocity
    return SimpleNamespace(**{stage.__name__: compiler.kernel(variant.copied(stage)) for stage in stages})
