"""What a run tells of the parts that few scenes have: contacts of a cloth with itself, and bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.contact.particle_parameters import G_DISTANCE, kinds_of_particles, pair_rows
from model.contact.surface_collider import SurfaceCollider, naming
from model.core.simulation import Simulation, State
from model.fluid.measure import compression, height
from model.geometry.neighbours import TooMany, close_pairs
from model.scene.scene import Scene
from model.shape_matching.spare import counts

CAUGHT = 0.7  # of the distance that contacts keep: nearer is no rest in a heap
MAX_LOOKED_AT = 200_000  # particles


def body_lines(scene: Scene) -> list[str]:
    """What became of the meshes of a scene's bodies, each told once for all its copies."""
    lines = []
    for name, part in scene.bodies.items():
        times = f" (x {part.count})" if part.count > 1 else ""
        times += f" and {part.spare} waiting" if part.spare else ""
        lines += [f"{name}{times}: {line}" for line in part.baked.report.lines()]
    return lines


def collider_lines(scene: Scene) -> list[str]:
    """What became of the meshes that masses collide with."""
    lines = []
    for name, part in scene.parts.items():
        if isinstance(part, SurfaceCollider):
            with naming(name):
                lines += [f"{name}: {line}" for line in part.lines()]
    return lines


def bodies_report(simulation: Simulation, state: State) -> dict[str, Any]:
    """Of bodies, how many are there, of how many clusters, and how many wait, of how many particles; neighbours that contacts
    had no room for; how many particles are `caught`, nearer to one of another body than CAUGHT of their distance, and the
    least distance over what contacts keep, `least_distance` (None: nobody is near, or there are too many to look). Their
    `max_strain` is how far a particle is from where one of its clusters wants it, over the particle spacing."""
    scene = simulation.scene
    if not scene.bodies:
        return {}
    told = counts(scene, simulation.body.inverse_mass)
    found: dict[str, Any] = {
        "bodies": told.bodies,
        "waiting": told.waiting,
        "waiting_particles": told.waiting_particles,
        "clusters": told.clusters,
    }
    if scene.contact:
        found["contacts_lost"] = simulation.contacts_lost  # type: ignore[attr-defined]
        found["caught"], found["least_distance"] = _caught(scene, state)
    return found


def _caught(scene: Scene, state: State) -> tuple[int, float | None]:
    """Of particles that are there and meet: how many are nearer to one of another body than CAUGHT of what contacts keep; the
    least distance over that."""
    body_set, there = scene.body_set, np.flatnonzero(state.inverse_mass > 0)
    if len(there) > MAX_LOOKED_AT or not np.isfinite(state.position).all():
        return 0, None
    rows, kind = pair_rows(scene)[:, :, G_DISTANCE], kinds_of_particles(scene)[there]
    try:
        one, other, distance = close_pairs(state.position[there].astype(np.float64), float(rows.max()))
    except TooMany:
        return 0, None
    kept = np.where(body_set.body[there][one] != body_set.body[there][other], rows[kind[one], kind[other]], 0.0)
    meets = kept > distance
    part = distance[meets] / kept[meets]
    deep = part < CAUGHT
    found = len(np.unique(np.concatenate([one[meets][deep], other[meets][deep]])))
    return found, float(part.min()) if len(part) else None


def caught_lines(report: dict[str, Any]) -> list[str]:
    """What to do where bodies lie in each other at the end of a run."""
    if not report.get("caught"):
        return []
    return [
        f"bodies lie in each other: {report['caught']} particles are nearer than {CAUGHT:g} of what contacts keep, the "
        f"nearest at {report['least_distance']:.2f}; more substeps, stiffer clusters, a larger contact.separation_speed or "
        "contact.sweeps, or a contact.maximum_speed of an eighth of the distance a substep help"
    ]


def fluid_report(simulation: Simulation, state: State) -> dict[str, Any]:
    """Of fluids, by how much densities exceed that at rest, the `height` of the highest hundredth of particles over where the
    lowest one's floor was, neighbours that lists had no room for, and particles that no capacity was left for."""
    scene = simulation.scene
    if not scene.fluids or not np.isfinite(state.position).all():
        return {}
    mean, largest = compression(scene, state.position)
    return {
        "mean_compression": mean,
        "largest_compression": largest,
        "height": height(scene, state.position),
        "neighbours_lost": simulation.contacts_lost,  # type: ignore[attr-defined]
        **({"not_emitted": simulation.not_emitted} if scene.emitters else {}),  # type: ignore[attr-defined]
    }


def fluid_notes(report: dict[str, Any]) -> list[str]:
    """What to do where lists were too short, or a fluid's capacity."""
    notes = []
    if report.get("not_emitted"):
        notes.append(
            f"capacity reached: {report['not_emitted']} particles were due at a nozzle while none waited; a larger capacity "
            "of the fluid, a sink, or a lower speed helps"
        )
    if not report.get("neighbours_lost"):
        return notes
    return [
        *notes,
        f"{report['neighbours_lost']} neighbours did not fit into the lists of their particles: the fluid is pressed too "
        "much; more substeps or iterations, or a smaller support, help",
    ]


def newton_report(simulation: Simulation) -> dict[str, Any]:
    """Of implicit tetrahedral bodies, per solve (a substep is one, of second order two): matrices, Newton's steps, and
    products with the matrix."""
    if not simulation.scene.tetrahedra or not hasattr(simulation, "done"):
        return {}
    solves, _, matrices, products, steps = (int(one) for one in simulation.done)
    each = max(solves, 1)
    return {"matrices": matrices / each, "newton_steps": steps / each, "matrix_products": products / each}


def newton_notes(report: dict[str, Any]) -> list[str]:
    """That nothing was solved: where a matrix that is made again, positive, leads nowhere either, there are two of a solve
    and no step; at rest there is one."""
    if (
        "newton_steps" not in report
        or report["newton_steps"] > 0.5
        or report["matrices"] - report["newton_steps"] < 1.5
    ):
        return []
    return [
        f"Newton's method found {report['newton_steps']:.2g} steps a solve, and none in most: bodies stand still there "
        "though they are not at rest; --math exact or --precision float64 tells whether rounding is why"
    ]


def contact_report(simulation: Simulation, state: State) -> dict[str, Any]:
    """Of a cloth that meets itself: the least gaps [m] between layers and between edges (None: more than the thickness), what
    contacts of masses with triangles do not see (pairs of edges that are too near, edges through triangles), and contacts
    that there was no room for. Seconds on large sheets. Of tetrahedral bodies, and of a world, the last alone."""
    scene = simulation.scene
    if (scene.tetrahedra or scene.is_world) and scene.contact is not None:
        worlds = [simulation, *getattr(simulation, "members", {}).values()]
        surfaces: list[Any] = [
            own for one in worlds if hasattr(own := getattr(one, "contacts", None), "neighbours_lost")
        ]
        of_particles = sum(getattr(one, "contacts_lost", 0) for one in worlds[1:])
        return {"contacts_lost": of_particles + sum(one.lost + one.neighbours_lost for one in surfaces)}
    if scene.self_collision is None:
        return {}
    from model.contact.penetration import measure

    grid = scene.grid
    found = measure(grid.rows, grid.columns, grid.spacing, state.position, scene.self_collision.thickness)
    gaps = {"min_gap": found.min_gap, "min_edge_gap": found.min_edge_gap}
    contacts: Any = simulation.contacts  # type: ignore[attr-defined]
    return {
        **{name: gap if np.isfinite(gap) else None for name, gap in gaps.items()},
        "edge_misses": found.edge_misses,
        "crossings": found.crossings,
        "contacts_lost": contacts.lost,
    }
