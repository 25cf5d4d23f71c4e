"""What a run tells of the parts that few scenes have: contacts of a cloth with itself, and bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.mesh_collider import MeshCollider
from model.scene import Scene
from model.simulation import Simulation, State
from model.spare import copies_there


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
    parts = [(name, scene.parts[name]) for name, kind in scene.kinds.items() if kind == "mesh_collider"]
    return [f"{name}: {line}" for name, part in parts if isinstance(part, MeshCollider) for line in part.lines()]


def bodies_report(simulation: Simulation) -> dict[str, Any]:
    """Of bodies, how many are there and how many wait, of how many clusters; and neighbours that contacts had no room for.
    Their `max_strain` is how far a particle is from where one of its clusters wants it, over the particle spacing."""
    scene = simulation.scene
    if not scene.bodies:
        return {}
    there = copies_there(scene, simulation.body.inverse_mass)
    found = {
        "bodies": int(there.sum()),
        "waiting": int((~there).sum()),
        "clusters": scene.crowd.clusters.count,
    }
    if scene.contact:
        found["contacts_lost"] = simulation.contacts_lost  # type: ignore[attr-defined]
    return found


def contact_report(simulation: Simulation, state: State) -> dict[str, Any]:
    """Of a cloth that meets itself: the least gaps [m] between layers and between edges (None: more than the thickness), what
    contacts of masses with triangles do not see (pairs of edges that are too near, edges through triangles), and contacts
    that there was no room for. Seconds on large sheets."""
    scene = simulation.scene
    if scene.self_collision is None:
        return {}
    from model.contact_measure import measure

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
