"""Pictures, exports and descriptions of tetrahedral bodies and a cloth beside them."""

from __future__ import annotations

import numpy as np

from softlab.app.output.pieces import Piece
from softlab.app.presentation import Presentation
from softlab.app.render import colours
from softlab.app.render.detail import Detail
from softlab.app.render.drawn_springs import alike
from softlab.app.render.legends import EDGE_TITLE
from softlab.app.render.view import View
from softlab.model.base.components import named
from softlab.model.core.energy import spring_strain
from softlab.model.geometry.normals import mesh_normals
from softlab.model.scene.scene import Scene


def _view(scene: Scene, detail: Detail, quick: bool, first_colour: int) -> View:
    from softlab.app.render.tetrahedra_view import TetrahedraView

    return TetrahedraView(scene, detail, first_colour)


def _pieces(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None, inverse_mass: np.ndarray | None
) -> list[Piece]:
    """Return the skins of tetrahedral bodies, deformed by their tetrahedra, and of a cloth beside them."""
    skin = scene.tetrahedra_set.skin
    points = skin.points(position)
    normals = mesh_normals(points, skin.faces)
    pieces = []
    for number, (name, triangles) in enumerate(zip(scene.holdable, skin.triangles, strict=True)):
        low, high = int(triangles.min()), int(triangles.max()) + 1
        colour = colours.BODIES[number % len(colours.BODIES)]
        pieces.append(Piece(name, points[low:high], colour, triangles - low, normals[low:high]))
    return pieces


def _counts(scene: Scene) -> dict[str, object]:
    bodies = scene.tetrahedra_set
    counts: dict[str, object] = {"bodies": len(bodies.parts), "tetrahedra": len(bodies.tetrahedra)}
    return counts | ({"triangles": len(bodies.sheet.mesh.triangles)} if bodies.sheet else {})


TETRAHEDRA = Presentation(
    view=_view,
    view_options=lambda: named("softlab.app.render.tetrahedra_view:VIEW_OPTIONS"),
    lines=lambda scene: alike(*scene.tetrahedra_set.edges),
    strain=spring_strain,
    pieces=_pieces,
    counts=_counts,
    amounts=lambda scene, totals: str(scene.tetrahedra_set),
    brief=lambda scene, totals: str(scene.tetrahedra_set),
    levels=True,
    legend=lambda scene: EDGE_TITLE,
    materials=lambda scene: scene.tetrahedra,
)
