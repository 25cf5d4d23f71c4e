"""Bodies that never meet in shares on the GPU, under the simulator: the bits of one, on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

BOX = {"shape": {"name": "box", "sides": [0.2, 0.2, 0.2], "resolution": 2}, "particle_spacing": 0.1}
PLANE = {"kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}
FALLING = {"cluster_stiffness": 4000.0, "velocity": [0.0, -3.0, 0.0], "spin": [1.0, 2.0, 3.0]}
SCENE = {
    "soft": {"kind": "soft_body", **BOX, **FALLING, "origin": [0.0, 0.14, 0.0], "plastic_creep": 50.0}
    | {"plastic_threshold": 0.01, "plastic_limit": 0.4},
    "block": {"kind": "soft_lattice", **BOX, **FALLING, "region": 1, "origin": [1.0, 0.14, 0.0]},
    "rigid": {"kind": "rigid_body", **BOX, "velocity": [0.0, -3.0, 0.0], "origin": [2.0, 0.14, 0.0]},
    "ground": PLANE | {"restitution": 0.5},
    "gravity": {},
    "method": {"solver": "shape-matching", "dt": 0.01, "substeps": 1, "iterations": 1},
}  # fmt: skip


def end(scene: Scene, **options: Any) -> State:
    with open_simulation(scene, math="exact", **options) as simulation:
        simulation.advance(1)
        simulation.advance(1)
        return simulation.state()


@pytest.mark.parametrize("gpus", [2, 3])
def test_shares_have_the_bits_of_the_cpu(gpus: int) -> None:
    """Of two the first has what creeps and a lattice, the other what comes off the ground as a whole; of three one has a
    lattice alone."""
    found, wanted = end(Scene(SCENE), backend="gpu", gpus=gpus), end(Scene(SCENE), threads=1)
    for name in ("position", "velocity", "rotation", "plastic"):
        one, other = getattr(found, name), getattr(wanted, name)
        assert np.array_equal(one, other), name


def test_shares_need_no_link() -> None:
    with pytest.raises(SceneError, match="bodies send nothing"):
        end(Scene(SCENE), backend="gpu", gpus=2, link="nccl")


def test_more_shares_than_bodies_are_refused() -> None:
    with pytest.raises(SceneError, match="at most 3; use fewer"):
        end(Scene(SCENE), backend="gpu", gpus=4)


BAR = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]},
    "edge": 0.1,
    "young_modulus": 1e4,
}
TETRAHEDRA = {
    "turned": BAR | {"pinned": ["left"]},
    "turn": {"kind": "motion", "pins": "left", "body": "turned", "angular_velocity": 5.0, "axis": [1.0, 0.0, 0.0]},
    "voxels": BAR | {"origin": [1.0, 0.06, 0.0], "damping": 0.01, "velocity": [0.0, -2.0, 0.0]},
    "single": BAR
    | {"origin": [2.0, 0.06, 0.0], "sweep": "tetrahedra", "mass_damping": 2.0, "velocity": [0.0, -2.0, 0.0]},
    "ground": PLANE,
    "gravity": {},
}


@pytest.mark.parametrize("solver, sleeping", [("xpbd", {"sleeping_speed": 0.5}), ("vbd", {})])
def test_tetrahedra_in_shares_have_the_bits_of_the_cpu(solver: str, sleeping: dict[str, float]) -> None:
    """Three shares: a bar that is turned, and two that fall and have no pin."""
    method = {"solver": solver, "dt": 0.01, "substeps": 1, "iterations": 2}
    scene = Scene(TETRAHEDRA | {"method": method | sleeping})
    found, wanted = end(scene, backend="gpu", gpus=3), end(scene, threads=1)
    assert np.array_equal(found.position, wanted.position) and np.array_equal(found.velocity, wanted.velocity)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("solver, sleeping", [("xpbd", {"sleeping_speed": 0.5}), ("vbd", {})])
def test_a_mesh_in_partitions_has_the_bits_of_the_cpu(solver: str, sleeping: dict[str, float], precision: str) -> None:
    """A bar of eight voxels, turned at its end and slow enough to sleep at the other, on two GPUs."""
    method = {"solver": solver, "dt": 0.01, "substeps": 2, "iterations": 1}
    bar = TETRAHEDRA | {"turned": BAR | {"shape": {"name": "box", "sides": [0.8, 0.1, 0.1]}, "pinned": ["left"]}}
    parts = {name: bar[name] for name in ("turned", "turn", "gravity")}
    scene, how = Scene(parts | {"method": method | sleeping}), {"precision": precision}
    found, wanted = end(scene, backend="gpu", gpus=2, **how), end(scene, threads=1, **how)
    assert np.array_equal(found.position, wanted.position) and np.array_equal(found.velocity, wanted.velocity)
