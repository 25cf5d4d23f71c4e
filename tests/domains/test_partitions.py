"""Tetrahedral bodies in partitions of their meshes have the bits of one, in however many shares."""

from __future__ import annotations

from typing import Any

import pytest

from app.driver import open_simulation
from cpu_backend.domains.in_threads import run_in_threads
from cpu_backend.domains.ranks import RankPartitions, on_ranks
from model.core.options import Options
from model.core.state import State
from model.scene.scene import Scene

BAR = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [3.2, 0.1, 0.1]},
    "edge": 0.1,
    "young_modulus": 1e5,
}
FALLS = {"velocity": [0.2, -2.0, 0.0], "spin": [0.5, 0.2, 0.3]}
KINDS: dict[str, dict[str, Any]] = {  # of every material, order of sweeps and kind of damping
    "turned": {"pinned": ["left"]},
    "hookean": FALLS | {"material": "neo-hookean", "damping": 0.01},
    "six": FALLS | {"tetrahedra": 6, "material": "corotated", "mass_damping": 2.0},
    "wholes": FALLS | {"volume": "voxels", "poisson_ratio": 0.49},
    "single": FALLS | {"sweep": "tetrahedra"},
}
METHOD = {"solver": "xpbd", "dt": 0.01, "substeps": 2, "iterations": 1}


def scene_of(kind: str, bodies: int = 1, **more: Any) -> Scene:
    """Bars of a kind, just above the ground; one end of `turned` ones is turned."""
    parts = {f"bar{n}": BAR | KINDS[kind] | {"origin": [0.0, 0.11, float(n)]} for n in range(bodies)}
    turn = {"kind": "motion", "pins": "left", "body": "bar0", "angular_velocity": 5.0, "axis": [1.0, 0.0, 0.0]}
    ground = {"kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "static_friction": 0.4}
    moved = {"turn": turn} if kind == "turned" else {}
    return Scene(
        {**parts, **moved, "ground": ground, "gravity": {}, "damping": {"coefficient": 0.05}, "method": METHOD, **more}
    )


def same_in_partitions(scene: Scene, count: int, steps: int, **options: Any) -> None:
    """Whatever ranks gather has the bits of one, also where it goes on from a state."""

    def program(ranks: Any) -> State:
        with on_ranks(scene, Options(math="exact", **options), ranks, 1) as simulation:
            assert isinstance(simulation, RankPartitions)
            simulation.advance(steps // 2)
            simulation.load(simulation.state())
            simulation.advance(steps - steps // 2)
            return simulation.state()

    with open_simulation(scene, threads=1, math="exact", **options) as one:
        one.advance(steps)
        wanted = one.state()
    for found in run_in_threads(count, program, patience=60):
        assert found.position.tobytes() == wanted.position.tobytes()
        assert found.velocity.tobytes() == wanted.velocity.tobytes()


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("kind", [name for name in KINDS if name != "single"])
def test_a_bar_of_every_kind_has_the_bits_of_one(kind: str, count: int) -> None:
    same_in_partitions(scene_of(kind), count, 6)


@pytest.mark.parametrize("kind", ["turned", "hookean", "six"])
def test_vertex_block_descent_has_the_bits_of_one(kind: str) -> None:
    method = METHOD | {"solver": "vbd", "iterations": 2, "chebyshev": 0.9}
    same_in_partitions(scene_of(kind, method=method), 2, 6)


@pytest.mark.parametrize("solver, kind", [("xpbd", "turned"), ("vbd", "hookean")])
def test_vertices_that_sleep_and_float64_have_the_bits_of_one(solver: str, kind: str) -> None:
    """Some are slower than 0.2 m/s, others not: who sleeps looks at its neighbours."""
    method = METHOD | {"solver": solver, "sleeping_speed": 0.2}
    same_in_partitions(scene_of(kind, method=method), 3, 6, precision="float64")


def test_several_bodies_are_cut_where_shares_are_more() -> None:
    same_in_partitions(scene_of("hookean", bodies=2), 5, 4)
