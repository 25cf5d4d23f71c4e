"""Budgets of a bar by the laws of `softlab advise` (bench/experiments/advise/tetrahedra_laws.py).

They are the settings of each solver that should be fastest within an error, so that fine meshes are measured only
there.
"""

from __future__ import annotations

from functools import partial

from softlab.bench.experiments.advise.tetrahedra_laws import Stiff, fewest, least_descent
from softlab.bench.experiments.tetrahedral.cantilever import SECOND

WITHIN = 0.01  # of the displacement, or of the sag: the requested error
SAFE = 0.7  # fraction of the substeps that the law of rows requires: in fine meshes it requires too many


def _rows_suffice(stiff: Stiff, dt: float, error: float, sweeps: int, substeps: int) -> bool:
    return max(stiff.excess(dt / substeps, sweeps), stiff.damped(dt / substeps)) <= error


def _steps_suffice(stiff: Stiff, dt: float, error: float, order: int, steps: int) -> bool:
    return stiff.damped(dt / steps, order) <= error


def promised(stiff: Stiff, dt: float, error: float = WITHIN) -> list[tuple[str, int, int]]:
    """Return (solver, substeps, iterations) of a step of dt [s] within `error` by the laws.

    Rows of one sweep, also with SAFE as many substeps, and of two sweeps, vertex block descent, and Newton's method of
    both orders; none that the laws exclude.
    """
    settings: list[tuple[str, int, int]] = []
    for sweeps in (1, 2):
        substeps = fewest(partial(_rows_suffice, stiff, dt, error, sweeps))
        if substeps:
            settings += [("xpbd", n, sweeps) for n in sorted({round(SAFE * substeps), substeps}) if n]
    descent = least_descent([stiff], dt, error)
    if descent:
        settings.append(("vbd", *descent))
    for order, solver in ((1, "newton"), (2, SECOND)):
        steps = fewest(partial(_steps_suffice, stiff, dt, error, order))
        settings += [(solver, steps, 1)] if steps else []
    return settings
