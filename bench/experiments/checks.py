"""Check of the result of every configuration before its time is reported.

Each is compared with the float64 NumPy reference at a small size, with the same kernel and threads, and with the other
backend at the configuration's own size, if it is available. Errors are distances of the free masses, in spacings.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.measure.gpu import gpu_simulated
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.build import wave
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

CHECK_ROWS, CHECK_COLUMNS = 23, 19  # masses: small for the reference, not divisible by a block or band
CHECK_STEPS = 100
SIMULATOR_CHECK = (6, 5, 8)  # rows, columns, steps under the CUDA simulator, which takes milliseconds per mass
FULL_SIZE_STEPS = 10
WAVE_ROWS = 256  # masses down, after which the wave of displacements repeats
CHUNK = 1 << 18  # masses compared at a time, so that they stay in the cache
AMPLITUDE = 0.05  # spacings: displacement of the start from rest, so that every spring acts
# Spacings: a larger error is a wrong result and not rounding. For grids up to CHECK_ROWS masses wide; the rounding of a
# coordinate grows with its size, and the limit with it (the hand-out's (p' - p) / dt carries it into the velocity).
LIMITS = {"float32": 1e-3, "float64": 1e-9}


@dataclass(frozen=True)
class Check:
    """Result of a check.

    `error`, `largest`: root mean square and maximum over the free masses, in spacings; infinite if the run diverged.
    `note`: how they were computed, or what went wrong. `good`: the error is below the limit of the precision.
    """

    error: float
    largest: float
    note: str
    good: bool


def compare(simulation: Simulation, expected: np.ndarray, note: str) -> Check:
    """Compare the simulation's positions with `expected` (particles, 2) [m]."""
    body, position = simulation.body, simulation.read("position")
    count = len(position) - len(body.pinned)
    if not count:
        return Check(0.0, 0.0, note + "; every mass is pinned", True)
    total, farthest = 0.0, 0.0
    for begin in range(0, len(position), CHUNK):
        part = slice(begin, begin + CHUNK)
        offset = np.subtract(position[part], expected[part], dtype=np.float64)
        squared = np.where(body.inverse_mass[part] > 0, np.sum(offset * offset, axis=1), 0.0)
        total, farthest = total + float(squared.sum()), max(farthest, float(squared.max()))
    spacing = simulation.scene.grid.spacing
    error, largest = math.sqrt(total / count) / spacing, math.sqrt(farthest) / spacing
    if not math.isfinite(error):
        return Check(math.inf, math.inf, note + "; the state is not finite", False)
    widest = max(simulation.body.rows, simulation.body.columns)
    return Check(error, largest, note, error <= LIMITS[simulation.options.precision] * max(1, widest / CHECK_ROWS))


@lru_cache(maxsize=64)
def _reference(scene_text: str, steps: int) -> np.ndarray:
    from softlab.bench.reference.mass_spring import simulate

    return simulate(Scene(json.loads(scene_text)), steps)[0]


def against_reference(simulation: Simulation) -> Check:
    """Compare scene, integrator, kernel, threads, precision and math of `simulation` with NumPy at a small size.

    A kernel that does not support so small a grid is replaced by the backend's default, as the note then says.
    """
    simulated = simulation.backend == "gpu" and gpu_simulated()
    rows, columns, steps = SIMULATOR_CHECK if simulated else (CHECK_ROWS, CHECK_COLUMNS, CHECK_STEPS)
    amplitude = AMPLITUDE * simulation.scene.grid.spacing
    small = simulation.scene.replace({"grid.rows": rows, "grid.columns": columns, "perturbation.amplitude": amplitude})
    options = simulation.options
    threads = simulation.threads if simulation.backend == "cpu" else "1x"
    note = f"{rows} x {columns} masses, {steps} steps, against NumPy in float64"

    def opened(kernel: str | None) -> Simulation:
        return open_simulation(
            small, simulation.backend, threads=threads, precision=options.precision, math=options.math, kernel=kernel,
            allow_unstable=True,
        )  # fmt: skip

    try:
        trial = opened(simulation.kernel)
    except SceneError:
        trial = opened(None)
        note += f"; by kernel {trial.kernel}, since {simulation.kernel} does not support that size"
    with trial:
        try:
            trial.advance(steps)
            trial.check()
        except Diverged as error:
            return Check(math.inf, math.inf, str(error), False)
        return compare(trial, _reference(small.canonical(), steps), note)


def displaced(simulation: Simulation) -> State:
    """Return the scene's start with every free mass slightly displaced, so that all springs act."""
    body, grid = simulation.body, simulation.scene.sheet
    few = grid.model_copy(update={"rows": min(grid.rows, WAVE_ROWS)})  # the sines of millions of masses take seconds
    position = body.position + np.resize(wave(few, AMPLITUDE * grid.spacing), body.position.shape)
    position[body.pinned] = body.position[body.pinned]
    return State(position, body.velocity, body.inverse_mass, 0.0, 0)


def against_other(simulation: Simulation, other: Simulation) -> Check:
    """Compare two simulations of a scene after a few steps from the same displaced state. Both are reset."""
    state = displaced(simulation)
    note = f"own size, {FULL_SIZE_STEPS} steps, against {other.backend} ({other.kernel}, {other.options.precision})"
    try:
        for each in (simulation, other):
            each.load(state)
            each.advance(FULL_SIZE_STEPS)
            each.check()
        return compare(simulation, other.read("position").astype(np.float64), note)
    except Diverged as error:
        return Check(math.inf, math.inf, str(error), False)
    finally:
        for each in (simulation, other):
            each.reset()
