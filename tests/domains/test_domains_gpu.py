"""A grid in windows, bodies in shares, fluids in slabs, on real GPUs: the bits of one. One GPU alone they take in turns."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from bits_row import PRECISIONS, different

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
    assert not {"position", "velocity", "rotation", "plastic"} & set(different(found, wanted))


@dataclass(frozen=True)
class Row:
    """A scene after some steps: `options` of all runs, those of the one run alone, and of each that shares it."""

    name: str
    scene: Callable[[], Scene]
    steps: int
    shared: tuple[dict[str, Any], ...]
    alone: dict[str, Any] = field(default_factory=lambda: {"backend": "gpu"})
    options: dict[str, Any] = field(default_factory=dict)


def several(*counts: int, **more: Any) -> tuple[dict[str, Any], ...]:
    """A run on each number of GPUs; windows are named their link."""
    return tuple({"gpus": count, **more} for count in counts)


def windows() -> Iterator[Row]:
    link = {"link": "flags"}
    yield Row("10 000 steps", scene_of, 10_000, several(2, 3, 4, **link))
    for integrator in INTEGRATORS:
        if integrator not in (
            "explicit-euler",
            "taylor",
        ):  # random forces are told by a mass's number in the whole grid
            scene = partial(scene_of, **{"method.integrator": integrator, "external.magnitude": 0.05})
            yield Row(f"grid {integrator}", scene, 500, several(2, **link), alone={"threads": 2})
    for kernel in ("tiles", "graph", "launch", "resident", "stages"):
        how = [one for every in (1, 4, 5, 8) for one in several(3, kernel=kernel, exchange_every=every, **link)]
        yield Row(f"by {kernel}", partial(scene_of, rows=300, columns=130), 200, tuple(how))
    for precision in PRECISIONS:  # more masses than the chip holds: tiles, 16 steps between exchanges
        options, large = {"precision": precision}, partial(scene_of, rows=2048, columns=1500)
        yield Row(f"large {precision}", large, 100, several(2, **link), options=options)
        # 64 launches of four steps, captured in bands of rows of tiles, against a launch a step
        bands, launch = ({"kernel": "tiles"},), {"backend": "gpu", "kernel": "launch"}
        scene = partial(scene_of, rows=1500, columns=1100)
        yield Row(f"bands {precision}", scene, 600, bands, alone=launch, options=options)
    for name in ("cloth-hanging", "cloth-wind", "cloth-sphere"):
        for integrator in ("velocity-verlet", "semi-implicit-euler", "rk4"):
            settings = {"cloth.rows": 200, "cloth.columns": 61, "method.integrator": integrator, "method.dt": 1e-4}
            yield Row(f"{name} {integrator}", partial(changed, name, settings), 500, several(3, **link))
    for ordering in ("gauss-seidel", "jacobi", "averaged-jacobi"):  # exchanges after some substeps
        settings = {"cloth.rows": 300, "cloth.columns": 61, "method.substeps": 6, "method.ordering": ordering}
        how = [one for kernel in (None, "tiled", "graph") for one in several(3, kernel=kernel, **link)]
        yield Row(f"constraints {ordering}", partial(changed, "cloth-small-steps", settings), 60, tuple(how))


def others() -> Iterator[Row]:
    for kernel in (None, "launch"):  # clay, putty and jelly; in turns of 64 steps, which graphs of many steps take
        yield Row(f"bodies {kernel}", partial(changed, "plastic", {}), 1000, several(3), options={"kernel": kernel})
    box = {"shape": {"name": "box", "sides": [0.4, 0.2, 0.2]}, "edge": 0.05, "young_modulus": 1e5, "damping": 0.01}
    sweeps = ({}, {}, {"sweep": "tetrahedra"}, {"material": "neo-hookean"}, {"sweep": "tetrahedra"})
    fallen = {
        f"bar{n}": box | {"kind": "tetrahedral_body", "origin": [n, 0.3, 0.0], "spin": [n, 2.0, 0.0]} | sweep
        for n, sweep in enumerate(sweeps)
    }  # two of single tetrahedra, whose colours are all bodies'
    for solver in ("xpbd", "vbd"):
        method = {"solver": solver, "dt": 1 / 240, "substeps": 2, "iterations": 4}
        yield Row(f"tetrahedra {solver}", partial(on_a_plane, fallen, method), 300, several(3))
    # a dam break along the floor of a narrow tank: particles cross between slabs, which are balanced anew on the way
    pool = {"water.size": [2.4, 0.3, 0.1], "right.point": [3, 0, 0], "front.point": [0, 0, 0.1], "method.iterations": 2}
    bar = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [4.0, 0.2, 0.2]}, "edge": 0.05}
    bar |= {"young_modulus": 1e5, "damping": 0.01, "origin": [0.0, 0.3, 0.0]}
    held = {"held": bar | {"pinned": ["left"]}}
    single = {"single": bar | {"sweep": "tetrahedra", "spin": [1.0, 0.5, 0.0]}}
    for precision in PRECISIONS:
        options = {"precision": precision}
        yield Row(f"fluid {precision}", partial(changed, "dam-break", pool), 300, several(2, 3, 4), options=options)
        for solver, iterations in (("xpbd", 2), ("vbd", 1)):  # partitions of a mesh
            method = {"solver": solver, "dt": 1 / 240, "substeps": 4, "iterations": iterations}
            for bars, gpus in ((held, 4), (held | single, 3)):
                how = several(gpus) + several(gpus, kernel="launch")
                name = f"{len(bars)} bars {solver} {precision}"
                yield Row(name, partial(on_a_plane, bars, method), 300, how, options=options)


def changed(name: str, changes: dict[str, Any]) -> Scene:
    return load_scene(name).replace(changes)


def on_a_plane(bars: dict[str, Any], method: dict[str, Any]) -> Scene:
    return Scene({**bars, "plane": {}, "gravity": {}, "method": method})


@pytest.mark.parametrize("row", [pytest.param(row, id=row.name.replace(" ", "-")) for row in (*windows(), *others())])
def test_shares_have_the_bits_of_one(row: Row) -> None:
    scene = row.scene()
    wanted = end(scene, row.steps, **row.options | row.alone)
    for how in row.shared:
        same(end(scene, row.steps, backend="gpu", **row.options | how), wanted)


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
