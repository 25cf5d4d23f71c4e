"""One strip of the lab's grid under all three solvers: its sag, its frequency, and its resistance to shear.

A strip of LENGTH [m] below its pins (or beside them) and WIDTH [m] across, with one material at every spacing d:
springs of k = STIFFNESS [N/m] and masses of k d^2 / c^2, so that waves travel along it at c = SPEED [m/s]. As a rod it
sags by g L^2 / (2 c^2) and its first frequency is c / (4 L). Rows stay straight, so that each number follows from a
chain:

- springs, n links and masses: a sag of (1 + 1/n) times that, and w = 2 c/d sin(pi / (4 n + 2));
- an oscillator of w in steps of h: 2/h asin(w h / 2) by velocity Verlet, atan(w h) / h by implicit Euler;
- clusters: the linear system of `chain_of_clusters`.

Springs alone do not resist shear: a strip that is fixed at its side then hangs down from there, whatever its load. A
strip of clusters bends like a beam; WEIGHT is its g.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from math import asin, atan, pi, sin
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.measure.costs_timing import Measures
from softlab.model.base.errors import BackendUnavailable, Diverged, UnstableTimeStep
from softlab.model.base.table import Table
from softlab.model.core.build import build, rest_positions
from softlab.model.core.simulation import Simulation, State
from softlab.model.core.stability.springs import matching_stiffness
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.matching import lattice_clusters

LENGTH, WIDTH = 1.0, 0.25  # m
SPEED = 8.0  # m/s, c
STIFFNESS = 10.0  # N/m, k
GRAVITY, WEIGHT = 9.81, 0.1  # m/s^2: of the hanging strip, and of the strip that is loaded across
FRAME = 1 / 60  # s
SWING = 0.01  # m: the amplitude at its end
FRAMES = 96  # frames of a vibration, about three periods
REST_FRAMES, ACROSS_FRAMES = 600, 3600  # frames to rest: by e^-30; for a pendulum of this length by e^-19
REST_RATE, ACROSS_RATE = 6.0, 0.63  # 1/s: of the dampers used to reach rest, all below critical damping
OPTIONS: dict[str, Any] = {"precision": "float64", "math": "exact"}
SHARED = ("gravity", "damping")  # live fields: scenes without these forces use the same kernels and add zeros

SAG, FREQUENCY, DECAY, ACROSS = "bar_sag", "bar_frequency", "bar_decay", "bar_across"  # m; 1/s; 1/s; m
REFUSED = "refused"  # prefix of the reason of a missing number


def rod_sag() -> float:
    """Sag [m] of the end of a hanging rod of the material, rho g L^2 / (2 E)."""
    return GRAVITY * LENGTH**2 / (2 * SPEED**2)


def rod_frequency() -> float:
    """Frequency [1/s] of the first longitudinal vibration of a rod fixed at one end, sqrt(E / rho) / (4 L)."""
    return SPEED / (4 * LENGTH)


def beam_tip() -> float:
    """Displacement [m] of the end of a beam of the clusters' material, fixed at its side, by its own weight.

    Bending and shear, S. P. Timoshenko (1921): q L^4 / (8 E I) + q L^2 / (2 kappa G A), with kappa = 5/6 for a
    rectangle. Clusters that store w^2 m |goal - x|^2 / 2 do not shrink across when they are stretched, so that E = 2 G.
    """
    return WEIGHT * (12 * LENGTH**4 / (8 * WIDTH**2) + 2 * LENGTH**2 / (2 * 5 / 6)) / SPEED**2


def chain_sag(links: int) -> float:
    """Sag [m] of a chain of springs, m g / k (1 + 2 + ... + n)."""
    return rod_sag() * (1 + 1 / links)


def chain_frequency(links: int) -> float:
    """First frequency [1/s] of a chain of springs that is fixed at one end."""
    return 2 * SPEED * links / LENGTH * sin(pi / (4 * links + 2)) / (2 * pi)


def verlet_frequency(frequency: float, h: float) -> float:
    """Frequency [1/s] of an oscillator integrated by velocity Verlet in steps of h [s]."""
    return asin(pi * frequency * h) / (pi * h)


def implicit_frequency(frequency: float, h: float) -> float:
    """Frequency [1/s] of an oscillator integrated by implicit Euler in steps of h [s]."""
    return atan(2 * pi * frequency * h) / (2 * pi * h)


def strip(links: int, method: Table, load: str = SAG) -> Scene:
    """Return the strip with `links` along it under a method's fields.

    It hangs with a damper (SAG), has neither weight nor damper (FREQUENCY), or is fixed at its left side (ACROSS).
    """
    spacing = LENGTH / links
    mass = STIFFNESS * (spacing / SPEED) ** 2
    along, across = links + 1, max(1, round(WIDTH / spacing))
    beside = load == ACROSS
    rates = {SAG: REST_RATE, FREQUENCY: 0.0, ACROSS: ACROSS_RATE}
    weights = {SAG: GRAVITY, FREQUENCY: 0.0, ACROSS: WEIGHT}
    return Scene(
        {
            "title": "Bar",
            "grid": {
                "rows": across if beside else along, "columns": along if beside else across, "spacing": spacing,
                "mass": mass, "pinned": "left" if beside else "top",
            },
            "springs": {"stiffness": STIFFNESS, "rest_length": spacing},
            "damping": {"coefficient": rates[load] * mass},
            "gravity": {"acceleration": weights[load]},
            "method": method,
        },
        "bar",
    )  # fmt: skip


def method_of(solver: str, substeps: int, iterations: int = 1, region: int = 1) -> Table:
    """Return the fields of a method that divides a frame into so many substeps; for mass-spring, into steps."""
    if solver == "mass-spring":
        return {"solver": solver, "integrator": "velocity-verlet", "dt": FRAME / substeps}
    solver_fields = {"region": region} if solver == "shape-matching" else {}
    return {"solver": solver, "dt": FRAME, "substeps": substeps, "iterations": iterations, **solver_fields}


def frame_steps(scene: Scene) -> int:
    """Return the number of steps of the scene per frame."""
    return round(FRAME / scene.method.dt)


def follow(simulation: Simulation, shape: np.ndarray, frames: int) -> np.ndarray:
    """Return (frames + 1,): the displacement from the start along `shape` (particles, dimensions) per frame. Raises
    Diverged.
    """
    begin = simulation.body.position
    displacements = []
    for frame in range(frames + 1):
        if frame:
            simulation.advance(frame_steps(simulation.scene))
        displacements.append(float(np.sum((simulation.read("position") - begin) * shape) / np.sum(shape**2)))
    simulation.check()
    return np.array(displacements)


def swing_of(displacements: np.ndarray, step: float) -> tuple[float, float]:
    """Return (frequency, decay) [1/s] of a vibration sampled every `step` [s].

    A linear step obeys x'' = s x' - d x; s and d by least squares (Prony 1795). Its eigenvalues have the square d and
    the real part s / 2.
    """
    matrix = np.stack([displacements[1:-1], -displacements[:-2]], axis=1)
    (s, d), *_ = np.linalg.lstsq(matrix, displacements[2:], rcond=None)
    angle = np.arccos(np.clip(s / (2 * np.sqrt(d)), -1, 1))
    return float(angle / (2 * np.pi * step)), float(-np.log(d) / (2 * step))


def returns_measures(*names: str) -> Callable[[Callable[..., Measures]], Callable[..., Measures]]:
    """Make the decorator of measurements that return the measures `names`.

    If a step size is refused, a backend lacks the solver, or the run diverged, the measures have no value but a reason.
    """

    def around(measure: Callable[..., Measures]) -> Callable[..., Measures]:
        @wraps(measure)
        def tried(*arguments: Any) -> Measures:
            try:
                return measure(*arguments)
            except (UnstableTimeStep, BackendUnavailable) as error:
                return {name: (float("nan"), "", f"{REFUSED}: {error}") for name in names}
            except Diverged as error:
                return {name: (float("inf"), "", str(error)) for name in names}

        return tried

    return around


@returns_measures(SAG)
def hang(scene: Scene, backend: str) -> Measures:
    """Measure SAG: the downward displacement of the strip's lower end at rest, from its place without weight."""
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(REST_FRAMES * frame_steps(scene))
        lowest = simulation.state().position[-1, 1]
    return {SAG: (float(-LENGTH - lowest), "m", f"rod: {rod_sag():.6g}")}


@returns_measures(FREQUENCY, DECAY)
def swing(scene: Scene, backend: str) -> Measures:
    """Measure FREQUENCY and DECAY of the first longitudinal mode, released at rest in the shape of a chain's mode."""
    rest, links = rest_positions(scene.grid), scene.grid.rows - 1
    place = np.arange(scene.grid.particle_count) // scene.grid.columns
    shape = np.zeros_like(rest)
    shape[:, 1] = -np.sin(pi * place / (2 * links + 1))
    begin = State(rest + SWING * shape, np.zeros_like(rest), build(scene).inverse_mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, live=SHARED, **OPTIONS) as simulation:
        frequency, decay = swing_of(follow(simulation, shape, FRAMES), FRAME)
    return {FREQUENCY: (frequency, "1/s", f"rod: {rod_frequency():.6g}"), DECAY: (decay, "1/s", None)}


@returns_measures(ACROSS)
def bend(scene: Scene, backend: str) -> Measures:
    """Measure ACROSS: the downward displacement at rest of the end of a strip that is fixed at its left side."""
    with open_simulation(scene, backend, **OPTIONS) as simulation:
        simulation.advance(ACROSS_FRAMES * frame_steps(scene))
        moved = simulation.state().position - rest_positions(scene.grid)
    end = moved.reshape(scene.grid.rows, scene.grid.columns, 2)[:, -1, 1].mean()
    return {ACROSS: (float(-end), "m", f"beam: {beam_tip():.6g}")}


def chain_of_clusters(scene: Scene) -> tuple[float, float]:
    """Return (SAG, FREQUENCY) of a strip by shape matching, computed from its clusters.

    With K u = sum share (x - goal) of a row's displacement u, a substep h is at rest where K u = g / w^2 + h^2 (g - K
    g) on free rows, and takes a mode of K's eigenvalue e to z^2 = (1 - b e)(2 z - 1), b = w^2 h^2 / (1 + w^2 h^2), with
    one iteration.
    """
    column = scene.replace({"grid.columns": 1, "method.iterations": 1})
    clusters, n = lattice_clusters(column), column.grid.rows
    w2, h = matching_stiffness(column), column.method.dt / column.method.substeps
    mean = np.zeros((clusters.count, n))
    np.add.at(mean, (clusters.owner, clusters.indices), clusters.masses / clusters.cluster_mass[clusters.owner])
    matrix = np.zeros((n, n))
    np.add.at(matrix, (clusters.indices, clusters.indices), clusters.weights)
    np.add.at(matrix, clusters.indices, -clusters.weights[:, None] * mean[clusters.owner])
    gravity = np.concatenate([[0.0], np.full(n - 1, scene.gravity.acceleration if scene.gravity else 0.0)])
    load = gravity * (1 / w2 + h**2) - h**2 * matrix @ gravity
    sag = np.linalg.solve(matrix[1:, 1:], load[1:])[-1]
    softest = float(np.linalg.eigvals(matrix[1:, 1:]).real.min())
    b = w2 * h**2 / (1 + w2 * h**2)
    return float(sag), float(np.arccos(np.sqrt(1 - b * softest)) / (2 * np.pi * h))
