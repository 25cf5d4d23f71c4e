"""Constants for the kernels of a cloth's self-contacts, and the sizes of their tables."""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.core.parameters import rounded_record
from softlab.model.geometry.lists import grouped
from softlab.model.geometry.sheets import sheet_triangles
from softlab.model.scene.scene import Scene
from softlab.model.tables.self_collision import MAX_CONTACTS as MAX_CONTACTS

SELF_CONTACT_PARAMETERS = (
    "thickness",  # m
    "margin",  # m: how much a mass may come nearer than predicted within a substep, through constraints
    "reach",  # m: largest search distance, in addition to the extent of the sheet's cells
    "inverse_cell",  # 1/m, cells of space
    "spacing",  # m
    "normal_distance",  # m: nearer than this a triangle's own normal is used
    "coincident",  # m: nearer than this there is no side
    "push",  # m: how far an overlap is reduced within a substep
    "static_friction",
    "dynamic_friction",
)
MARGIN = 0.1  # thicknesses
FLAT = 0.0625  # thicknesses: at that distance an ulp of a coordinate is still small relative to it in float32
COINCIDENT = 1e-3  # thicknesses
SPAN = 8  # largest number of cells of space that a mass searches along an axis: both directions of the search distance
SEARCHED = 3.0  # cells of space, in each direction: masses that move farther in a substep invalidate any prediction


def cell_size(scene: Scene) -> float:
    """Return the edge of the cells of space [m]: twice the search distance of a mass at rest, so that it searches at
    most eight cells."""
    assert scene.self_collision is not None
    thickness = scene.self_collision.thickness
    return 2 * (scene.grid.spacing * 0.75 + thickness * (1 + MARGIN))  # half a cell's diagonal: 0.71 spacings


def contact_record(scene: Scene, real: Real) -> np.ndarray:
    """Return SELF_CONTACT_PARAMETERS in the arithmetic `real`, (1,): computed in float64, rounded once. Raises
    SceneError."""
    part = scene.self_collision
    assert part is not None
    h, size = scene.method.dt / scene.method.substeps, cell_size(scene)
    values = {
        "thickness": part.thickness,
        "margin": MARGIN * part.thickness,
        "reach": SEARCHED * size,
        "inverse_cell": 1 / size,
        "spacing": scene.grid.spacing,
        "normal_distance": FLAT * part.thickness,
        "coincident": COINCIDENT * part.thickness,
        "push": part.separation_speed * h,
        "static_friction": part.static_friction,
        "dynamic_friction": part.dynamic_friction,
    }
    assert tuple(values) == SELF_CONTACT_PARAMETERS, (
        f"{set(values) ^ set(SELF_CONTACT_PARAMETERS)} or their order differ"
    )
    return rounded_record(scene, values, {name: f"self_collision.{name}" for name in values}, real)


def triangles_around(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the triangles at each mass of a sheet: offsets (masses + 1,), triangles (all entries,) and the corners of
    each triangle (triangles, 3), int32."""
    corners = sheet_triangles(rows, columns).astype(np.int32)
    lists = grouped(corners.ravel(), np.repeat(np.arange(len(corners)), 3), rows * columns)
    return lists.offsets, lists.indices, corners


def table_size(entries: int) -> int:
    """Return the size of the hash table: a power of two, at least twice the entries (Teschner et al. 2003, section
    5)."""
    return 1 << max(1, (2 * entries - 1).bit_length())
