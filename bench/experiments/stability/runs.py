"""One point of the stability map, and one measured edge: the behaviour of an opened simulation at a step size.

Outcomes of a damped grid under gravity, some of whose masses are displaced, over END seconds:

 settles    it ends at less than SETTLED of its largest speed
 moving     it ends finite and still moves: bounded, but not at rest
 grows      it is finite so far, but faster in the second half of the time, even after LONGER times as long
 diverged   it is no longer finite, with the step of the divergence (model/core/stepping.py defines the check)

Speeds are root mean squares over the masses.

Edges are measured on a net whose springs have no rest length. Its equation is exactly linear, x'' = -A x - gamma x', so
that the largest frequency of A decides (model/core/stability/limit.py). The step size at which growth begins is found
by bisection of "does it grow?", without knowledge of the integrator.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf, isfinite, sqrt

import numpy as np

from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.build import pinned_indices, wave
from softlab.model.core.integrators import damping_rate
from softlab.model.core.simulation import Simulation, State
from softlab.model.core.stability.limit import MAX_MASSES, scene_frequency
from softlab.model.scene.scene import Scene

SETTLES, MOVING, GROWS, DIVERGED = 0, 1, 2, 3  # as stored
OUTCOMES = ("settles", "moving", "grows", "diverged")
LIVE = ("gravity", "dt", "stiffness", "damping")  # live, so that one opened simulation does a whole map

END = 6.0  # s: nine times the time in which a damping rate of 3/s takes amplitudes to 1/e
MIN_STEPS = 400  # smallest number of steps of a point, so that there is time to grow at large steps too
LONGER = 16  # a run with rising speeds continues for up to this many times as long
RISING, RISEN = 1.1, 1.5  # largest speed in the second half of the steps over the first's: continue above, grown above
SETTLED = 0.05
CHECK_STEPS, MIN_CHECKS = 256, 32  # the most steps between two checks, and the fewest checks
QUIET_CHECKS = 8  # consecutive checks at a speed below a hundredth of SETTLED that end a run early

TOLERANCE = 1e-3  # relative width of the interval in which an edge is found
GROWN, DECAYED = 1e4, 1e-3  # ratio to the initial amplitude at which growth or decay is decided
RISE = 1.02  # ratio of the second half's largest amplitude to the first half's: growth, if neither was reached
RISE_UNDAMPED = 2.0  # without damping, amplitudes fluctuate below the edge and grow fast above it
EARLY_STEPS = 2**12  # with damping, a rise or fall by RISE decides after that many steps
UNDAMPED_STEPS = 2**13  # without damping the slowest growth, of rk4, is 0.7 % per step at 1e-3 above the edge
DAMPED_STEPS = 2**17  # with damping that of explicit Euler, gamma dt / 2 times the excess: 1e-6 per step
STRAY = 1e-3  # amplitude of every other mode in the start, in case one of them grows first
SMALLEST, LARGEST = 1e-3, 1e3  # range of dt w in which an edge is searched
FIRST = 2**8 * SMALLEST  # where the search begins: near most edges, and few steps decide there


@dataclass(frozen=True)
class Outcome:
    """Result of a point.

    `code`: SETTLES, MOVING, GROWS or DIVERGED; `step`: the first bad one, or None; `steps`: requested in the end;
    `speed`: the last over the largest; `note`: in words.
    """

    code: int
    step: int | None
    steps: int
    speed: float | None
    note: str


def steps_of(dt: float) -> int:
    """Return the steps of a point at step size `dt` [s]."""
    return max(MIN_STEPS, ceil(END / dt - 1e-9))


def outcome(simulation: Simulation, dt: float, stiffness: float, damping: float) -> Outcome:
    """Run the simulation (opened with LIVE) from its start at dt [s], stiffness [N/m] and damping [N s/m]."""
    simulation.reset()
    simulation.set("method.dt", dt)
    simulation.set("springs.stiffness", stiffness)
    simulation.set("damping.coefficient", damping)
    asked = steps = steps_of(dt)
    interval = simulation.check_interval = min(CHECK_STEPS, steps // MIN_CHECKS)
    speeds: list[tuple[int, float]] = []
    greatest, quiet = 0.0, 0
    try:
        while simulation.step < steps and quiet < QUIET_CHECKS:
            simulation.advance(min(interval, steps - simulation.step))
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
    fraction = speeds[-1][1] / greatest if greatest > 0 else 0.0
    code = SETTLES if fraction < SETTLED else GROWS if _rise(speeds) > RISEN else MOVING
    note = f"after {simulation.step} steps its speed is {fraction:.2g} of the greatest it had"
    return Outcome(code, None, steps, fraction, note)


def linear(scene: Scene) -> Scene:
    """Return the scene's net without rest length, gravity and perturbation: exactly linear."""
    return scene.replace(
        {"springs.rest_length": 0.0, "gravity.enabled": False, "external.magnitude": 0.0, "perturbation.amplitude": 0.0}
    )


def edge_start(scene: Scene) -> tuple[np.ndarray, float]:
    """Return (positions (particles, 2) [m], largest frequency [1/s]) to start from.

    The positions are the fastest mode plus STRAY of everything else, with the pins at the origin. Raises SceneError for
    a grid too large to compute its fastest mode.
    """
    fastest = scene_frequency(scene)
    if fastest.mode is None:
        count = scene.grid.particle_count
        raise SceneError("grid.rows x grid.columns", count, f"at most {MAX_MASSES} masses, if not hung by its top row")
    free = np.ones(scene.grid.particle_count, bool)
    free[pinned_indices(scene.grid)] = False
    shape = np.stack([fastest.mode, -fastest.mode], axis=1)
    shape[free] += wave(scene.grid, STRAY)[free]
    return shape, fastest.estimate


def measured_edge(simulation: Simulation, tolerance: float = TOLERANCE) -> float:
    """Return the step size [s] above which a linear net (opened with LIVE on its `linear` scene) grows.

    0: it grows at the smallest step; infinite: it never grew. Found by halving or doubling from FIRST / w, then by
    bisection to `tolerance`. Only meaningful for schemes that are stable at some step size: explicit Euler without a
    damper always grows.
    """
    scene = simulation.scene
    shape, w = edge_start(scene)
    gamma = damping_rate(scene)
    start = State(shape, np.zeros_like(shape), simulation.body.inverse_mass, 0.0, 0)
    low, high = FIRST / w, inf
    while grows(simulation, start, low, w, gamma):
        low, high = low / 2, low
        if low * w < 0.75 * SMALLEST:
            return 0.0
    while high == inf:
        if 2 * low * w > LARGEST:
            return inf
        if grows(simulation, start, 2 * low, w, gamma):
            high = 2 * low
        else:
            low *= 2
    while high - low > tolerance * low:
        middle = sqrt(low * high)
        low, high = (low, middle) if grows(simulation, start, middle, w, gamma) else (middle, high)
    return sqrt(low * high)


def grows(simulation: Simulation, start: State, dt: float, w: float, gamma: float) -> bool:
    """Return True if amplitudes grow at step size `dt` [s], from `start`.

    `w`: the net's largest frequency, `gamma`: damping rate [1/s]. The amplitude is the root of v^2 + gamma x v + w^2
    x^2 summed over the masses. It falls as exp(-gamma t / 2) in the fastest mode without fluctuation, so that slow
    growth is visible. The run ends as soon as it is decided.
    """
    simulation.load(start)
    simulation.set("method.dt", dt)
    simulation.check_interval = 2 * DAMPED_STEPS  # this function checks the amplitude itself
    cross = gamma if gamma < 1.8 * w else 0.0  # an overdamped mode, for which the form would not be positive
    first = _amplitude(simulation, w, cross)
    most = DAMPED_STEPS if gamma > 0 else UNDAMPED_STEPS
    amplitudes: list[tuple[int, float]] = []
    while simulation.step < most:
        # few steps at first: far above the edge a step multiplies by thousands, and float32 ends at 3e38
        batch = max(4, min(simulation.step // 8, most // 64))
        simulation.advance(min(batch, most - simulation.step))
        amplitude = _amplitude(simulation, w, cross)
        if not isfinite(amplitude) or amplitude > GROWN * first:
            return True
        if amplitude < DECAYED * first:
            return False
        amplitudes.append((simulation.step, amplitude))
        if gamma > 0 and simulation.step > EARLY_STEPS and not 1 / RISE <= _rise(amplitudes) <= RISE:
            break
    return _rise(amplitudes) > (RISE if gamma > 0 else RISE_UNDAMPED)


def _rise(amplitudes: list[tuple[int, float]]) -> float:
    """Return the largest amplitude of the second half of (step, amplitude) over that of the first; 0 if it is
    undefined.
    """
    half = amplitudes[-1][0] / 2
    early = max((amplitude for step, amplitude in amplitudes if step <= half), default=0.0)
    return max(amplitude for step, amplitude in amplitudes if step > half) / early if early > 0 else 0.0


def _amplitude(simulation: Simulation, w: float, cross: float) -> float:
    x = simulation.read("position").astype(np.float64)
    v = simulation.read("velocity").astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.sum(v * v + cross * x * v + w * w * x * x)))
