"""The reported energy is what the force is the gradient of: of links, clusters, lattices, and worlds of several families."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import BAR, block, bodies_scene, method, start
from world_scenes import world_scene

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.energy import energies
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

H = 1e-5  # s
SHEET: dict[str, Any] = {
    "kind": "soft_sheet", "shape": {"name": "sheet", "resolution": 2}, "particle_spacing": 0.5, "link_stiffness": 60.0,
    "cluster_stiffness": 300.0,
}  # fmt: skip
LINKED = {key: value for key, value in BAR.items() if key != "spin"} | {"link_radius": 0.2, "link_stiffness": 80.0}
PLACED = {"angle": 40.0, "axis": [1.0, 0.4, 0.2]}
SCENES: dict[str, Any] = {
    "sheet": lambda: bodies_scene(sheet=SHEET | PLACED, gravity=0.0, method=method(1, 1, H)),
    "linked body": lambda: bodies_scene(bar=LINKED | PLACED, gravity=0.0, method=method(1, 1, H)),
    "lattice": lambda: bodies_scene(block=block((3, 2, 2), 1, **PLACED), gravity=0.0, method=method(1, 1, H)),
    "lattice and sheet": lambda: bodies_scene(
        sheet=SHEET, block=block((3, 2, 2), 1, origin=[0.0, 1.0, 0.0]), gravity=0.0, method=method(1, 1, H)
    ),
    "world": lambda: world_scene(
        "jelly on a cloth", gravity=None, contact=None, method={"solver": "world", "dt": H}, rags=SHEET,
        structural={"compliance": 1.0}, bending={"model": "isometric", "compliance": 100.0},
    ),
    "tetrahedra beside bodies": lambda: world_scene(
        "jelly on a block", gravity=None, contact=None, method={"solver": "world", "dt": H}, rags=SHEET,
        hook={"kind": "attachment", "body": "block", "vertices": "bottom", "compliance": 0.01},
    ),
}  # fmt: skip


def gradient(scene: Scene, position: np.ndarray, some: np.ndarray, away: float = 1e-6) -> np.ndarray:
    """(some, 3) [N], by central differences."""
    still, found = np.zeros_like(position), np.zeros((len(some), 3))
    for n, k in enumerate(some):
        for axis in range(3):
            ends = []
            for sign in (-1, 1):
                moved = position.copy()
                moved[k, axis] += sign * away
                ends.append(energies(scene, moved, still)["spring"])
            found[n, axis] = (ends[1] - ends[0]) / (2 * away)
    return found


@pytest.mark.parametrize("name", SCENES)
def test_the_force_is_the_energys_gradient(name: str) -> None:
    """A substep h from rest gives h F / m. A projection is exact but for w^2 h^2 of it, with w^2 of 4e5 1/s^2 at most, of the
    stiffest links and tetrahedra: 4e-5; roundings of places of 1 m over h^2 weigh 1e-16 / h^2 of accelerations of 10 m/s^2:
    1e-7. Differences of energies of 1 J over 1e-6 m lose 1e-10 N."""
    scene, random = SCENES[name](), np.random.default_rng(4)
    body = build(scene)
    position = body.position + (body.inverse_mass > 0)[:, None] * random.normal(0, 2e-3, body.position.shape)
    begin = State(position, np.zeros_like(position), body.inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1, initial=begin) as simulation:
        simulation.advance(1)
        velocity = simulation.state().velocity
    free = np.flatnonzero(body.inverse_mass > 0)
    some = random.permutation(free)[:12]
    force = velocity[some] / (H * body.inverse_mass[some, None])
    slope = gradient(scene, position, some)
    assert np.abs(force).max() > 0
    assert force == pytest.approx(-slope, abs=1e-4 * np.abs(slope).max())


def test_a_stretched_triangle_stores_what_its_edges_do(tmp_path: Any) -> None:
    """k (l' - l)^2 / 2 of three edges, stretched by 1.2 along x, and nothing of its cluster's, which is switched off."""
    path = tmp_path / "triangle.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0.2 0.7 0\nf 1 2 3\n")
    sheet = {
        "kind": "soft_sheet",
        "file": str(path),
        "particle_spacing": 1.0,
        "link_stiffness": 30.0,
        "cluster_stiffness": 1e-30,
    }
    scene = Scene({"title": "T", "sheet": sheet, "method": {"solver": "shape-matching", "dt": 0.01}})
    at = scene.body_set.position * np.array([1.2, 1.0, 1.0])
    pairs = [(0, 1), (1, 2), (0, 2)]
    before, after = (np.array([np.linalg.norm(p[i] - p[j]) for i, j in pairs]) for p in (scene.body_set.position, at))
    found = energies(scene, at, np.zeros_like(at))
    assert found["spring"] == pytest.approx(15.0 * ((after - before) ** 2).sum(), rel=1e-12)
    assert energies(scene, scene.body_set.position, np.zeros_like(at))["spring"] < 1e-25


def test_links_that_swing_keep_their_energy() -> None:
    """To first order in the substep: a link's spring of 80 N/m between masses of 0.5 kg, w = 18 1/s, loses w^2 h of it a
    second; 0.1 s at 1e-4 s: 0.003, twice for what w is underrated by."""
    scene = bodies_scene(bar=LINKED, gravity=0.0, method=method(1, 1, 1e-4))
    begin = start(scene, scene.body_set.position * np.array([1.02, 1.0, 1.0]))
    mass, found = scene.body_set.clusters.mass, []
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1, initial=begin) as simulation:
        for _ in range(10):
            state = simulation.state()
            kinetic = 0.5 * float((mass[:, None] * state.velocity**2).sum())
            found.append(kinetic + energies(scene, state.position, state.velocity)["spring"])
            simulation.advance(5)
    assert max(found) <= found[0] * (1 + 1e-9) and found[-1] > 0.9 * found[0]
