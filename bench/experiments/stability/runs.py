"""One point of the stability map, and one measured edge: how an opened simulation behaves at a step size.

Outcomes are of a damped grid under gravity, some of whose masses are off their places, over END seconds:

    settles    it ends at less than SETTLED of the greatest speed it had
    moving     it ends finite, and moves on: bounded, but not at rest
    grows      it is finite so far, but faster in the second half of the time, even after LONGER times as long
    diverged   it left the finite world, with the step at which it did (model/core/stepping.py says how that is found)

Speeds are root mean squares over the masses.

Edges are measured on a net whose springs have no rest length. Its equation is exactly linear, x'' = -A x - gamma x', so
that the largest frequency of A decides (model/core/stability/limit.py) and the step size at which growth begins is had by
bisection of "does it grow?", knowing nothing of the integrator.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf, isfinite, sqrt

import numpy as np

from model.core.build import pinned_indices, wave
from model.core.errors import Diverged, SceneError
from model.core.integrators import damping_rate
from model.core.simulation import Simulation, State
from model.core.stability.limit import MAX_MASSES, scene_frequency
from model.scene.scene import Scene

SETTLES, MOVING, GROWS, DIVERGED = 0, 1, 2, 3  # as stored
OUTCOMES = ("settles", "moving", "grows", "diverged")
LIVE = ("gravity", "dt", "stiffness", "damping")  # so that one opened simulation does a whole map

END = 6.0  # s: nine times the time in which a damping rate of 3/s takes amplitudes to 1/e
MIN_STEPS = 400  # of a point, so that large steps, too, have the time to grow
LONGER = 16  # a run whose speeds rise goes on for up to so many times as long, to see where it ends
RISING, RISEN = 1.1, 1.5  # of the greatest speed in the second half of the steps over the first's: goes on, has grown
SETTLED = 0.05
LOOK, LOOKS = 256, 32  # the most steps between two looks, and the fewest looks
QUIET_LOOKS = 8  # looks in a row at a speed under a hundredth of SETTLED end a run early

TOLERANCE = 1e-3  # relative width of the interval that an edge is found in
GROWN, DECAYED = 1e4, 1e-3  # of the amplitude at the start: decided
RISE = 1.02  # of the second half's largest amplitude over the first half's: growth, where neither was reached
RISE_UNDAMPED = 2.0  # without damping amplitudes wobble under the edge, and grow fast over it
FALL, FALL_STEPS = 0.9, 2**12  # a fall by so much after so many steps: decay, decided early
UNDAMPED_STEPS = 2**13  # without damping the slowest growth, of rk4, is 0.7 % a step at a thousandth over the edge
DAMPED_STEPS = 2**17  # with it that of explicit Euler, gamma dt / 2 times the excess: one millionth a step
STRAY = 1e-3  # of every other mode in the start, should one of these be the first to grow
SMALLEST, LARGEST = 1e-3, 1e3  # of dt w, between which an edge is looked for


@dataclass(frozen=True)
class Outcome:
    """`code`: SETTLES, MOVING, GROWS or DIVERGED; `step`: the first bad one, None where there was none; `steps` that were
    asked for in the end; `speed`: the last over the greatest; `note`: in words."""

    code: int
    step: int | None
    steps: int
    speed: float | None
    note: str


def steps_of(dt: float) -> int:
    """Steps of a point at step size `dt` [s]."""
    return max(MIN_STEPS, ceil(END / dt - 1e-9))


def outcome(simulation: Simulation, dt: float, stiffness: float, damping: float) -> Outcome:
    """Run the simulation (opened with LIVE) from its start at dt [s], stiffness [N/m] and damping [N s/m]."""
    simulation.reset()
    simulation.set("method.dt", dt)
    simulation.set("springs.stiffness", stiffness)
    simulation.set("damping.coefficient", damping)
    asked = steps = steps_of(dt)
    look = simulation.check_interval = min(LOOK, steps // LOOKS)
    speeds: list[tuple[int, float]] = []
    greatest, quiet = 0.0, 0
    try:
        while simulation.step < steps and quiet < QUIET_LOOKS:
            simulation.advance(min(look, steps - simulation.step))
            simulation.check()
            velocity = simulation.read("velocity").astype(np.float64)
            speed = float(np.sqrt(np.mean(velocity * velocity)))
            greatest = max(greatest, speed)
            speeds.append((simulation.step, speed))
            quiet = quiet + 1 if speed < SETTLED / 100 * greatest else 0
            if simulation.step == steps < LONGER * asked and _rise(speeds) > RISING:
                steps *= 2
    except Diverged as diverged:
        note = f"diverged at step {diverged.step}, particle {diverged.particle}"
        return Outcome(DIVERGED, diverged.step, steps, None, note)
    share = speeds[-1][1] / greatest if greatest > 0 else 0.0
    code = SETTLES if share < SETTLED else GROWS if _rise(speeds) > RISEN else MOVING
    note = f"after {simulation.step} steps its speed is {share:.2g} of the greatest it had"
    return Outcome(code, None, steps, share, note)


def linear(scene: Scene) -> Scene:
    """The scene's net without rest length, gravity, and start: exactly linear."""
    return scene.replace(
        {"springs.rest_length": 0.0, "gravity.enabled": False, "external.magnitude": 0.0, "perturbation.amplitude": 0.0}
    )


def edge_start(scene: Scene) -> tuple[np.ndarray, float]:
    """(particles, 2) [m]: the fastest mode and STRAY of everything else, with its pins at the origin; and the largest
    frequency [1/s]. Raises SceneError for a grid too large to find its fastest mode."""
    found = scene_frequency(scene)
    if found.mode is None:
        count = scene.grid.particle_count
        raise SceneError("grid.rows x grid.columns", count, f"at most {MAX_MASSES} masses, if not hung by its top row")
    free = np.ones(scene.grid.particle_count, bool)
    free[pinned_indices(scene.grid)] = False
    shape = np.stack([found.mode, -found.mode], axis=1)
    shape[free] += wave(scene.grid, STRAY)[free]
    return shape, found.estimate


def measured_edge(simulation: Simulation, tolerance: float = TOLERANCE) -> float:
    """The step size [s] at which a linear net (opened with LIVE on its `linear` scene) begins to grow; 0: it does at the
    smallest; infinite: it never did. Found by doubling from a small step size, then by bisection to `tolerance`.

    Of use for schemes that hold at some step size: explicit Euler without a damper grows at all, in the end.
    """
    scene = simulation.scene
    shape, w = edge_start(scene)
    gamma = damping_rate(scene)
    start = State(shape, np.zeros_like(shape), simulation.body.inverse_mass, 0.0, 0)
    low = SMALLEST / w
    if grows(simulation, start, low, w, gamma):
        return 0.0
    high = 2 * low
    while not grows(simulation, start, high, w, gamma):
        low, high = high, 2 * high
        if high * w > LARGEST:
            return inf
    while high - low > tolerance * low:
        middle = sqrt(low * high)
        low, high = (low, middle) if grows(simulation, start, middle, w, gamma) else (middle, high)
    return sqrt(low * high)


def grows(simulation: Simulation, start: State, dt: float, w: float, gamma: float) -> bool:
    """Whether amplitudes grow at step size `dt` [s], from `start`; `w`: the net's largest frequency, `gamma`: damping
    rate [1/s].

    Amplitude: the root of v^2 + gamma x v + w^2 x^2 summed over the masses, which falls as exp(-gamma t / 2) in the
    fastest mode without wobble, so that a slow rise is seen. Ends as soon as it is decided.
    """
    simulation.load(start)
    simulation.set("method.dt", dt)
    simulation.check_interval = 2 * DAMPED_STEPS  # the amplitude itself is looked at
    cross = gamma if gamma < 1.8 * w else 0.0  # an overdamped mode: the form would not be positive
    first = _amplitude(simulation, w, cross)
    most = DAMPED_STEPS if gamma > 0 else UNDAMPED_STEPS
    looks: list[tuple[int, float]] = []
    while simulation.step < most:
        # few at first: far over the edge a step multiplies by thousands, and float32 ends at 3e38
        batch = max(4, min(simulation.step // 8, most // 64))
        simulation.advance(min(batch, most - simulation.step))
        amplitude = _amplitude(simulation, w, cross)
        if not isfinite(amplitude) or amplitude > GROWN * first:
            return True
        if amplitude < DECAYED * first:
            return False
        looks.append((simulation.step, amplitude))
        if gamma > 0 and simulation.step > FALL_STEPS and _rise(looks) < FALL:
            return False
    return _rise(looks) > (RISE if gamma > 0 else RISE_UNDAMPED)


def _rise(looks: list[tuple[int, float]]) -> float:
    """The largest of the second half of (step, amplitude) over that of the first; 0 where it cannot be told."""
    half = looks[-1][0] / 2
    early = max((amplitude for step, amplitude in looks if step <= half), default=0.0)
    return max(amplitude for step, amplitude in looks if step > half) / early if early > 0 else 0.0


def _amplitude(simulation: Simulation, w: float, cross: float) -> float:
    x = simulation.read("position").astype(np.float64)
    v = simulation.read("velocity").astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.sum(v * v + cross * x * v + w * w * x * x)))
