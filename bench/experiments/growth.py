"""Growth of a small disturbance by the time a run is judged: the guard against chaos.

The distance to a reference says something about a method only while the motion does not blow every rounding error up to
the size of the scene. So the reference is run a second time from a start disturbed by 1e-9 spacings (a twin): by how
much the two have parted at the end, over how much they were apart at the start, is the growth factor. Damped lab grids
contract (a factor under 1); beyond MAX_GROWTH the error of a trajectory is refused, and only statistics are compared.

A twin in float32 would be lost in rounding, and the growth belongs to the motion, not to a method: it is measured in
NumPy float64 with RK4 (bench/reference/), once a scene and time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from softlab.bench.reference import cache
from softlab.bench.reference.mass_spring import pinned_mask, simulate, start
from softlab.model.core.integrators import fastest_damping, frequency_bound, spring_damping_bound
from softlab.model.scene.scene import Scene

DISTURBANCE = 1e-9  # spacings
MAX_GROWTH = 1e3  # a larger factor makes a trajectory's error meaningless
CHECKPOINTS = 24  # times at which the twins are compared
STEPS_PER_RADIAN = 4  # h w = 1/4, far more than a growth factor needs
MIN_STEPS = 96


@dataclass(frozen=True)
class Growth:
    """Growth `factors` of a disturbance at the `times` [s], both (checkpoints,); 1 where nothing is free."""

    times: np.ndarray
    factors: np.ndarray

    @property
    def factor(self) -> float:
        """Growth factor at the end."""
        return float(self.factors[-1])

    @property
    def chaotic(self) -> bool:
        """True if the motion is chaotic, so that no error is given (also if the twins are no longer finite)."""
        return not self.factor <= MAX_GROWTH

    def safe_time(self) -> float | None:
        """Last checkpoint [s] before the factor first exceeds MAX_GROWTH; None if the first one exceeds it."""
        over = np.flatnonzero(~(self.factors <= MAX_GROWTH))
        last = (over[0] if len(over) else len(self.times)) - 1
        return float(self.times[last]) if last >= 0 else None


def disturbance(scene: Scene) -> np.ndarray:
    """Return the disturbance (particles, dimensions) [m]: DISTURBANCE spacings times a fixed pattern without the symmetries
    of a sheet; 0 at pins."""
    i, j = np.mgrid[: scene.grid.rows, : scene.grid.columns]
    waves = [np.sin(1.7 * i + 0.9 * j + 1), np.cos(0.6 * i - 1.3 * j + 1), np.sin(0.8 * i - 0.7 * j + 1)]
    pattern = np.stack(waves[: scene.dimensions], axis=-1)
    pattern[pinned_mask(scene)] = 0
    return DISTURBANCE * scene.grid.spacing * pattern.reshape(-1, scene.dimensions)


def twin_steps(scene: Scene, time: float, per_radian: float = STEPS_PER_RADIAN) -> int:
    """Steps of the twins up to `time` [s]: whole ones between two checkpoints. `per_radian`: of the fastest vibration."""
    wanted = time * (frequency_bound(scene) + fastest_damping(scene) + spring_damping_bound(scene)) * per_radian
    return CHECKPOINTS * ceil(max(wanted, MIN_STEPS) / CHECKPOINTS)


def growth_along(
    scene: Scene, time: float, path: Callable[[np.ndarray, int], list[np.ndarray]], per_radian: float = STEPS_PER_RADIAN
) -> Growth:
    """Return the growth factors up to `time` [s]. `path(position, steps)`: the positions (particles, dimensions) at the
    CHECKPOINTS times, from such a start at the scene's velocities, in so many steps."""
    times = time * np.arange(1, CHECKPOINTS + 1) / CHECKPOINTS
    offset = disturbance(scene)
    before = float(np.linalg.norm(offset))
    if before == 0:
        return Growth(times, np.ones(CHECKPOINTS))
    count = twin_steps(scene, time, per_radian)
    position, _ = start(scene)
    one, other = path(position, count), path(position + offset, count)
    with np.errstate(over="ignore", invalid="ignore"):
        return Growth(times, np.array([float(np.linalg.norm(b - a)) / before for a, b in zip(one, other, strict=True)]))


def measure_growth(scene: Scene, time: float, integrator: str = "rk4", per_radian: float = STEPS_PER_RADIAN) -> Growth:
    """Return the growth factors of a scene's motion up to `time` [s]. The scene's own method does not matter.

    `integrator`, `per_radian` (see `twin_steps`): of the twins. Implicit Euler is for scenes too stiff for explicit steps.
    """

    def path(position: np.ndarray, count: int) -> list[np.ndarray]:
        stepped = scene.replace({"method.dt": time / count})
        state = position, start(scene)[1]
        each = count // CHECKPOINTS
        passed = []
        for checkpoint in range(CHECKPOINTS):
            state = simulate(stepped, each, *state, checkpoint * each, integrator=integrator)
            passed.append(state[0])
        return passed

    return growth_along(scene, time, path, per_radian)


def cached_growth(
    scene: Scene, time: float, folder: Path | None, integrator: str = "rk4", per_radian: float = STEPS_PER_RADIAN
) -> Growth:
    """Return `measure_growth` from `folder`, or compute it and store it there like references (None: not stored)."""
    file = folder / f"growth-{cache.key(scene, time, 1.0, DISTURBANCE)}.npz" if folder else None
    shapes = {"times": (CHECKPOINTS,), "factors": (CHECKPOINTS,)}
    arrays = cache.cached_arrays(file, shapes, lambda: vars(measure_growth(scene, time, integrator, per_radian)))
    return Growth(arrays["times"], arrays["factors"])


def growth_words(growth: float) -> str:
    """Growth of a disturbance in words: `shrinks to 0.094 of itself`, `grows 12 times`."""
    if 0.995 <= growth < 1.005:
        return "neither grows nor shrinks"
    return f"shrinks to {growth:.2g} of itself" if growth < 1 else f"grows {growth:.2g} times"
