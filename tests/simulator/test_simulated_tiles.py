"""The kernels on tiles, in plain Python: several blocks with halos, the same bits as the CPU.

The simulator runs blocks one after another. For `tiles` that is as good as together; `resident`, whose blocks wait for
each other, is run here with all blocks at once, each a group of Python threads.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numba.cuda.simulator import kernel as simulator_kernel
from numba.cuda.simulator import kernelapi

import softlab.gpu_backend.mass_spring.cloth.launch as cloth_launch
import softlab.gpu_backend.mass_spring.grid.tile_launch as tile_launch
import softlab.gpu_backend.tetrahedra.resident_launch as resident_launch
from softlab.app.driver import open_simulation
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.tiling import owned, parsed_tile, tile_count
from softlab.gpu_backend.mass_spring.grid.tiles import axis
from softlab.gpu_backend.mass_spring.tile_bits import tile_features
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import State
from softlab.model.scene.scene import load_scene

BUSY = {
    "grid.pinned": "every:3",
    "external.magnitude": 0.05,
    "perturbation.amplitude": 0.05,
}


def end_state(backend: str, rows: int, columns: int, integrator: str, steps: int = 7, **options: Any) -> State:
    changes = BUSY | {"grid.rows": rows, "grid.columns": columns, "method.integrator": integrator}
    scene = load_scene("lab-grid").replace(changes)
    with open_simulation(scene, backend, math="exact", live=("poke",), allow_unstable=True, **options) as simulation:
        simulation.poke(columns + 1, (0.05, -0.02))
        simulation.advance(1)
        simulation.advance(steps - 1)
        return simulation.state()


def assert_same(found: State, expected: State) -> None:
    assert np.array_equal(found.position, expected.position)
    assert np.array_equal(found.velocity, expected.velocity)


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
@pytest.mark.parametrize("tile", ["4x2x4h1", "8x2x3h2", "6x4x2h2"])
def test_tiles_with_halos_do_what_the_cpu_does(tile: str, integrator: str) -> None:
    """Tiles that fit and that do not, strips that the grid's edge cuts, steps that do not fill a pass."""
    expected = end_state("cpu", 11, 13, integrator)
    assert_same(end_state("gpu", 11, 13, integrator, kernel=f"tiles:{tile}"), expected)


@pytest.mark.parametrize("tile", ["4x2x4h1", "8x2x3h2", "6x4x2h2"])
def test_every_mass_is_owned_by_one_tile(tile: str) -> None:
    """Blocks run one after another here, so that one which writes what another owns is set right by the next: what each
    owns is looked at by itself, along an axis of any length, against the host's plan."""
    shape = parsed_tile(tile)
    plan = device_variant(np.float64, "exact", tile_features(shape))(axis)
    for masses in range(1, 40):
        for size in (shape.rows, shape.columns):
            count = tile_count(masses, size, shape.halo)
            found = [tuple(map(int, plan(np.int32(k), count, masses, size))) for k in range(count)]
            assert found == [owned(k, count, masses, size, shape.halo) for k in range(count)]
            ends = [(first, end) for _, first, end in found]
            assert [first for first, _ in ends] == [0, *(end for _, end in ends[:-1])] and ends[-1][1] == masses


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (8, 9), (3, 7)])
def test_one_block_holds_any_small_shape(shape: tuple[int, int]) -> None:
    expected = end_state("cpu", *shape, "lab") if min(shape) > 1 else None
    if expected is None:  # too small for the poke's mass
        scene = load_scene("lab-grid").replace({"grid.rows": shape[0], "grid.columns": shape[1]})
        states = []
        for backend, kernel in (("cpu", None), ("gpu", "one-block")):
            with open_simulation(scene, backend, math="exact", kernel=kernel) as simulation:
                simulation.advance(7)
                states.append(simulation.state())
        assert_same(states[1], states[0])
    else:
        assert_same(end_state("gpu", *shape, "lab", kernel="one-block"), expected)


@pytest.fixture
def blocks_together(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let the simulator run all blocks of a launch at once, each with shared memory of its own."""
    under_way: list[tuple[threading.Thread, list[BaseException]]] = []

    class Together(simulator_kernel.BlockManager):
        def run(self, grid_point: tuple, *args: Any) -> None:
            failures: list[BaseException] = []

            def block() -> None:
                try:
                    super(Together, self).run(grid_point, *args)
                except BaseException as error:
                    failures.append(error)

            thread = threading.Thread(target=block, daemon=True)
            under_way.append((thread, failures))
            thread.start()
            if len(under_way) == int(np.prod(self._grid_dim)):
                for running, found in under_way:
                    running.join(120)
                    assert not running.is_alive(), "blocks wait for each other for ever"
                    assert not found, found
                under_way.clear()

    plain = kernelapi.FakeCUDAShared.array
    own: dict[tuple[int, int], np.ndarray] = {}

    def array(self: Any, shape: Any, dtype: Any, alignment: Any = None) -> np.ndarray:
        manager = threading.current_thread()._manager  # type: ignore[attr-defined]
        if shape != 0:
            return plain(self, shape, dtype, alignment)
        with threading.Lock():
            return own.setdefault((id(self), id(manager)), np.zeros(self._dynshared_size // dtype.itemsize, dtype))

    monkeypatch.setattr(simulator_kernel, "BlockManager", Together)
    monkeypatch.setattr(kernelapi.FakeCUDAShared, "array", array)
    for module in (tile_launch, cloth_launch, resident_launch):
        monkeypatch.setattr(module, "device_limits", lambda: (64, 1 << 20))
    yield


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
def test_resident_blocks_exchange_their_borders(blocks_together: None, integrator: str) -> None:
    """3 x 2 blocks that own 4 x 4 masses and more, halos of 1: every step exchanges with up to eight neighbours."""
    expected = end_state("cpu", 10, 8, integrator, steps=5)
    assert_same(end_state("gpu", 10, 8, integrator, steps=5, kernel="resident:6x2x3h1"), expected)


def test_resident_blocks_exchange_every_other_step(blocks_together: None) -> None:
    expected = end_state("cpu", 11, 9, "lab", steps=8)
    assert_same(end_state("gpu", 11, 9, "lab", steps=8, kernel="resident:7x2x4h2"), expected)


def test_tiles_that_cannot_be_are_refused() -> None:
    scene = load_scene("lab-grid").replace({"grid.rows": 12, "grid.columns": 12})
    for kernel, word in (
        ("resident:6x2x3h1", "at once; use tiles or graph"),
        ("tiles:4x2x2h2", "too small for its halo"),
        ("tiles:4x2", "written like"),
        ("tiles:4x2x0h1", "written like"),
        ("graph:8x2x4h1", "must be one of"),
        ("one-block:8x2x4h0", "at most 8 x 8 masses"),
    ):
        with pytest.raises(SceneError, match=word):
            open_simulation(scene, "gpu", kernel=kernel)
