"""CUDA kernels of all solvers, in plain Python: they diverge where the CPU's do, refuse what they cannot run, take live
changes and go back, and read normals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from bits_row import different
from cloth_scenes import cloth_scene
from kernel_scenes import DIVERGING, REFUSED, first_diverged
from mesh_scenes import mesh_scene
from tetrahedra_scenes import slab_scene, tetrahedra_scene
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene


@pytest.mark.parametrize("name", DIVERGING)
def test_a_divergence_is_the_cpus(name: str) -> None:
    """Step, particle and cause."""
    make, kernels = DIVERGING[name]
    expected = first_diverged(make(), "cpu")
    for kernel in kernels:
        assert first_diverged(make(), "gpu", kernel) == expected, kernel


@pytest.mark.parametrize("make, kernel, words", [pytest.param(*case, id=f"{case[1]}-{case[2]}") for case in REFUSED])
def test_a_kernel_that_cannot_run_is_refused_with_the_reason(
    make: Callable[[], Scene], kernel: str | None, words: str
) -> None:
    with pytest.raises(SceneError, match=words):
        open_simulation(make(), "gpu", kernel=kernel)


@pytest.mark.parametrize("limits, words", [((1, 1 << 20), "at once"), ((64, 500), "shared memory")])
def test_a_body_too_large_for_the_chip_is_refused(
    limits: tuple[int, int], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softlab.gpu_backend.tetrahedra.resident_launch.device_limits", lambda: limits)
    with pytest.raises(SceneError, match=words):
        open_simulation(slab_scene(), "gpu", kernel="resident:2")


LIVE = [
    (lambda: cloth_scene("springs", "lab", rows=4, columns=4, pinned="top"), "launch"),
    *((lambda: xpbd_scene("air", "jacobi", rows=4, columns=4, pinned="top"), kernel)
      for kernel in ("tiled:4x4x32d1", "stages", "one-block")),
]  # fmt: skip


@pytest.mark.parametrize("make, kernel", LIVE, ids=[kernel for _, kernel in LIVE])
def test_live_changes_and_a_rewind(make: Callable[[], Scene], kernel: str) -> None:
    """Gravity that is switched on again is felt but by pins; what was loaded goes on as before."""
    with open_simulation(make(), "gpu", math="exact", kernel=kernel, live=("gravity",)) as simulation:
        simulation.advance(1)
        before = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(2)
        still = simulation.state()
        simulation.load(before)
        simulation.set("gravity.enabled", True)
        simulation.advance(2)
        falling = simulation.state()
        simulation.rewind()
        simulation.load(before)
        simulation.advance(2)
        assert not different(simulation.state(), falling)
    change = (falling.velocity - still.velocity).reshape(4, 4, 3)
    assert change[3, 1, 1] < 0 and falling.velocity[:4].max() == 0


NORMALS = {  # scene, and what roundings of sums in another order may make of it
    "cloth": (lambda: cloth_scene("springs", "velocity-verlet"), 20 * np.finfo(np.float64).eps),
    "sheet": (lambda: xpbd_scene("springs", "jacobi"), 20 * np.finfo(np.float64).eps),
    "mesh": (lambda: mesh_scene("everything"), 1e-12),
    "tetrahedra": (lambda: tetrahedra_scene("everything"), 1e-6),
}


@pytest.mark.parametrize("name", NORMALS)
def test_normals_are_those_of_the_triangles(name: str) -> None:
    """Weighted by area; particles inside a body have none."""
    make, bound = NORMALS[name]
    scene = make()
    with open_simulation(scene, "gpu", math="exact", precision="float64") as simulation:
        position, normal = simulation.read("position"), simulation.read("normal")
        target = np.zeros_like(normal)
        assert simulation.read("normal", into=target) is target and np.array_equal(target, normal)
        assert np.array_equal(position, simulation.state().position)
    at_surface = np.unique(scene.tetrahedra_set.surface) if scene.tetrahedra else slice(None)
    assert np.abs(normal - scene.grid.normals(position))[at_surface].max() < bound
