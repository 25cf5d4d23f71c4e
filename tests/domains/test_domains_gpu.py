"""A grid in windows, bodies in shares, fluids in slabs, on real GPUs: the bits of one. One GPU alone they take in turns."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.gpu_backend.core.device import gpu_available
from softlab.gpu_backend.domains.devices import gpu_count
from softlab.gpu_backend.domains.flags import FlagSimulation
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.options import Options
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
LINKS = ("flags",)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOFTLAB_SHARE_GPU", "1")


def scene_of(rows: int = 200, columns: int = 61, **more: Any) -> Scene:
    settings = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": "every:7", "perturbation.amplitude": 0.05}
    return load_scene("lab-grid").replace(settings | more)


def end(scene: Scene, steps: int, **options: Any) -> State:
    with open_simulation(scene, math="exact", allow_unstable=True, **options) as simulation:
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


def same(found: State, wanted: State) -> None:
    assert np.array_equal(found.position, wanted.position)
    assert np.array_equal(found.velocity, wanted.velocity)


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("count", [2, 3, 4])
def test_windows_have_the_bits_of_one_gpu_after_10_000_steps(count: int, link: str) -> None:
    scene = scene_of()
    same(end(scene, 10_000, backend="gpu", gpus=count, link=link), end(scene, 10_000, backend="gpu"))


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("integrator", [name for name in INTEGRATORS if name not in ("explicit-euler", "taylor")])
def test_every_part_and_integrator_has_the_bits_of_the_cpu(integrator: str, link: str) -> None:
    """Random forces are told by a mass's number in the whole grid."""
    scene = scene_of(**{"method.integrator": integrator, "external.magnitude": 0.05})
    same(end(scene, 500, backend="gpu", gpus=2, link=link), end(scene, 500, threads=2))


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("kernel", ["tiles", "graph", "launch", "resident", "stages"])
def test_every_kernel_steps_a_window(kernel: str, link: str) -> None:
    scene = scene_of(rows=300, columns=130)
    wanted = end(scene, 200, backend="gpu")
    for every in (1, 4, 5, 8):
        same(end(scene, 200, backend="gpu", gpus=3, link=link, kernel=kernel, exchange_every=every), wanted)


@pytest.mark.parametrize("link", LINKS)
def test_a_large_grid_in_both_precisions(link: str) -> None:
    """More masses than the chip holds: tiles, 16 steps between exchanges."""
    for precision in ("float32", "float64"):
        scene = scene_of(rows=2048, columns=1500)
        how: dict[str, Any] = {"backend": "gpu", "precision": precision}
        same(end(scene, 100, gpus=2, link=link, **how), end(scene, 100, **how))


@pytest.mark.parametrize("link", LINKS)
def test_a_forced_mass_and_a_switched_field(link: str) -> None:
    scene = scene_of()
    found = []
    for gpus in (1, 3):
        with open_simulation(scene, "gpu", math="exact", live=("poke", "gravity"), gpus=gpus, link=link) as simulation:
            simulation.poke(150 * 61 + 30, (0.5, -0.25))
            simulation.advance(50)
            simulation.set("gravity.enabled", False)
            simulation.poke(None)
            simulation.advance(50)
            found.append(simulation.state())
    same(*found)


@pytest.mark.parametrize("kernel", ["tiles", "graph"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
def test_cycles_in_graphs_have_the_bits_of_one_gpu(integrator: str, kernel: str) -> None:
    """Two small windows run beside one another on one GPU, each in graphs of many cycles; kernels wait for kernels. 16 + 4 +
    2 cycles, one by itself, and a rest of steps."""
    scene, steps, every = scene_of(**{"method.integrator": integrator}), 23 * 4 + 3, 4
    options = Options(math="exact", kernel=kernel)
    with FlagSimulation(scene, options, 2, every, graphs=True) as simulation:
        assert simulation._cycles
        simulation.advance(steps)
        found = simulation.state()
        simulation.advance(steps)  # replayed, where its buffers lie as they did
        again = simulation.state()
    same(found, one_after(scene, steps))
    same(again, one_after(scene, 2 * steps))


def one_after(scene: Scene, steps: int) -> State:
    with open_simulation(scene, "gpu", math="exact") as one:
        one.advance(steps)
        return one.state()


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("name", ["cloth-hanging", "cloth-wind", "cloth-sphere"])
@pytest.mark.parametrize("integrator", ["velocity-verlet", "semi-implicit-euler", "rk4"])
def test_a_cloth_has_the_bits_of_one_gpu(integrator: str, name: str, link: str) -> None:
    settings = {"cloth.rows": 200, "cloth.columns": 61, "method.integrator": integrator, "method.dt": 1e-4}
    scene = load_scene(name).replace(settings)
    same(end(scene, 500, backend="gpu", gpus=3, link=link), end(scene, 500, backend="gpu"))


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi", "averaged-jacobi"])
def test_a_cloth_of_constraints_has_the_bits_of_one_gpu(ordering: str, link: str) -> None:
    """Windows exchange after some substeps; on tiles and by a launch a colour."""
    settings = {"cloth.rows": 300, "cloth.columns": 61, "method.substeps": 6, "method.ordering": ordering}
    scene = load_scene("cloth-small-steps").replace(settings)
    wanted = end(scene, 60, backend="gpu")
    for kernel in (None, "tiled", "graph"):
        same(end(scene, 60, backend="gpu", gpus=3, link=link, kernel=kernel), wanted)


@pytest.mark.parametrize("kernel", [None, "launch"])
def test_bodies_in_shares_have_the_bits_of_one_gpu(kernel: str | None) -> None:
    """Clay, putty and jelly; in turns of 64 steps, which graphs of many steps take."""
    scene, how = load_scene("plastic"), {"backend": "gpu", "kernel": kernel}
    found, wanted = end(scene, 1000, gpus=3, **how), end(scene, 1000, **how)
    same(found, wanted)
    assert np.array_equal(found.rotation, wanted.rotation) and np.array_equal(found.plastic, wanted.plastic)


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
def test_tetrahedra_in_shares_have_the_bits_of_one_gpu(solver: str) -> None:
    """Five bars that fall, two of single tetrahedra, whose colours are all bodies': by whichever kernel each share takes."""
    box = {"shape": {"name": "box", "sides": [0.4, 0.2, 0.2]}, "edge": 0.05, "young_modulus": 1e5, "damping": 0.01}
    bars = {
        f"bar{n}": box | {"kind": "tetrahedral_body", "origin": [n, 0.3, 0.0], "spin": [n, 2.0, 0.0]} | sweep
        for n, sweep in enumerate(
            [{}, {}, {"sweep": "tetrahedra"}, {"material": "neo-hookean"}, {"sweep": "tetrahedra"}]
        )
    }
    method = {"solver": solver, "dt": 1 / 240, "substeps": 2, "iterations": 4}
    scene = Scene({**bars, "plane": {}, "gravity": {}, "method": method})
    same(end(scene, 300, backend="gpu", gpus=3), end(scene, 300, backend="gpu"))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_fluid_in_slabs_has_the_bits_of_one_gpu(count: int, precision: str) -> None:
    """A dam break along the floor of a narrow tank: particles cross between slabs, which are balanced anew on the way."""
    pool = {"water.size": [2.4, 0.3, 0.1], "right.point": [3, 0, 0], "front.point": [0, 0, 0.1], "method.iterations": 2}
    scene, how = load_scene("dam-break").replace(pool), {"backend": "gpu", "precision": precision}
    same(end(scene, 300, gpus=count, **how), end(scene, 300, **how))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("solver, iterations", [("xpbd", 2), ("vbd", 1)])
def test_partitions_of_a_mesh_have_the_bits_of_one_gpu(solver: str, iterations: int, precision: str) -> None:
    """A bar on four GPUs, which one steps on its chip where it fits; and two, one of single tetrahedra, on three."""
    bar = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [4.0, 0.2, 0.2]}, "edge": 0.05}
    bar |= {"young_modulus": 1e5, "damping": 0.01, "origin": [0.0, 0.3, 0.0]}
    method = {"solver": solver, "dt": 1 / 240, "substeps": 4, "iterations": iterations}
    held, single = (
        {"held": bar | {"pinned": ["left"]}},
        {"single": bar | {"sweep": "tetrahedra", "spin": [1.0, 0.5, 0.0]}},
    )
    for bars, gpus in ((held, 4), (held | single, 3)):
        scene = Scene({**bars, "plane": {}, "gravity": {}, "method": method})
        how: dict[str, Any] = {"backend": "gpu", "precision": precision}
        wanted = end(scene, 300, **how)
        for kernel in (None, "launch"):
            same(end(scene, 300, gpus=gpus, kernel=kernel, **how), wanted)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_passes_in_bands_have_the_bits_of_a_launch_a_step(precision: str) -> None:
    """64 launches of four steps, captured in bands of rows of tiles."""
    scene = scene_of(rows=1500, columns=1100)
    how: dict[str, Any] = {"backend": "gpu", "precision": precision}
    same(end(scene, 600, kernel="tiles", **how), end(scene, 600, kernel="launch", **how))


def two_gpus() -> bool:
    return gpu_available()[0] and gpu_count() > 1


needs_two = pytest.mark.skipif(not two_gpus(), reason="needs two GPUs")


@needs_two
def test_nccl_has_the_bits_of_one_gpu() -> None:
    pytest.importorskip("nccl")
    for scene in (scene_of(rows=2048, columns=301), load_scene("cloth-small-steps")):
        same(end(scene, 60, backend="gpu", gpus=2, link="nccl"), end(scene, 60, backend="gpu"))


@needs_two
@pytest.mark.parametrize("link", LINKS)
def test_a_process_that_used_two_gpus_ends_as_others_do(link: str) -> None:
    """What both have loaded is freed once: exit status 0."""
    command = ["-m", "softlab", "run", "lab-grid", "--backend", "gpu", "--gpus", "2", "--link", link, "--steps", "50"]
    done = subprocess.run(
        [sys.executable, *command, "--no-judge"], cwd=ROOT, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
