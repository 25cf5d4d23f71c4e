"""Arrays of a scene: the masses in builder order (row-major, row 0 on top), pins, inverse masses."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakValueDictionary

import numpy as np

from softlab.model.base.memory import require_sheet
from softlab.model.base.pins import pin_indices
from softlab.model.geometry.arithmetic.functions import cosine, sine
from softlab.model.geometry.particle_row import PARKED
from softlab.model.geometry.sheets import sheet_positions
from softlab.model.geometry.topology import mesh_of, pinned_vertices
from softlab.model.particles.particle_set import Particles, ParticleSet
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Cloth, Fold
from softlab.model.tables.flow import spatial
from softlab.model.tables.kinds import SHEETS
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.self_collision import CONTACT_BYTES

MASS_BYTES = 160  # host memory per mass: position, velocity and inverse mass in float64, two solver states, a snapshot


@dataclass(frozen=True)
class Body:
    """Arrays from which a solver starts, read-only: simulations of one scene share them.

    `position`, `velocity`: (particles, dimensions) float64; `inverse_mass`: (particles,) float64, 0 where pinned;
    `pinned`: sorted indices (int64); `size`: length [m] that scales the divergence limit, from the `centre` [m] of the
    scene (dimensions,).
    """

    rows: int
    columns: int
    position: np.ndarray
    velocity: np.ndarray
    inverse_mass: np.ndarray
    pinned: np.ndarray
    size: float
    centre: np.ndarray


def starts(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return where particles start, (places, dimensions) [m]: the active ones of `position`, and the centres of emitters.

    Without any of them it is the origin.
    """
    active = position[position[:, 0] != PARKED]
    emitters = [spatial(emitter.center)[: scene.dimensions] for emitter in scene.emitters.values()]
    places = np.concatenate([active, emitters]) if emitters else active
    return places if len(places) else np.zeros((1, scene.dimensions))


def sheet_name(scene: Scene) -> str:
    """Return the name of the scene's sheet; `bodies` where it has bodies."""
    return scene.name_of(*SHEETS) or "bodies"


def pinned_indices(grid: Particles) -> np.ndarray:
    """Return the sorted flat indices (row * columns + column) of the masses in `grid.pinned`."""
    if isinstance(grid, ParticleSet):
        return grid.pinned_vertices
    if isinstance(grid, Mesh) and grid.file is not None:
        return pinned_vertices(grid)
    return pin_indices(grid.pinned, grid.rows, grid.columns)


def rest_positions(grid: Particles) -> np.ndarray:
    """Return the rest positions, (particles, dimensions) float64 [m]: (column * spacing, -row * spacing), row-major.

    A cloth's start at its origin: in z = const where it hangs, along +z instead of -y where it lies. A mesh has those
    of its vertices.
    """
    if isinstance(grid, ParticleSet):
        return grid.position
    if isinstance(grid, Mesh):
        return mesh_of(grid).position + grid.origin
    if not isinstance(grid, Cloth):
        return sheet_positions(grid.rows, grid.columns, grid.spacing, axes=2).reshape(-1, 2)
    position = sheet_positions(grid.rows, grid.columns, grid.spacing, flat=grid.placement == "flat")
    position += grid.origin
    return position.reshape(-1, 3)


def folded_positions(cloth: Cloth, fold: Fold) -> np.ndarray:
    """Return `rest_positions` with the rows along a zig-zag line, (particles, 3) float64 [m]."""
    long = fold.rows - 1
    layer, place = np.divmod(np.arange(cloth.rows), long + fold.apart)
    along = np.minimum(place, long)
    along = np.where(layer % 2 == 1, long - along, along) * cloth.spacing
    across = (layer * fold.apart + np.maximum(place - long, 0)) * cloth.spacing
    position = rest_positions(cloth).reshape(cloth.rows, cloth.columns, 3)
    flat = cloth.placement == "flat"
    position[:, :, 2] = (along if flat else across)[:, None] + cloth.origin[2]
    position[:, :, 1] = (across if flat else -along)[:, None] + cloth.origin[1]
    return position.reshape(-1, 3)


def wave(grid: Particles, amplitude: float) -> np.ndarray:
    """Return the displacements amplitude * [sin(1.7 i + 0.9 j), cos(0.6 i - 1.3 j)], (particles,
    dimensions) [m].

    i = row, j = column. A cloth also has amplitude * sin(0.8 i - 0.7 j) along z.
    """
    i, j = np.divmod(np.arange(grid.particle_count), grid.columns)
    axes = [sine(1.7 * i + 0.9 * j), cosine(0.6 * i - 1.3 * j)]
    if isinstance(grid, Cloth):
        axes.append(sine(0.8 * i - 0.7 * j))
    return amplitude * np.stack(axes, axis=1)


_built: WeakValueDictionary[str, Body] = WeakValueDictionary()  # those in use by an open simulation


def build(scene: Scene) -> Body:
    """Return the scene's masses at time 0.

    The same Body is returned while anything refers to it, since a large one takes seconds to make. Raises SceneError
    where the masses do not fit into memory or into 32-bit indices.
    """
    key = scene.canonical()
    body = _built.get(key)
    if body is None:
        body = _built[key] = _build(scene)
    return body


def some_of(whole: Body, chosen: slice | np.ndarray, rows: int = 1) -> Body:
    """Return the particles `chosen` of the whole in `rows` rows, with its `size` and `centre`. A slice gives views of its
    arrays."""
    inverse_mass = whole.inverse_mass[chosen]
    return Body(
        rows, len(inverse_mass) // rows, whole.position[chosen], whole.velocity[chosen], inverse_mass,
        np.flatnonzero(inverse_mass == 0), whole.size, whole.centre,
    )  # fmt: skip


def _build(scene: Scene) -> Body:
    grid = scene.grid
    count = grid.particle_count
    needed = MASS_BYTES + (CONTACT_BYTES if scene.self_collision else 0)
    require_sheet(grid.rows, grid.columns, needed, sheet_name(scene))
    cloth, fold = scene.cloth, scene.fold
    position = folded_positions(cloth, fold) if cloth and fold else rest_positions(grid)
    velocity, waiting = np.zeros(position.shape), None
    if isinstance(grid, ParticleSet):  # whose arrays are its own, a sheet's are new
        position, velocity, waiting = position.copy(), grid.velocity.copy(), grid.waiting
    pinned = pinned_indices(grid)
    inverse_mass = 1 / np.broadcast_to(masses(scene), (count, 1))[:, 0]
    inverse_mass[pinned] = 0
    if waiting is not None:
        inverse_mass[waiting] = 0
    free = inverse_mass > 0
    if scene.perturbation:
        position[free] += wave(grid, scene.perturbation.amplitude)[free]
    rest_length = scene.springs.rest_length if scene.springs else 0.0
    places = starts(scene, position)
    low, high = places.min(axis=0), places.max(axis=0)
    size = max(grid.extent, float((high - low).max()), max(grid.rows, grid.columns) * rest_length)
    return Body(grid.rows, grid.columns, position, velocity, inverse_mass, pinned, size, low + (high - low) / 2)


def masses(scene: Scene, waiting: np.ndarray | None = None) -> np.ndarray | float:
    """Return the mass of each particle [kg], pinned or not: (particles, 1), or one number where all are equal.

    `waiting`: (particles,) bool; inactive particles of bodies or fluids get the mass 0.
    """
    if isinstance(scene.grid, ParticleSet):
        return (scene.grid.masses if waiting is None else np.where(waiting, 0.0, scene.grid.masses))[:, None]
    by_area = scene.grid.masses_by_area()
    if by_area is not None:
        return by_area[:, None]
    if not scene.loads:
        return scene.grid.mass
    mass = np.full((scene.grid.particle_count, 1), scene.grid.mass)
    for load in scene.loads.values():
        mass[load.at[0] * scene.grid.columns + load.at[1]] = load.mass
    return mass
