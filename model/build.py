"""Description -> arrays: the grid's masses in builder order (row-major, row 0 on top), its pins, its constants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.errors import SceneError
from model.integrators import damping_rate
from model.memory import available_bytes, require
from model.scene import Grid, Scene

MOST_PARTICLES = 2**31 - 1  # flat indices are 32-bit on the GPU


@dataclass(frozen=True)
class Body:
    """The arrays a solver starts from. float64; `position`, `velocity` (particles, 2); `inverse_mass` (particles,), 0
    where pinned; `pinned` sorted indices (int64); `size` [m]: the length that divergence is measured against."""

    rows: int
    columns: int
    position: np.ndarray
    velocity: np.ndarray
    inverse_mass: np.ndarray
    pinned: np.ndarray
    size: float


def pinned_indices(grid: Grid) -> np.ndarray:
    """Sorted flat indices (row * columns + column) of the masses that `grid.pinned` names."""
    rows, columns, pinned = grid.rows, grid.columns, grid.pinned
    if isinstance(pinned, list):
        return np.unique(np.array([row * columns + column for row, column in pinned], dtype=np.int64))
    if pinned == "none":
        return np.zeros(0, dtype=np.int64)
    if pinned == "top":
        return np.arange(columns, dtype=np.int64)
    if pinned == "top-corners":
        return np.unique(np.array([0, columns - 1], dtype=np.int64))
    if pinned == "edges":
        index = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
        return np.unique(np.concatenate([index[0], index[-1], index[:, 0], index[:, -1]]))
    return np.arange(0, columns, int(pinned.removeprefix("every:")), dtype=np.int64)


def rest_positions(grid: Grid) -> np.ndarray:
    """(particles, 2) float64 [m]: (column * spacing, -row * spacing), row-major."""
    position = np.empty((grid.rows, grid.columns, 2))
    position[:, :, 0] = np.arange(grid.columns) * grid.spacing
    position[:, :, 1] = -(np.arange(grid.rows) * grid.spacing)[:, None]
    return position.reshape(-1, 2)


def wave(grid: Grid, amplitude: float, time: float = 0.0) -> np.ndarray:
    """(particles, 2) [m]: amplitude * [sin(2 t + 1.7 i + 0.9 j), cos(3 t + 0.6 i - 1.3 j)], i = row, j = column."""
    i, j = np.divmod(np.arange(grid.particle_count), grid.columns)
    return amplitude * np.stack([np.sin(2 * time + 1.7 * i + 0.9 * j), np.cos(3 * time + 0.6 * i - 1.3 * j)], axis=1)


def build(scene: Scene) -> Body:
    """The scene's masses at time 0. Raises SceneError where they would not fit into memory or into 32-bit indices."""
    grid = scene.grid
    count = grid.particle_count
    # state and copies on the host: position, velocity and inverse mass in float64, two solver states, a snapshot
    require(count * 160, available_bytes(), "grid.rows x grid.columns", f"{grid.rows} x {grid.columns}", "main memory")
    if count > MOST_PARTICLES:
        raise SceneError(
            "grid.rows x grid.columns",
            f"{grid.rows} x {grid.columns}",
            f"at most {MOST_PARTICLES} masses (32-bit indices)",
        )
    position = rest_positions(grid)
    velocity = np.zeros_like(position)
    pinned = pinned_indices(grid)
    inverse_mass = np.full(count, 1 / grid.mass)
    inverse_mass[pinned] = 0
    free = inverse_mass > 0
    if scene.perturbation:
        position[free] += wave(grid, scene.perturbation.amplitude)[free]
    if scene.manufactured:
        amplitude = scene.manufactured.amplitude
        i, j = np.divmod(np.arange(count), grid.columns)
        position += wave(grid, amplitude)
        velocity[:, 0] = 2 * amplitude * np.cos(1.7 * i + 0.9 * j)
        velocity[:, 1] = -3 * amplitude * np.sin(0.6 * i - 1.3 * j)
        velocity[pinned] = 0
    rest_length = scene.springs.rest_length if scene.springs else 0.0
    size = max(grid.rows, grid.columns) * max(grid.spacing, rest_length)
    return Body(grid.rows, grid.columns, position, velocity, inverse_mass, pinned, size)


PARAMETERS = (
    "dt",  # s
    "half_dt",
    "half_dt_squared",
    "sixth_dt",
    "third_dt",
    "stiffness",  # spring stiffness over mass, 1/s^2
    "stiffness_rest",  # times the rest length, m/s^2
    "damping",  # damping rate, 1/s
    "inverse_damping",  # 1 / (1 + dt rate / 2)
    "gravity",  # m/s^2, along +y (so negative)
    "external",  # external force magnitude over mass, m/s^2
    "poke_x",  # poke over mass, m/s^2
    "poke_y",
    "amplitude",  # of the manufactured solution, m
    "inertia",
    "spacing",  # m
)
INDEX = {name: k for k, name in enumerate(PARAMETERS)}


def parameter_record(scene: Scene, real: type, poke: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """The small record every kernel reads its constants from: (len(PARAMETERS),) in the arithmetic `real`.

    Computed in float64 and rounded once, so that both backends hold the same bits. Raises SceneError for a value that
    the arithmetic cannot hold (it overflows, or vanishes where it must not).
    """
    grid, dt, mass = scene.grid, scene.method.dt, scene.grid.mass
    springs, manufactured = scene.springs, scene.manufactured
    rate = damping_rate(scene)
    values = {
        "dt": dt,
        "half_dt": dt / 2,
        "half_dt_squared": dt * dt / 2,
        "sixth_dt": dt / 6,
        "third_dt": dt / 3,
        "stiffness": springs.stiffness / mass if springs else 0.0,
        "stiffness_rest": springs.stiffness * springs.rest_length / mass if springs else 0.0,
        "damping": rate,
        "inverse_damping": 1 / (1 + dt * rate / 2),
        "gravity": -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0,
        "external": scene.external.magnitude / mass if scene.external else 0.0,
        "poke_x": poke[0] / mass,
        "poke_y": poke[1] / mass,
        "amplitude": manufactured.amplitude if manufactured else 0.0,
        "inertia": manufactured.inertia if manufactured else 1.0,
        "spacing": grid.spacing,
    }
    with np.errstate(over="ignore", under="ignore"):
        record: np.ndarray = np.array([values[name] for name in PARAMETERS], dtype=np.float64).astype(real)
    limits = np.finfo(real)
    for name, field in (
        ("dt", "method.dt"),
        ("half_dt_squared", "method.dt"),
        ("stiffness", "springs.stiffness"),
        ("stiffness_rest", "springs.rest_length"),
        ("damping", "damping.coefficient"),
        ("gravity", "gravity.acceleration"),
        ("external", "external.magnitude"),
        ("poke_x", "poke"),
        ("poke_y", "poke"),
        ("amplitude", "manufactured.amplitude"),
        ("spacing", "grid.spacing"),
    ):
        kept, exact = float(record[INDEX[name]]), values[name]
        if not math.isfinite(kept) or (exact != 0 and abs(kept) < float(limits.tiny)):
            given = scene.as_dict()
            part, _, key = field.partition(".")
            raise SceneError(
                field,
                given.get(part, {}).get(key, exact),
                f"{name} = {exact:.3g} is outside what {np.dtype(real).name} can hold "
                f"({float(limits.tiny):.2g} to {float(limits.max):.2g}); change it (or the mass), or use float64",
            )
    return record
