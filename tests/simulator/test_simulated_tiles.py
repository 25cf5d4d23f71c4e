"""Tiles of a grid with halos, in plain Python: who owns a mass; and a fixture that runs all blocks of a launch at once.

The simulator runs blocks one after another. For `tiles` that is as good as together; blocks of `resident` wait for each
other, so each is a group of Python threads here.
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
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.tiling import owned, parsed_tile, tile_count
from softlab.gpu_backend.mass_spring.grid.tiles import axis
from softlab.gpu_backend.mass_spring.tile_bits import tile_features


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
