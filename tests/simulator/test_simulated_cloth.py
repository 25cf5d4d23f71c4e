"""The cloth's CUDA kernels, in plain Python: stage by stage, in one pass and in one block to the same bits, and to the
independent NumPy reference within rounding."""

from __future__ import annotations

import numpy as np
from cloth_scenes import cloth_scene

from softlab.app.driver import open_simulation


def test_normals_are_those_of_the_triangles() -> None:
    """The mean of the up to six triangles' normals, weighted by area: summed here triangle by triangle."""
    scene = cloth_scene("springs", "velocity-verlet")
    rows, columns = scene.grid.rows, scene.grid.columns
    with open_simulation(scene, "gpu", math="exact", precision="float64") as simulation:
        p = simulation.read("position").reshape(rows, columns, 3)
        found = simulation.read("normal")
        target = np.zeros_like(found)
        assert simulation.read("normal", into=target) is target and np.array_equal(target, found)
    total = np.zeros_like(p)
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b, c, d = (i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)
            for corners in ((a, c, d), (a, d, b)):
                normal = np.cross(p[corners[1]] - p[corners[0]], p[corners[2]] - p[corners[0]])
                for corner in corners:
                    total[corner] += normal
    expected = (total / np.linalg.norm(total, axis=2, keepdims=True)).reshape(-1, 3)
    assert np.abs(found - expected).max() < 20 * np.finfo(np.float64).eps  # six products and sums, of the order of 1


def test_live_changes_and_a_rewind() -> None:
    scene = cloth_scene("springs", "lab", rows=4, columns=4, pinned="top")
    with open_simulation(scene, "gpu", math="exact", live=("gravity",)) as simulation:
        simulation.advance(2)
        before = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(2)
        still = simulation.state()
        simulation.load(before)
        simulation.set("gravity.enabled", True)
        simulation.advance(2)
        falling = simulation.state()
    change = falling.velocity - still.velocity
    lowest = change.reshape(4, 4, 3)[3, 1]
    assert lowest[1] < 0 and falling.velocity[:4].max() == 0
