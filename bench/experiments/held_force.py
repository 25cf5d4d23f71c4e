"""Converged references of scenes with a random force: for the draws of one step size, each held over its step.

At another step size the force is another one, so that halving the step of a run converges to nothing. But between two
draws it is constant: with the draws of the scene's own step size the motion is an ordinary one, which RK4 solves by whole
fractions of that step. NumPy float64, as all of bench/reference/ whose force it uses.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from bench.experiments.accuracy.judge import SECONDS_PER_EVALUATION
from bench.reference import cache
from bench.reference.mass_spring import simulate, start
from model.core.disk_cache import read_arrays, write_arrays
from model.core.integrators import damping_rate, frequency_bound
from model.scene.scene import Scene

SECONDS_PER_STEP = 1e-3  # s, of NumPy's calls, rounded up
MAX_HALVINGS = 5


def _first_fractions(scene: Scene) -> int:
    """Fractions of a step to begin with: h w = 1/4, as everywhere."""
    return max(1, ceil(4 * scene.method.dt * (frequency_bound(scene) + damping_rate(scene))))


def held_seconds(scene: Scene, steps: int) -> float:
    """What the reference takes, roughly: at h, h/2 and h/4."""
    return (
        7
        * steps
        * _first_fractions(scene)
        * (4 * scene.grid.particle_count * SECONDS_PER_EVALUATION + SECONDS_PER_STEP)
    )


def held_converged(
    scene: Scene, steps: int, folder: Path | None, tolerance: float = cache.TOLERANCE
) -> cache.Converged:
    """The motion after `steps` steps of `method.dt` under the draws of exactly those steps, by RK4 and Richardson.

    As bench.reference.mass_spring.converged, from `folder` where it is kept there (None: nothing is kept).
    """
    dt = scene.method.dt
    key = cache.key(scene, steps * dt, 1.0, tolerance)
    file = folder / f"held-{key}-{steps}.npz" if folder else None
    held = read_arrays(file) if file else None
    if held and held.keys() >= {"position", "velocity", "estimate"}:
        return cache.Converged(held["position"], held["velocity"], float(held["estimate"]))

    def solve(fractions: int) -> tuple[np.ndarray, np.ndarray]:
        finer = scene.replace({"method.dt": dt / fractions, "method.integrator": "rk4"})
        state = start(scene)
        for step in range(steps):
            for _ in range(fractions):
                state = simulate(finer, 1, *state, step)  # `step` numbers the draw
        return state

    fractions = _first_fractions(scene)
    coarse = solve(fractions)
    for halvings_left in range(MAX_HALVINGS, 0, -1):
        fractions *= 2
        fine = solve(fractions)
        change = [(b - a) / 15 for a, b in zip(coarse, fine, strict=True)]
        estimate = float(np.linalg.norm(change[0], axis=-1).max())
        if estimate <= tolerance * scene.grid.spacing or halvings_left == 1:
            break
        coarse = fine
    made = cache.Converged(fine[0] + change[0], fine[1] + change[1], estimate)
    if file:
        write_arrays(file, position=made.position, velocity=made.velocity, estimate=made.estimate)
    return made
