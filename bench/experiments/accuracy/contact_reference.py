"""References of cloths that touch something: the lab's own semi-implicit Euler at tiny steps, float64, exact, on the CPU.

A contact is a jump, after which RK4 has no order to extrapolate by (bench/reference/richardson.py), and NumPy would take
minutes for the steps that first order needs. Not independent of what it judges; tests hold that very configuration against
bench/reference/cloth.py to rounding. Whoever uses it says so.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from app.driver import open_simulation
from bench.measure.experiment import source_hash
from bench.reference import cache
from model.core.disk_cache import read_arrays, write_arrays
from model.core.families import stability_limit
from model.scene.scene import Scene

FINER = 128  # steps of the reference to one at the limit


def contact_converged(scene: Scene, time: float, folder: Path | None) -> cache.Converged:
    """The end state at `time` [s] with steps of half of limit / FINER; the estimate [m] is the largest difference to twice
    such steps, which of a method of first order is the error of the finer. Kept in `folder` (None: not at all)."""
    key = f"{cache.key(scene, time, 1.0, 1 / FINER)}-{source_hash('cpu')}"
    file = folder / f"contact-{key}.npz" if folder else None
    held = read_arrays(file) if file else None
    if held and held.keys() >= {"position", "velocity", "estimate"}:
        return cache.Converged(held["position"], held["velocity"], float(held["estimate"]))
    stepped = scene.replace({"method.integrator": "semi-implicit-euler"})
    steps = ceil(FINER * time / stability_limit(stepped))
    (coarse, _), (position, velocity) = (_end(stepped, time, count) for count in (steps, 2 * steps))
    made = cache.Converged(position, velocity, float(np.linalg.norm(position - coarse, axis=1).max()))
    if file:
        write_arrays(file, position=made.position, velocity=made.velocity, estimate=made.estimate)
    return made


def _end(scene: Scene, time: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    fine = scene.replace({"method.dt": time / steps})
    with open_simulation(fine, "cpu", precision="float64", math="exact") as simulation:
        simulation.advance(steps)
        state = simulation.state()
    return state.position, state.velocity
