"""Small scenes of soft and rigid bodies, and of clusters made by hand, for the tests of their solvers.

All have the same parts, most of them switched off or far away, so that a test compiles nothing that another one did not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np

from app.driver import open_simulation
from model.clusters import Clusters
from model.crowd import Copy, Crowd
from model.links import LinkedCopies, make_links
from model.scene import Scene
from model.simulation import State

LIVE = ("gravity", "poke", "dt", "damping")
POKE = (3, (0.5, 1.0, 0.2))  # particle, N
STEPS = 5
AWAY = {"point": [0.0, -1e5, 0.0], "normal": [0.0, 1.0, 0.0], "static_friction": 0.5, "dynamic_friction": 0.4}
SAMPLED = {"shape": {"name": "beam"}, "surface_sampling": 0.0, "volume_sampling": 1.0}
BAR = {"kind": "soft_body", "particle_spacing": 0.16, "spin": [1.0, 2.0, 0.5], **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": 0.14, "spin": [1.0, 2.0, 0.5], **SAMPLED}  # 28 particles


def method(substeps: int = 1, iterations: int = 1, dt: float = 0.01) -> dict[str, Any]:
    return {"solver": "shape-matching", "dt": dt, "substeps": substeps, "iterations": iterations}


def bodies_scene(*, gravity: float = 9.81, damping: float = 0.0, plane: Any = AWAY, **tables: Any) -> Scene:
    """`tables`: bodies and the method."""
    world = {"gravity": {"acceleration": gravity}, "damping": {"coefficient": damping}, "plane": plane}
    return Scene(world | {"method": method()} | tables, "bodies")


def hung(substeps: int = 2, iterations: int = 2) -> Scene:
    """A sheet of 25 particles falls over a rigid brick, dampers."""
    sheet = {
        "kind": "soft_sheet", "shape": {"name": "sheet", "resolution": 4}, "particle_spacing": 0.25,
        "link_stiffness": 60.0, "origin": [0.0, 0.2, 0.0], "copies": [1, 2, 1], "apart": [0.0, 0.3, 0.0],
    }  # fmt: skip
    return bodies_scene(
        sheet=sheet,
        brick=BRICK,
        damping=0.01,
        plane=AWAY | {"point": [0.0, 0.17, 0.0]},
        method=method(substeps, iterations),
    )


def everything(substeps: int = 2, iterations: int = 2) -> Scene:
    """A soft bar that falls through the plane within STEPS steps, rigid bricks over it, dampers."""
    bricks = BRICK | {"origin": [0.0, 1.0, 0.0], "copies": [2, 1, 1], "apart": [2.0, 0.0, 0.0]}
    return bodies_scene(
        bar=BAR | {"origin": [0.0, 0.1, 0.0]}, brick=bricks, damping=0.3, plane=AWAY | {"point": [0.0, 0.0, 0.0]},
        method=method(substeps, iterations),
    )  # fmt: skip


def of_all_materials(leave_out: Sequence[str] = (), substeps: int = 2, iterations: int = 2) -> Scene:
    """A bar that stretches, creeps and is damped, but for `leave_out`, hits the plane at 5 m/s, under a rigid brick."""
    given = {
        "linear": 0.6,
        "plastic_threshold": 0.01,
        "plastic_creep": 20.0,
        "plastic_limit": 0.3,
        "cluster_damping": 4.0,
    }
    kept = {name: value for name, value in given.items() if name not in leave_out}
    bar = BAR | kept | {"origin": [0.0, 0.1, 0.0], "velocity": [0.0, -5.0, 0.0]}
    return bodies_scene(
        bar=bar, brick=BRICK | {"origin": [0.0, 1.0, 0.0]}, damping=0.3, plane=AWAY | {"point": [0.0, 0.0, 0.0]},
        method=method(substeps, iterations),
    )  # fmt: skip


def by_hand(clusters: Clusters, links: Sequence[LinkedCopies] = (), **tables: Any) -> Scene:
    """A scene whose crowd is these clusters and links, as one body."""
    scene = bodies_scene(**({"body": BRICK, "gravity": 0.0} | tables))
    copies = (Copy("body", SimpleNamespace(), 0, 0, 0),)  # type: ignore[arg-type]
    at, count = clusters.position, len(clusters.mass)
    zero, body = np.zeros_like(at), np.zeros(count, np.int32)
    scene.__dict__["crowd"] = Crowd(
        at, zero, body, clusters, make_links(links), copies, 0.1, float(clusters.mass.mean())
    )
    scene.canonical = lambda: f"by hand {id(clusters)}"  # type: ignore[method-assign]  # what its arrays are kept under
    return scene


def lone_points(
    points: Any, velocity: Any = None, adhesion: float = 1e-30, radius: float = 0.05, **contact: Any
) -> Scene:
    """Bodies of one particle of 1 kg each, without weight, that meet."""
    count, contact = len(points), {"maximum_speed": 1e3, "sleeping_speed": 1e-30} | contact
    body = BRICK | {"copies": [count, 1, 1], "adhesion": adhesion, "radius": radius}
    scene = by_hand(clusters_of(points, *([n] for n in range(count))), body=body, contact=contact)
    crowd, zero = scene.crowd, np.zeros((count, 3))
    copies = tuple(replace(crowd.copies[0], number=n, first_particle=n, first_cluster=n) for n in range(count))
    moving = zero if velocity is None else np.asarray(velocity, dtype=np.float64)
    scene.__dict__["crowd"] = replace(crowd, body=np.arange(count, dtype=np.int32), copies=copies, velocity=moving)
    return scene


def clusters_of(position: Any, *members: Any, stiffness: Any = np.inf, mass: Any = None) -> Clusters:
    """Each of `members`: the particles of a cluster."""
    position, sizes = np.asarray(position, dtype=np.float64), [len(one) for one in members]
    return Clusters(
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), np.concatenate(members).astype(np.int32),
        np.ones(sum(sizes)), np.full(len(members), stiffness, float) if np.isscalar(stiffness) else np.asarray(stiffness),
        np.ones(len(position)) if mass is None else np.asarray(mass, dtype=np.float64), position,
    )  # fmt: skip


def degenerate() -> Clusters:
    """Flat, collinear, of one particle, of two, of none, and of all in one place; and a particle in none."""
    flat = [[x, y, 0.0] for x in range(3) for y in range(3)]
    line, one, two = [[3.0 + n, n, n] for n in range(4)], [[9.0, 0.0, 0.0]], [[11.0, 0.0, 0.0], [11.0, 1.0, 1.0]]
    place, orphan = [[14.0, 0.0, 0.0]] * 3, [[16.0, 0.0, 0.0]]
    groups = [flat, line, one, two, [], place]
    ends = np.cumsum([0, *(len(group) for group in groups)])
    members = [np.arange(a, b) for a, b in pairwise(ends)]
    return clusters_of(np.array([*flat, *line, *one, *two, *place, *orphan]) * 0.1, *members)


def opened(scene: Scene, backend: str = "cpu", **options: Any) -> Any:
    options = {"precision": "float64", "math": "exact", "live": LIVE} | options
    if backend == "cpu":
        options.setdefault("threads", 1)
    return open_simulation(scene, backend, **options)


def end_state(scene: Scene, backend: str = "cpu", steps: int = STEPS, poked: bool = False, **options: Any) -> State:
    with opened(scene, backend, initial=options.pop("start", None), **options) as simulation:
        if poked:
            simulation.poke(*POKE)
        simulation.advance(steps // 2)
        simulation.advance(steps - steps // 2)
        return simulation.state()


def start(scene: Scene, position: Any = None, velocity: Any = None, rotation: Any = None) -> State:
    """A state at time 0: the scene's, but for what is given."""
    crowd = scene.crowd
    position = crowd.position if position is None else np.asarray(position, dtype=np.float64)
    velocity = np.zeros_like(position) if velocity is None else np.asarray(velocity, dtype=np.float64)
    return State(position, velocity, 1 / crowd.clusters.mass, 0.0, 0, rotation)


def same(one: State, other: State) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "velocity", "rotation")
    )


def matrices(rotation: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of unit quaternions (w, x, y, z)."""
    w, u = rotation[:, :1, None].astype(float), rotation[:, 1:].astype(float)
    cross = np.zeros((len(rotation), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, i, j], cross[:, j, i] = -u[:, k], u[:, k]
    return np.eye(3) + 2 * (w * cross + cross @ cross)


# what the tests of runs and pictures show
BEAM: dict[str, Any] = {
    "kind": "soft_body", "shape": {"name": "beam", "resolution": 16}, "particle_spacing": 0.12,
    "cluster_stiffness": 500.0, "origin": [0.2, 1.0, -0.1], "angle": 30.0, "axis": [0.0, 1.0, 0.4], "copies": [2, 1, 1],
    "apart": [1.5, 1.0, 1.0],
}  # fmt: skip
TORUS: dict[str, Any] = {
    "kind": "rigid_body", "shape": {"name": "torus", "resolution": 16}, "particle_spacing": 0.15, "origin": [0.0, 2.2, 0.0],
    "angle": 90.0, "axis": [1.0, 0.0, 0.0],
}  # fmt: skip
METHOD = {"solver": "shape-matching", "dt": 0.005, "substeps": 2}
PLANE = {"plane": {"point": [0.0, 0.0, 0.0]}}


def beams_and_torus(**parts: Any) -> Scene:
    """Two soft beams beside each other and a rigid torus above them."""
    return Scene(
        {"title": "Bodies", "beam": BEAM, "torus": TORUS, "gravity": {}, "method": METHOD} | parts, name="bodies"
    )
