"""Pictures, exports and descriptions of grids, cloths and meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.app.output.pieces import Piece, in_space
from softlab.app.presentation import Presentation, largest_strain, number_of_particles
from softlab.app.render import colours
from softlab.app.render.detail import Detail
from softlab.app.render.drawn_springs import alike, drawn_kinds
from softlab.app.render.legends import STRAIN_TITLE, ZERO_REST_TITLE
from softlab.app.render.view import View
from softlab.model.contact.cloth_parameters import REST_LENGTHS
from softlab.model.core.energy import spring_strain
from softlab.model.core.families import family_of
from softlab.model.core.family import Arrays
from softlab.model.core.spare import Counts
from softlab.model.core.stability.springs import spring_ends
from softlab.model.position_based.mesh_constraints import edges_of
from softlab.model.scene.scene import Scene


def _view(scene: Scene, detail: Detail, quick: bool, first_colour: int) -> View:
    from softlab.app.render.sheet_view import SheetView

    return SheetView(scene, detail)


def _lines(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Return the springs of a grid, or those of a cloth that are drawn, kind by kind."""
    grid = scene.grid
    if scene.dimensions == 2:
        return [(spring_ends(grid.rows, grid.columns), scene.springs.rest_length)] if scene.springs else []
    return [(spring_ends(grid.rows, grid.columns, k), REST_LENGTHS[k] * grid.spacing) for k in drawn_kinds(scene)]


def _edges(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Return the edges of a mesh that are drawn, by classes of rest lengths."""
    return [lines for kind in drawn_kinds(scene) for lines in alike(*edges_of(scene, kind))]


def _strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    if scene.dimensions == 2:
        return spring_strain(scene, position) if scene.springs else np.zeros(0)
    with np.errstate(over="ignore", invalid="ignore"):
        strains = [spring_strain(scene, position, kind) for kind in drawn_kinds(scene)]
    return np.concatenate([np.zeros(0), *strains])


def _pieces(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None, inverse_mass: np.ndarray | None
) -> list[Piece]:
    """Return the sheet as its triangles, or else its lines; without springs, as its masses."""
    name = next((name for name, part in scene.parts.items() if part is scene.grid), "grid")
    triangles = scene.grid.triangles() if scene.dimensions == 3 else np.zeros((0, 3), np.int32)
    if len(triangles):
        return [Piece(name, position, colours.CLOTH_FRONT, triangles, scene.grid.normals(position))]
    index = np.arange(len(position)).reshape(scene.grid.rows, scene.grid.columns)
    has_springs = bool(scene.springs or scene.cloth_springs)
    lines = tuple(line for line in (*index, *index.T) if len(line) > 1) if has_springs else ()
    return [Piece(name, in_space(position), colours.INK, lines=lines)]


def _amounts(scene: Scene, totals: Counts) -> str:
    from softlab.app.command.tables import number

    return f"{number(scene.grid.particle_count)} masses, {number(family_of(scene).spring_count(scene))} springs"


def _max_strain(scene: Scene, position: np.ndarray, arrays: Arrays) -> float | None:
    return 0.0 if scene.dimensions == 2 and scene.springs is None else largest_strain(scene, position, arrays)


def _legend(scene: Scene) -> str | None:
    if not scene.springs and not scene.cloth_springs:
        return None
    return ZERO_REST_TITLE if scene.springs and not scene.springs.rest_length else STRAIN_TITLE


SHEET = Presentation(
    view=_view,
    lines=_lines,
    strain=_strain,
    pieces=_pieces,
    amounts=_amounts,
    brief=lambda scene, totals: f"{scene.grid.rows} x {scene.grid.columns} masses",
    size=lambda scene: f"{scene.grid.rows} x {scene.grid.columns}",
    max_strain=_max_strain,
    drawn=lambda scene: ("normal",) if scene.dimensions == 3 else (),
    legend=_legend,
    steps_per_frame=10,
)
MESH = replace(SHEET, lines=_edges, size=number_of_particles)
