"""Report of a run about parts that few scenes have: self-contact of a cloth, bodies, fluids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from softlab.model.base.errors import naming
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene
from softlab.model.tables.colliders.surface_collider import SurfaceCollider

SLOWED = 1e-4  # of all moves of particles in substeps: no mean of a fluid shows fewer


def body_lines(scene: Scene) -> list[str]:
    """Return lines about the meshes of a scene's bodies: how each body was built, and its mass, once for all its
    copies."""
    lines = [line for member in scene.members.values() for line in body_lines(member)]
    for name, part in scene.bodies.items():
        times = f" (x {part.count})" if part.count > 1 else ""
        times += f" and {part.spare} inactive" if part.spare else ""
        lines += [f"{name}{times}: {line}" for line in part.baked.report.lines()]
    for name, body in scene.tetrahedra.items():
        lines += [f"{name}: {line}" for line in body.cooked.report.brief(scene.tetrahedra_set.mass_of(name))]
    return lines


def built_report(scene: Scene) -> dict[str, object]:
    """Return, for tetrahedral bodies by name: how they were built, and their mass [kg], volume [m^3] and second moments
    of volume about x, y, z through the centre [m^5], next to those of the mesh."""
    built = {}
    for member in (scene, *scene.members.values()):
        for name, part in member.tetrahedra.items():
            report = part.cooked.report
            built[name] = {
                "tetrahedra": report.tetrahedra,
                "vertices": report.vertices,
                "voxels": report.voxels,
                "edges": list(report.edges),
                "mass": member.tetrahedra_set.mass_of(name),
                "volume": report.volume,
                "mesh_volume": report.hull_volume,
                "moments": list(report.moments),
                "vertex_moments": list(report.vertex_moments),
                "mesh_moments": list(report.hull_moments),
            }
    return {"built": built} if built else {}


def collider_lines(scene: Scene) -> list[str]:
    """Return lines about the meshes of colliders."""
    lines = []
    for name, part in scene.parts.items():
        if isinstance(part, SurfaceCollider):
            with naming(name):
                lines += [f"{name}: {line}" for line in part.lines()]
    return lines


def fluid_notes(scene: Scene, report: Mapping[str, Any]) -> list[str]:
    """Return remedies for a fluid whose capacity or speed limit was too small; a limit that slowed less than the part
    `SLOWED` of the moves is not noted.
    """
    notes = []
    if report.get("not_emitted"):
        notes.append(
            f"capacity reached: {report['not_emitted']} particles could not be emitted; a larger capacity "
            "of the fluid, a sink, or a lower speed helps"
        )
    moves = scene.grid.particle_count * scene.method.substeps * report["steps"]
    if report.get("speed_limited", 0) > SLOWED * moves:
        notes.append(
            f"the speed limit of {report['speed_limit']:.3g} m/s slowed a particle in a substep {report['speed_limited']} "
            f"times ({100 * report['speed_limited'] / moves:.2g} % of all moves): the fluid is slower than it should be; "
            "raise method.substeps, or the fluid's maximum_speed"
        )
    return notes


def newton_notes(report: Mapping[str, Any]) -> list[str]:
    """Return a note if no solve was needed. A solve whose second, positive matrix does not lead to a step has two
    matrices and no step; at rest it has one.

    If a matrix that was made again, positive, does not lead to a step either, a solve has two matrices and no step; at
    rest it has one.
    """
    if (
        "newton_steps" not in report
        or report["newton_steps"] > 0.5
        or report["matrices"] - report["newton_steps"] < 1.5
    ):
        return []
    return [
        f"Newton's method made {report['newton_steps']:.2g} steps per solve, none in most of them: the bodies stand still "
        "although they are not at rest; --math exact or --precision float64 shows whether rounding is the cause"
    ]


def contact_report(simulation: Simulation, state: State) -> dict[str, object]:
    """Return, for a cloth with self-contact: the least gaps [m] between layers and between edges (None: more than the
    thickness), and the contacts that are not detected (pairs of edges that are too near, edges through triangles).

    Takes seconds for large sheets.
    """
    scene = simulation.scene
    if scene.self_collision is None:
        return {}
    from softlab.model.contact.penetration import measure

    grid = scene.grid
    penetration = measure(grid.rows, grid.columns, grid.spacing, state.position, scene.self_collision.thickness)
    gaps = {"min_gap": penetration.min_gap, "min_edge_gap": penetration.min_edge_gap}
    return {
        **{name: gap if np.isfinite(gap) else None for name, gap in gaps.items()},
        "edge_misses": penetration.edge_misses,
        "crossings": penetration.crossings,
    }
