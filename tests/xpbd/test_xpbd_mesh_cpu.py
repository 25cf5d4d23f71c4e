"""Meshes on CPU threads: against the NumPy reference, kernels and thread counts against one another, conserved quantities."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_scenes import HELD, POKE, SHEET, mesh_scene, moving

from softlab.app.driver import open_simulation
from softlab.model.core.build import build, pinned_indices
from softlab.model.core.simulation import State
from softlab.model.geometry.topology import vertex_masses
from softlab.model.scene.scene import Scene

STEPS = 3


def masses(scene: Scene) -> np.ndarray:
    assert scene.mesh is not None
    return vertex_masses(scene.mesh)


def run(scene: Scene, steps: int = STEPS, **options: Any) -> State:
    options = {"precision": "float64", "math": "exact", "threads": 1} | options
    with open_simulation(scene, "cpu", live=["poke"], initial=moving(scene), **options) as simulation:
        simulation.poke(*POKE)
        simulation.advance(steps)
        return simulation.state()


def test_pins_inside_a_collider_stay_and_nothing_breaks() -> None:
    """A ball around a pinned vertex: the pin is not moved, its neighbours are put outside, every step anew."""
    kept = {name: SHEET[name] for name in ("mesh", "structural", "method")}
    scene = Scene(kept | {"ball": {"kind": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.12}})
    body = build(scene)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(50)
        state = simulation.state()
    np.testing.assert_array_equal(state.position[body.pinned], body.position[body.pinned])
    free = np.linalg.norm(np.delete(state.position, body.pinned, axis=0), axis=1)
    assert 0.12 < free.min() < 0.14  # with the thickness 0.13


def test_attachments_hold() -> None:
    """No vertex is farther from its anchor than the way along edges, times 1 + slack, whatever the springs do."""
    from softlab.model.position_based.attachments import vertex_attachments

    soft = {"structural": {"stiffness": 0.1}, "method": {"solver": "xpbd", "dt": 0.01, "substeps": 2}}
    scene = Scene({k: HELD[k] for k in ("mesh", "gravity")} | soft | {"attachments": {"slack": 0.001}})
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(60)
        position = simulation.state().position
    anchor, reach = vertex_attachments(scene, build(scene), np.float64)
    far = np.linalg.norm(position[:, None] - position[anchor], axis=2)
    assert (far <= reach * (1 + 1e-12)).all()
    assert (far > 0.999 * reach).sum() > len(pinned_indices(scene.grid))  # and some are needed


def test_normals_and_strain_are_the_triangles_and_edges() -> None:
    scene = mesh_scene("everything")
    with open_simulation(scene, "cpu", precision="float64", threads=1) as simulation:
        normal, strain = simulation.read("normal"), simulation.read("strain")
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-12)
    assert len(strain) == 5 * 3 + 4 * 4 + 4 * 3
