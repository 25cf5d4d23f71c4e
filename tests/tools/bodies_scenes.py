"""Small scenes of soft and rigid bodies for the tests of their solvers, beside those of bench/experiments/body_scenes.py.

All have the same parts, most of them switched off or far away, so that a test compiles nothing that another one did not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.body_scenes import AWAY, SAMPLED, bodies_scene, method, start
from softlab.bench.experiments.clusters_by_hand import by_hand, clusters_of, degenerate
from softlab.bench.stress.laws import Law
from softlab.bench.stress.trial import Check, Trial
from softlab.model.core.simulation import State
from softlab.model.particles.body_set import Copy
from softlab.model.scene.scene import Scene

__all__ = [
    "AWAY",
    "SAMPLED",
    "bodies_scene",
    "by_hand",
    "clusters_of",
    "degenerate",
    "method",
    "start",
]  # for the tests

LIVE = ("gravity", "poke", "dt", "damping")
POKE = (3, (0.5, 1.0, 0.2))  # particle, N
STEPS = 5
BAR = {"kind": "soft_body", "particle_spacing": 0.16, "spin": [1.0, 2.0, 0.5], **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": 0.14, "spin": [1.0, 2.0, 0.5], **SAMPLED}  # 28 particles


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


def block(counts: Sequence[int] = (5, 4, 3), region: int = 2, **given: Any) -> dict[str, Any]:
    """The part of a lattice of so many particles, 0.1 m apart."""
    box = {"name": "box", "resolution": 4, "sides": [0.1 * count for count in counts]}
    return {"kind": "soft_lattice", "shape": box, "particle_spacing": 0.1, "region": region} | given


def blocks(substeps: int = 2, iterations: int = 2, counts: Sequence[int] = (5, 4, 3), region: int = 2) -> Scene:
    """Two lattices that fall through the plane within STEPS steps, of windows cut off everywhere, a bar and a flat lattice;
    lattices first, so that clusters have another order than particles."""
    placed = {"angle": 40.0, "axis": [1.0, 0.4, 0.2], "spin": [1.0, 2.0, 0.5], "cluster_stiffness": 4000.0}
    fallen = placed | {"origin": [0.0, 0.1, 0.0], "copies": [2, 1, 1], "apart": [2.0, 0.0, 0.0]}
    return bodies_scene(
        block=block(counts, region, **fallen), bar=BAR | {"origin": [0.0, 3.0, 0.0]},
        plate=block((4, 1, 7), 1, origin=[0.0, 2.0, 0.0], **placed), damping=0.3, plane=AWAY | {"point": [0.0, 0.0, 0.0]},
        method=method(substeps, iterations),
    )  # fmt: skip


def lone_points(
    points: Any,
    velocity: Any = None,
    adhesion: float = 1e-30,
    radius: float = 0.05,
    iterations: int = 1,
    **contact: Any,
) -> Scene:
    """Bodies of one particle of 1 kg each, without weight, that meet."""
    count, contact = len(points), {"maximum_speed": 1e3, "sleeping_speed": 1e-30} | contact
    body = BRICK | {"copies": [count, 1, 1], "adhesion": adhesion, "radius": radius}
    clusters, solved = clusters_of(points, [[n] for n in range(count)]), method(1, iterations)
    scene = by_hand(clusters, body=body, contact=contact, method=solved)
    body_set, zero = scene.body_set, np.zeros((count, 3))
    one: Any = SimpleNamespace(clusters=SimpleNamespace(count=1), lattice=None)
    copies = tuple(Copy("body", one, n, first_particle=n, first_cluster=n) for n in range(count))
    moving = zero if velocity is None else np.asarray(velocity, dtype=np.float64)
    scene.__dict__["body_set"] = replace(
        body_set, body=np.arange(count, dtype=np.int32), copies=copies, velocity=moving
    )
    return scene


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


def checks_of(law: Law, scene: Scene, precision: str = "float64", **how: Any) -> list[Check]:
    """What a hard case's law measures of a scene, in exact math with the tests' kernels."""
    return law(Trial(scene, "cpu", precision, **({"math": "exact", "threads": 1, "live": LIVE} | how)))


def holds(law: Law, scene: Scene, precision: str = "float64", **how: Any) -> None:
    """A hard case's law, in every number that it judges."""
    bad = [str(check) for check in checks_of(law, scene, precision, **how) if not check.good]
    assert not bad, "; ".join(bad)


def same(one: State, other: State) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "velocity", "rotation")
    )


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
