"""Error of a single run, so that no time is reported without an error."""

from __future__ import annotations

from math import floor, log10

import numpy as np

from softlab.bench.experiments.accuracy.methods import why_unknown
from softlab.bench.reference.mass_spring import converged, smooth
from softlab.model.base.errors import Diverged
from softlab.model.core.integrators import fastest_damping, frequency_bound, spring_damping_bound
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

# Cost of the reference in NumPy, per mass and force evaluation; RK4 takes four evaluations a step, at h and at h/2.
SECONDS_PER_EVALUATION = 1e-7  # s, rounded up
SECONDS_PER_CLOTH_EVALUATION = 5e-7  # a cloth has three times the springs in three dimensions
SECONDS_PER_WIND_EVALUATION = 8e-7  # in addition
BUDGET = 4.0  # s
STEPS_PER_RADIAN = 4  # as in the reference


def judge_run(scene: Scene, state: State, diverged: Diverged | None = None) -> tuple[float | None, str | None]:
    """Compare the state at the end of a run with a converged reference at the same physical time.

    Parameters
    ----------
    scene : Scene
        The scene that was run.
    state : State
        Its state at the end.
    diverged : Diverged, optional
        The error that ended the run.

    Returns
    -------
    error : float or None
        Root mean square over the free masses of the distance to the reference, divided by the spacing.
    reason : str or None
        Why there is no error: none is known for the scene, or the reference would take longer than BUDGET seconds.
    """
    if diverged is not None:
        return None, "diverged"
    free = state.inverse_mass > 0
    if not free.any():
        return 0.0, None
    if state.step == 0:
        return 0.0, None
    why = why_unknown(scene)
    if why is not None:
        return None, why
    if scene.external and scene.external.magnitude > 0:
        return None, "a random force differs at every step size, so there is no converged reference"
    steps = state.time * fastest_rate(scene) * STEPS_PER_RADIAN
    # h and h/2, and h/4 to determine the order
    cost = (3 if smooth(scene) else 7) * steps * 4 * evaluation_seconds(scene)
    if cost > BUDGET:
        unit = 10 ** (floor(log10(state.time * BUDGET / cost)) - 1)
        short = floor(state.time * BUDGET / cost / unit) * unit  # rounded down, so that such a run is affordable
        return (
            None,
            f"its converged reference would take about {cost:.0f} s; a run of at most {short:.2g} s (--time) has one",
        )
    reference, _, estimate = converged(scene, state.time, tolerance=1e-6, most_steps=int(4 * steps) + 64)
    error, _ = distance(state.position, reference, free, scene.grid.spacing)
    if not np.isfinite(error):
        return None, "the reference did not converge"
    if error < 10 * estimate / scene.grid.spacing:
        unsure = f"it is uncertain by {estimate / scene.grid.spacing:.1e} of the spacing"
        return None, f"below the resolution of the reference: {unsure}; an earlier --time may be resolved better"
    return error, None


def fastest_rate(scene: Scene) -> float:
    """Upper bound [1/s] of all rates in the scene: the largest frequency, plus what the dampers add."""
    return frequency_bound(scene) + fastest_damping(scene) + spring_damping_bound(scene)


def evaluation_seconds(scene: Scene) -> float:
    """Rough time [s] of one evaluation of the forces in NumPy."""
    if not scene.cloth:
        return scene.grid.particle_count * SECONDS_PER_EVALUATION + 1e-4
    each = SECONDS_PER_CLOTH_EVALUATION + (SECONDS_PER_WIND_EVALUATION if scene.wind else 0.0)
    return scene.grid.particle_count * each + 4e-4


def distance(position: np.ndarray, reference: np.ndarray, free: np.ndarray, spacing: float) -> tuple[float, float]:
    """Measure how far positions are from a reference.

    Parameters
    ----------
    position, reference : (particles, dimensions) float arrays, m
    free : (particles,) bool array
        Particles to compare.
    spacing : float
        Unit of the result, m.

    Returns
    -------
    rms, maximum : float
        Root mean square and maximum of the distances, divided by `spacing`.
    """
    away = position[free].astype(np.float64) - reference[free]
    squared = np.sum(away * away, axis=1)
    return float(np.sqrt(np.mean(squared)) / spacing), float(np.sqrt(squared.max()) / spacing)
