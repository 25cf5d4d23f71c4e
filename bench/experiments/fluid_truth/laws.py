"""Known results for the scenes of scenes.py, and the error of a motion against them.

Independent of the solver: only positions and velocities, in float64, and pressures where a solver reports them.

- A column (tank) at rest: its height, the rest density everywhere, no motion, the pressure rho g z. All four are needed:
  a fluid that boils has the right height, and one that has sunk is still.
- A dam: the front of J. C. Martin and W. J. Moyce, Phil. Trans. R. Soc. A 244 (1952), table 2, n^2 = 2. Their gate opens
  slowly, so one shift of time is fitted, the one with the smallest largest error. The first point is reported
  separately: it lies above the parabola from rest through the next two points (`start_off`), so that no flow that
  begins at rest passes through all three.
- Vortices (G. I. Taylor and A. E. Green, 1937): their energy decays as exp(-16 pi^2 nu t / L^2), which gives the
  effective viscosity.
- A drop: its centre rests, its momentum stays 0, it becomes a ball. Laplace's pressure of a drop of radius R is
  2 sigma / R, in a plane sigma / R, in addition to the pressure by which cohesion holds particles together anywhere.
  Drops of several sizes therefore give a straight line in 1 / R whose slope is the effective surface tension
  (`tensions` of rows.py).
- Two fluids: the light one ends above the heavy one, each in its own depth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from softlab.bench.experiments.fluid_truth.scenes import COLUMN, DAM, DROP, TANK, TENSION, TWO, VORTICES, WIDTH
from softlab.bench.measure.costs_timing import Measures
from softlab.model.base.errors import SoftlabError
from softlab.model.fluid.measure import compression, height
from softlab.model.particles.fluid_set import vortices
from softlab.model.scene.scene import Scene

HEIGHT, MEAN, LARGEST = "fluid_height_off", "fluid_density_mean", "fluid_density_largest"
SPEED, PRESSURE = "fluid_speed", "fluid_pressure_off"
FRONT, FRONT_LATER, FRONT_MEAN, SHIFT = "fluid_front", "fluid_front_later", "fluid_front_mean", "fluid_front_shift"
VISCOSITY = "fluid_numerical_viscosity"
ASPECT, DRIFT, MOMENTUM, INSIDE = "fluid_drop_aspect", "fluid_drop_drift", "fluid_momentum", "fluid_drop_pressure"
LEVEL, MIXED = "fluid_level_off", "fluid_mixed"
REST, CHECKED_STEPS = 3.0, 30  # s until a scene is at rest; steps over which the measures are averaged
DAM_SECONDS, VORTEX_SECONDS, DROP_SECONDS, TWO_SECONDS = 0.21, 0.5, 4.0, 6.0
SETTLED = 0.05  # s, after which the initial lattice of the vortices is gone
MOYCE = np.array(
    [
        (0.41, 1.11), (0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56),
        (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11),
    ]
)  # fmt: skip  # t sqrt(2 g / a), front / a
Progress = Callable[[float], None]  # argument: the fraction of a run that is done


class Stepped(Protocol):
    """A simulation of the lab or of a peer."""

    def advance(self, steps: int) -> object: ...

    def read(self, name: str) -> np.ndarray: ...


def judged(simulation: Stepped, scene: Scene, kind: str, progress: Progress = lambda part: None) -> Measures:
    """Return the errors of a simulation, at its start, against the law of its `kind`; it is left at the end.

    `simulation`: has advance(steps) and read(name), the lab's or a peer's.
    """
    laws = {COLUMN: _at_rest, TANK: _at_rest, DAM: _front, VORTICES: _slowed, DROP: _drop, TENSION: _drop, TWO: _levels}
    return laws[kind](simulation, scene, progress)


def _steps(scene: Scene, seconds: float) -> int:
    return round(seconds / scene.method.dt)


def _on(simulation: Stepped, steps: int, progress: Progress, total: int, done: int = 0) -> None:
    """Advance that many steps, a sixteenth of `total` at a time."""
    part = max(1, total // 16)
    for begin in range(0, steps, part):
        simulation.advance(min(part, steps - begin))
        progress((done + min(begin + part, steps)) / total)


def _places(simulation: Stepped) -> np.ndarray:
    return np.asarray(simulation.read("position"), np.float64)


def _at_rest(simulation: Stepped, scene: Scene, progress: Progress) -> Measures:
    assert scene.gravity is not None
    fluid_set, steps = scene.fluid_set, _steps(scene, REST)
    depth, g = float(np.ptp(fluid_set.position[:, 1])) + fluid_set.spacing, scene.gravity.acceleration
    rho, pressures = fluid_set.parts[0].density, []
    _on(simulation, steps - CHECKED_STEPS, progress, steps)
    heights, means, most, speeds = [], [], [], []
    for check in range(CHECKED_STEPS):
        simulation.advance(1)
        place = _places(simulation)
        mean, largest = compression(scene, place)
        heights.append(height(scene, place))
        means.append(mean)
        most.append(largest)
        speeds.append(np.linalg.norm(np.asarray(simulation.read("velocity"), np.float64), axis=1).max())
        pressure = _pressure(simulation)
        if pressure is not None:
            pressures.append(
                _pressure_off(
                    place[:, 1] - fluid_set.position[:, 1].min() + fluid_set.spacing / 2, pressure, depth, rho * g
                )
            )
        progress((steps - CHECKED_STEPS + check + 1) / steps)
    return {
        HEIGHT: (float(np.mean(heights)) / depth - 1, "", None),
        MEAN: (float(np.mean(means)), "", None),
        LARGEST: (float(np.max(most)), "", None),
        SPEED: (float(np.mean(speeds) / np.sqrt(g * depth)), "", None),
        PRESSURE: (float(np.abs(np.mean(pressures, axis=0)).max()), "", None) if pressures else (None, "", "not told"),
    }


def _pressure(simulation: Stepped) -> np.ndarray | None:
    try:
        return np.asarray(simulation.read("pressure"), np.float64)
    except (SoftlabError, ValueError):  # a peer or a scheme without pressures
        return None


def _pressure_off(above: np.ndarray, pressure: np.ndarray, depth: float, weight: float) -> np.ndarray:
    """Return the mean difference from rho g z, over its value at the floor, in nine layers below the free surface's."""
    layer = np.clip((10 * above / depth).astype(int), 0, 9)
    off = pressure - weight * (depth - above)
    count = np.maximum(np.bincount(layer, minlength=10), 1)
    return (np.bincount(layer, off, 10) / count / (weight * depth))[:9]


def start_off() -> float:
    """Return the relative height of Martin and Moyce's first front over x = a + c (t - t0)^2 through the next two."""
    (t1, x1), (t2, x2), (t3, x3) = MOYCE[:3]
    root = (np.sqrt(x3 - 1) - np.sqrt(x2 - 1)) / (t3 - t2)
    return float(x1 / (1 + (np.sqrt(x2 - 1) - root * (t2 - t1)) ** 2) - 1)


def _front(simulation: Stepped, scene: Scene, progress: Progress) -> Measures:
    assert scene.gravity is not None
    steps, spacing = _steps(scene, DAM_SECONDS), scene.fluid_set.spacing
    time, front = [0.0], [1.0]
    for step in range(1, steps + 1):
        simulation.advance(1)
        time.append(step * scene.method.dt * float(np.sqrt(2 * scene.gravity.acceleration / WIDTH)))
        front.append((float(_places(simulation)[:, 0].max()) + spacing / 2) / WIDTH)
        progress(step / steps)
    shifts = np.linspace(-0.3, 0.3, 121)
    errors = np.array([np.abs(np.interp(MOYCE[:, 0] - shift, time, front) / MOYCE[:, 1] - 1) for shift in shifts])
    best, later = int(np.argmin(errors.max(axis=1))), float(errors[:, 1:].max(axis=1).min())
    return {
        FRONT: (float(errors[best].max()), "", "of all points"),
        FRONT_LATER: (later, "", "without the first"),
        FRONT_MEAN: (float(errors[best].mean()), "", None),
        SHIFT: (float(shifts[best]), "", "of t sqrt(2 g / a)"),
    }


def _slowed(simulation: Stepped, scene: Scene, progress: Progress) -> Measures:
    assert scene.domain is not None
    steps, times, energy = _steps(scene, VORTEX_SECONDS), [], []
    for step in range(steps):
        wave = vortices(_places(simulation), scene.domain)
        energy.append(float((np.asarray(simulation.read("velocity")) * wave).sum() / (wave * wave).sum()) ** 2)
        times.append(step * scene.method.dt)
        simulation.advance(1)
        progress((step + 1) / steps)
    begin, side = sum(time < SETTLED for time in times), scene.domain.size[0]
    slope = np.polyfit(times[begin:], np.log(energy[begin:]), 1)[0]
    return {VISCOSITY: (float(-slope * side**2 / (16 * np.pi**2)), "m^2/s", None)}


def radius_of(scene: Scene) -> float:
    """Return the radius [m] of a ball, or a disc, with the volume of all fluids of a scene at rest."""
    fluid_set = scene.fluid_set
    if scene.dimensions == 2:
        return float(np.sqrt(fluid_set.particle_count / np.pi)) * fluid_set.spacing
    return float(np.cbrt(3 * fluid_set.particle_count / (4 * np.pi))) * fluid_set.spacing


def _drop(simulation: Stepped, scene: Scene, progress: Progress) -> Measures:
    fluid_set, steps = scene.fluid_set, _steps(scene, DROP_SECONDS)
    start = fluid_set.position.mean(axis=0)
    radius = radius_of(scene)
    _on(simulation, steps - CHECKED_STEPS, progress, steps)
    inside, fastest = [], 0.0
    for _ in range(CHECKED_STEPS):
        simulation.advance(1)
        place, pressure = _places(simulation), _pressure(simulation)
        fastest = max(fastest, float(np.linalg.norm(simulation.read("velocity"), axis=1).max()))
        if pressure is not None:
            inside.append(pressure[np.linalg.norm(place - place.mean(axis=0), axis=1) < radius / 2].mean())
    sizes = np.linalg.eigvalsh(np.cov((place - place.mean(axis=0)).T))
    momentum = np.linalg.norm(np.asarray(simulation.read("velocity"), np.float64).mean(axis=0))
    return {
        ASPECT: (float(np.sqrt(sizes[-1] / sizes[0])), "", None),
        DRIFT: (float(np.linalg.norm(place.mean(axis=0) - start) / fluid_set.spacing), "", "of a rest distance"),
        MOMENTUM: (float(momentum / fastest) if fastest > 0 else 0.0, "", "of all at the largest speed"),
        INSIDE: (float(np.mean(inside)), "Pa", f"of a radius of {radius:.4g} m")
        if inside
        else (None, "Pa", "not told"),
        MEAN: (compression(scene, place)[0], "", None),
    }


def _levels(simulation: Stepped, scene: Scene, progress: Progress) -> Measures:
    fluid_set, steps = scene.fluid_set, _steps(scene, TWO_SECONDS)
    _on(simulation, steps, progress, steps)
    place = _places(simulation)
    above = place[:, 1] - fluid_set.position[:, 1].min() + fluid_set.spacing / 2
    depth = float(np.ptp(fluid_set.position[:, 1])) + fluid_set.spacing
    heavy = np.argsort([part.density for part in fluid_set.parts])[-1] == fluid_set.fluid
    level = depth * heavy.mean()  # the interface
    wrong = np.where(heavy, above > level + fluid_set.spacing / 2, above < level - fluid_set.spacing / 2)
    off = max(abs(above[heavy].mean() - level / 2), abs(above[~heavy].mean() - (level + depth) / 2)) / depth
    return {
        LEVEL: (float(off), "", "of the depth, of either's middle"),
        MIXED: (float(wrong.mean()), "", "of all particles, in the other's half"),
        MEAN: (compression(scene, place)[0], "", None),
    }
