"""A block of 2 cm without a [method] rested 5 mm deep in the floor, in one substep of 10 ms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.resting import MAX_SUBSTEPS, SINKING, resting_notes
from softlab.model.scene.scene import Scene

LAYERS, GRAVITY, FAR = 3, 9.81, 1000
KINDS = ("plane", "box", "sphere", "capsule", "mesh_collider", "distance_field")


def collider(kind: str, side: float, folder: Path) -> dict[str, Any]:
    """A collider whose highest point is the origin, flat there to a millionth of `side`."""
    low = [0.0, -FAR * side, 0.0]
    if kind in ("mesh_collider", "distance_field"):
        corner = [(x, y, z) for x in (-2, 2) for y in (-1, 0) for z in (-2, 2)]
        faces = [(1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5),
                 (2, 6, 8), (2, 8, 4)]  # fmt: skip
        file = folder / "slab.obj"
        file.write_text(
            "".join(f"v {x} {y} {z}\n" for x, y, z in corner) + "".join(f"f {a} {b} {c}\n" for a, b, c in faces)
        )
        return {"kind": kind, "file": str(file), "scale": side} | (
            {"spacing": side / 4} if kind == "distance_field" else {}
        )
    fields: dict[str, dict[str, Any]] = {
        "plane": {}, "box": {"center": [0.0, -side, 0.0], "half_size": [5 * side, side, 5 * side]},
        "sphere": {"center": low, "radius": FAR * side},
        "capsule": {"start": [-5 * side, *low[1:]], "end": [5 * side, *low[1:]], "radius": FAR * side},
    }  # fmt: skip
    return {"kind": kind, **fields[kind]}


def block(kind: str, side: float) -> dict[str, Any]:
    """A block a hair over the origin."""
    own = {"voxels": 2, "damping": 0.01} if kind == "tetrahedral_body" else {"particle_spacing": side / LAYERS}
    shape = {"name": "box", "sides": [side, side, side]}
    return {"kind": kind, "shape": shape, "origin": [0.0, side / 2 + 1e-3 * side, 0.0]} | own


def lowest_skin(scene: Scene, position: np.ndarray) -> float:
    if scene.tetrahedra:
        return float(scene.tetrahedra_set.skin.points(position)[:, 1].min())
    body = scene.bodies["body"].baked
    rest, now = body.position - body.position.mean(axis=0), position - position.mean(axis=0)
    u, _, v = np.linalg.svd(now.T @ rest)
    skin = (body.skin.position - body.position.mean(axis=0)) @ (u @ v).T + position.mean(axis=0)
    return float(skin[:, 1].min())


def resting(scene: Scene, steps: int = 12) -> np.ndarray:
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(steps)
        return np.asarray(simulation.state().position, np.float64)


@pytest.mark.parametrize("side", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("where", KINDS)
def test_a_rigid_block_rests_with_its_skin_on_the_surface(where: str, side: float, tmp_path: Path) -> None:
    scene = Scene({"body": block("rigid_body", side), "ground": collider(where, side, tmp_path), "gravity": {}})
    low = lowest_skin(scene, resting(scene))
    assert abs(low) < 0.02 * side / LAYERS, (low * LAYERS / side, scene.method.substeps)


@pytest.mark.parametrize("side", [0.02, 1.0])
@pytest.mark.parametrize("where", KINDS)
def test_a_block_of_tetrahedra_rests_with_its_skin_on_the_surface(where: str, side: float, tmp_path: Path) -> None:
    scene = Scene({"body": block("tetrahedral_body", side), "ground": collider(where, side, tmp_path), "gravity": {}})
    low = lowest_skin(scene, resting(scene, 6))
    assert abs(low) < 0.02 * side / 2, (low * 2 / side, scene.method.substeps)


@pytest.mark.parametrize(("side", "substeps"), [(0.02, 1), (0.02, 2), (0.1, 1)])
def test_a_rigid_block_sinks_by_what_the_formula_says(side: float, substeps: int) -> None:
    """(n - 1) g h^2 of n layers, which is what the substeps are chosen by."""
    method = {"solver": "shape-matching", "dt": 0.01, "substeps": substeps}
    scene = Scene({"body": block("rigid_body", side), "ground": {"kind": "plane"}, "gravity": {}, "method": method})
    sinks = (LAYERS - 1) * GRAVITY * (0.01 / substeps) ** 2
    assert -lowest_skin(scene, resting(scene, 60)) == pytest.approx(sinks, rel=0.05)


def test_substeps_follow_the_spacing_and_what_is_stated_stays() -> None:
    tables = {"body": block("rigid_body", 0.02), "ground": {"kind": "plane"}, "gravity": {}}
    fine, coarse = Scene(tables), Scene(tables).replace({"body.particle_spacing": 0.01})
    assert fine.method.substeps > coarse.method.substeps > 1 and "substeps = " in resting_notes(fine)[0]
    wanted = 0.01 / np.sqrt(SINKING * 0.02 / LAYERS / (LAYERS * GRAVITY))
    assert fine.method.substeps == np.ceil(wanted)
    assert fine.parts["ground"].thickness == pytest.approx(0.01 / LAYERS) != coarse.parts["ground"].thickness  # type: ignore[attr-defined]
    stated = fine.replace({"method.substeps": 2, "ground.thickness": 0.01})
    assert stated.method.substeps == 2 and stated.parts["ground"].thickness == 0.01  # type: ignore[attr-defined]
    assert resting_notes(stated) == [] and stated.replace({"body.particle_spacing": 0.01}).method.substeps == 2
    tiny = fine.replace({"body.particle_spacing": 0.001, "method.dt": 0.1})
    assert tiny.method.substeps == MAX_SUBSTEPS and "the most that is chosen" in resting_notes(tiny)[0]
    assert Scene({"body": block("rigid_body", 0.02), "gravity": {}}).method.substeps == 1  # nothing to rest on
    assert Scene({"body": block("rigid_body", 0.02), "ground": {"kind": "plane"}}).method.substeps == 1  # nothing falls


def test_a_world_takes_the_substeps_of_its_smallest_body_and_each_member_its_own_thickness() -> None:
    jelly = block("tetrahedral_body", 0.02) | {"origin": [1.0, 0.01, 0.0]}
    scene = Scene({"body": block("rigid_body", 0.02), "jelly": jelly, "ground": {"kind": "plane"}, "gravity": {}})
    alone = Scene({"body": block("rigid_body", 0.02), "ground": {"kind": "plane"}, "gravity": {}})
    assert scene.method.substeps == max(20, alone.method.substeps)
    members = scene.members
    assert members["bodies"].parts["ground"].thickness == alone.parts["ground"].thickness  # type: ignore[attr-defined]
    assert members["tetrahedra"].parts["ground"].thickness < 0.02 * 0.02 / LAYERS
    assert members["bodies"].method.substeps == scene.method.substeps


def test_of_several_bodies_the_one_whose_particles_lie_deepest_counts() -> None:
    both = {
        "fine": block("rigid_body", 0.1),
        "coarse": block("rigid_body", 0.2),
        "ground": {"kind": "plane"},
        "gravity": {},
    }
    assert Scene(both).parts["ground"].thickness == pytest.approx(0.1 / LAYERS)  # type: ignore[attr-defined]
