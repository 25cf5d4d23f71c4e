"""A grid in windows on the GPU, under the simulator, which runs them one after another: the bits of one window."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.gpu_backend.domains import devices, kernels
from softlab.gpu_backend.domains.flags import FlagSimulation
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.core.options import Options
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

LINKS = ("flags",)


def scene_of(rows: int = 8, columns: int = 5, **more: Any) -> Scene:
    settings = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": "every:3", "perturbation.amplitude": 0.05}
    return load_scene("lab-grid").replace(settings | more)


def end(scene: Scene, **options: Any) -> State:
    with open_simulation(scene, math="exact", **options) as simulation:
        simulation.advance(3)
        simulation.advance(4)
        return simulation.state()


def same(found: State, wanted: State) -> None:
    assert np.array_equal(found.position, wanted.position)
    assert np.array_equal(found.velocity, wanted.velocity)


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "rk4"])
def test_two_windows_have_the_bits_of_the_cpu(link: str, integrator: str) -> None:
    scene = scene_of(**{"method.integrator": integrator, "external.magnitude": 0.05})
    same(end(scene, backend="gpu", gpus=2, link=link), end(scene, threads=1))


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("kernel", ["stages", "launch", "one-block", "tiles:4x2x3h1"])
def test_every_kernel_steps_a_window(link: str, kernel: str) -> None:
    scene = scene_of(rows=13, **{"external.magnitude": 0.05})
    found = end(scene, backend="gpu", gpus=3, link=link, kernel=kernel, exchange_every=2)
    same(found, end(scene, threads=1))


def test_every_second_spring_is_the_same_in_a_window() -> None:
    scene = scene_of(rows=9, **{"springs.stiffness_ratio": 3.0, "method.dt": 0.002})
    same(end(scene, backend="gpu", gpus=2, precision="float64"), end(scene, threads=1, precision="float64"))


@pytest.mark.parametrize("link", LINKS)
def test_a_cloth_has_the_bits_of_the_cpu(link: str) -> None:
    """In space a mass is a quad; wind and springs against bending ask for two rows."""
    settings = {"cloth.rows": 9, "cloth.columns": 4, "method.integrator": "semi-implicit-euler", "method.dt": 1e-4}
    scene = load_scene("cloth-wind").replace(settings)
    same(end(scene, backend="gpu", gpus=2, link=link), end(scene, threads=1))


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize(
    "changes", [{"method.ordering": "gauss-seidel", "method.substeps": 2}, {"method.ordering": "jacobi"}]
)
def test_a_cloth_of_constraints_has_the_bits_of_the_cpu(link: str, changes: dict[str, Any]) -> None:
    """By Gauss-Seidel windows exchange after each of two substeps, whose colours begin with the cloth's; 7 steps and 8 rows
    of halo."""
    settings = {"cloth.rows": 16, "cloth.columns": 4, "method.substeps": 1, "method.dt": 0.01}
    scene = load_scene("cloth-small-steps").replace(settings | changes)
    same(end(scene, backend="gpu", gpus=2, link=link), end(scene, threads=1))


def test_a_lost_neighbour_is_an_error_and_no_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody pushes: each wait ends by the clock, and a look at the state says so."""
    monkeypatch.setattr(kernels, "PATIENCE", 10_000_000)
    kernels.make_border_kernels.cache_clear()
    with FlagSimulation(scene_of(), Options(math="exact"), 2) as simulation:
        monkeypatch.setattr(simulation.exchange, "post", lambda: None)
        simulation.advance(1)
        with pytest.raises(BackendUnavailable, match="does not answer"):
            simulation.state()
    kernels.make_border_kernels.cache_clear()


def test_more_gpus_than_there_are_is_exit_status_3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "sharing", lambda: False)
    with pytest.raises(BackendUnavailable, match=r"2 GPUs were requested, and 1 is here; use gpus=1") as found:
        open_simulation(scene_of(), "gpu", gpus=2)
    assert found.value.exit_status == 3


def test_a_grid_with_fewer_rows_than_gpus_is_exit_status_2() -> None:
    with pytest.raises(SceneError, match="at most 8"):
        open_simulation(scene_of(), "gpu", gpus=9)


def test_without_nccl_one_line_says_how_to_get_it() -> None:
    with pytest.raises(BackendUnavailable, match="pip install"):
        open_simulation(scene_of(), "gpu", gpus=2, link="nccl")
