"""Pictures, exports and descriptions of bodies of clusters."""

from __future__ import annotations

import numpy as np

from softlab.app.output.pieces import Piece, skinned
from softlab.app.presentation import Presentation
from softlab.app.render import colours
from softlab.app.render.detail import Detail
from softlab.app.render.framing import landing_places
from softlab.app.render.view import View
from softlab.model.core.energy import spring_strain
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import Counts, copies_there, counts
from softlab.model.particles.body_set import Copy
from softlab.model.scene.scene import Scene


def _view(scene: Scene, detail: Detail, quick: bool, first_colour: int) -> View:
    from softlab.app.render.bodies.view import BodiesView

    return BodiesView(scene, detail)


def _pieces(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None, inverse_mass: np.ndarray | None
) -> list[Piece]:
    """Return the active copies."""
    assert matrices is not None
    active = copies_there(scene, inverse_mass)
    return [_body(scene, copy, position, matrices) for copy in scene.copies if active[copy.number]]


def _body(scene: Scene, copy: Copy, position: np.ndarray, matrices: np.ndarray) -> Piece:
    """Return a copy of a body: its skin deformed by its clusters (linear blend skinning, model/assets/skin.py), or else
    its particles."""
    colour, baked = colours.BODIES[copy.number % len(colours.BODIES)], copy.baked
    several = scene.bodies[copy.name].count + scene.bodies[copy.name].spare > 1
    first = next(one.number for one in scene.copies if one.name == copy.name) if several else 0
    name = f"{copy.name}-{copy.number - first + 1}" if several else copy.name
    skin = baked.skin
    if skin is None or not len(skin.triangles):
        rows = slice(copy.first_particle, copy.first_particle + len(baked.position))
        return Piece(name, position[rows], colour)
    rows = slice(copy.first_cluster, copy.first_cluster + baked.clusters.count)
    vertices, normals = skinned(skin.position, skin.normal, skin.clusters, skin.weights, matrices[rows])
    return Piece(name, vertices, colour, skin.triangles, normals)


def _counts(scene: Scene) -> dict[str, object]:
    clusters = scene.body_set.clusters
    return {"bodies": len(scene.copies), "clusters": clusters.count, "entries": len(clusters.indices)}


def bodies_report(simulation: Simulation) -> dict[str, object]:
    """Return the numbers of active bodies and their clusters, and of inactive bodies and their particles.

    Their `max_strain` is the distance of a particle from its goal in one of its clusters, over the particle spacing.
    """
    totals = counts(simulation.scene, simulation.body.inverse_mass)
    return {
        "bodies": totals.bodies,
        "waiting": totals.waiting,
        "waiting_particles": totals.waiting_particles,
        "clusters": totals.clusters,
    }


def _amounts(scene: Scene, totals: Counts) -> str:
    from softlab.app.command.tables import number

    body_set = scene.body_set
    waiting = (
        f" ({number(totals.waiting)} inactive, of {number(totals.waiting_particles)} particles)"
        if totals.waiting
        else ""
    )
    bodies = "1 body" if len(scene.copies) == 1 else f"{number(len(scene.copies))} bodies"
    entries = len(body_set.clusters.indices) / body_set.particle_count
    return (
        f"{number(body_set.particle_count)} particles of {bodies}{waiting}, "
        f"{number(body_set.clusters.count)} clusters, {entries:.2f} per particle"
    )


def _brief(scene: Scene, totals: Counts) -> str:
    text = f"{totals.particles} particles in {totals.clusters} clusters of {totals.bodies} bodies"
    return text + (f" + {totals.waiting} inactive" if totals.waiting else "")


def _particle_name(scene: Scene, particle: int) -> str:
    """Return the particle's number and the name of its body."""
    return f"{particle} of {scene.copies[scene.body_set.body[particle]].name}"


BODIES = Presentation(
    view=_view,
    strain=spring_strain,
    pieces=_pieces,
    counts=_counts,
    report=lambda simulation, state: bodies_report(simulation),
    amounts=_amounts,
    brief=_brief,
    particle="particle",
    particle_name=_particle_name,
    grips=True,
    framed=landing_places,
    worst_text=lambda worst, fastest: f"largest distance from goal {worst:.3g} spacings",
)
