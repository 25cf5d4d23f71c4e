"""A sheet as something to draw: its springs, and how far they are stretched. No OpenGL."""

from __future__ import annotations

import numpy as np

from softlab.model.contact.cloth_parameters import REST_LENGTHS
from softlab.model.core.energy import spring_strain
from softlab.model.core.stability.springs import spring_ends
from softlab.model.scene.scene import Scene
from softlab.model.xpbd.mesh_constraints import edges_of

ALIKE = 0.01  # of a rest length: strains are drawn as true as that


def drawn_kinds(scene: Scene) -> list[str]:
    """The kinds of a cloth's springs that are drawn as lines: bending ones lie on top of others, where there are others."""
    kinds = list(scene.cloth_springs)
    return [kind for kind in kinds if kind != "bending"] or kinds


def drawn_lines(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """[(ends (springs, 2), their rest length [m])]: the springs of a grid, or those of a cloth that are drawn, kind by kind.

    Of a mesh by classes of rest lengths that differ by less than ALIKE, each with its mean.
    """
    grid = scene.grid
    if scene.fluids:
        return []
    if scene.dimensions == 2:
        return [(spring_ends(grid.rows, grid.columns), scene.springs.rest_length)] if scene.springs else []
    if scene.tetrahedra:
        return alike(*scene.tetrahedra_set.edges)
    if not scene.mesh:
        return [(spring_ends(grid.rows, grid.columns, k), REST_LENGTHS[k] * grid.spacing) for k in drawn_kinds(scene)]
    found = []
    for kind in drawn_kinds(scene):
        found += alike(*edges_of(scene, kind))
    return found


def alike(ends: np.ndarray, rest: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """`ends` (edges, 2) by classes of rest lengths (edges,) [m] that differ by less than ALIKE, each with its mean."""
    number = np.floor(np.log(rest / rest.min()) / np.log1p(ALIKE)).astype(int) if len(rest) else rest
    return [(ends[number == n], float(rest[number == n].mean())) for n in np.unique(number)]


def drawn_strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(springs,) float64: (length - rest) / rest of the springs that are drawn, of a grid or a cloth; (0,) without. Of bodies
    (entries,), how far particles are from their goals, in spacings; of a world of one member after the other."""
    if scene.is_world:
        places = scene.world_set.slices()
        return np.concatenate([drawn_strain(one, position[places[name]]) for name, one in scene.members.items()])
    if scene.fluids:
        return np.zeros(0)
    if scene.bodies or scene.tetrahedra:
        return spring_strain(scene, position)
    if not scene.cloth:
        return spring_strain(scene, position) if scene.springs else np.zeros(0)
    with np.errstate(over="ignore", invalid="ignore"):
        strains = [spring_strain(scene, position, kind) for kind in drawn_kinds(scene)]
    return np.concatenate([np.zeros(0), *strains])
