"""Alternating springs in the CUDA kernels, in plain Python at 8 x 9 masses: the CPU's bits; other kernels refuse them."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.scene.scene import Scene, load_scene

CHANGES = {
    "grid.rows": 8,
    "grid.columns": 9,
    "grid.pinned": "every:3",
    "springs.stiffness_ratio": 7.0,
    "perturbation.amplitude": 0.05,
}


def end_state(scene: Scene, backend: str, **options: object) -> np.ndarray:
    with open_simulation(scene, backend, math="exact", allow_unstable=True, **options) as simulation:
        simulation.advance(5)
        simulation.advance(4)
        state = simulation.state()
    return np.concatenate([state.position, state.velocity])


@pytest.mark.parametrize(
    ("kernel", "integrator"),
    [
        *(("launch", name) for name in ("lab", "taylor", "velocity-verlet", "rk4")),
        *(("stages", name) for name in ("velocity-verlet", "rk4")),
    ],
)
def test_kernels_do_what_the_cpu_does(kernel: str, integrator: str) -> None:
    """Few variants: the CPU compiles each for seconds."""
    scene = load_scene("lab-grid").replace(CHANGES | {"method.integrator": integrator})
    precision = "float32" if kernel == "launch" else "float64"
    expected = end_state(scene, "cpu", precision=precision, kernel="fused", threads=1)
    assert np.array_equal(end_state(scene, "gpu", precision=precision, kernel=kernel), expected)


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 6), (6, 1), (2, 3)])
def test_the_smallest_grids(rows: int, columns: int) -> None:
    shape = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": "none"}
    scene = load_scene("lab-grid").replace(CHANGES | shape)
    assert np.array_equal(end_state(scene, "gpu"), end_state(scene, "cpu", kernel="fused", threads=1))


@pytest.mark.parametrize("kernel", ["one-block", "tiles", "resident", "tiles:8x8x1h2"])
def test_kernels_on_tiles_refuse_them(kernel: str) -> None:
    scene = load_scene("lab-grid").replace(CHANGES)
    with pytest.raises(
        SceneError, match="supports one stiffness, not alternating springs; use graph, launch or stages"
    ):
        open_simulation(scene, "gpu", kernel=kernel, allow_unstable=True)


def test_b1_diverges_alike() -> None:
    """Step, particle and cause are the CPU's."""
    found = []
    for backend in ("cpu", "gpu"):
        with open_simulation("hard/b1", backend, math="exact", allow_unstable=True) as simulation:
            with pytest.raises(Diverged, match=r"stiffness ratio 1e\+06") as caught:
                simulation.advance(30)
                simulation.check()
            found.append((caught.value.step, caught.value.particle, str(caught.value)))
    assert found[0] == found[1]
