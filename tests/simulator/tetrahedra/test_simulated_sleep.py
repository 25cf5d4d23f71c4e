"""Sleeping vertices on both backends, on arrays: who keeps its place, and what the next substep knows."""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.cpu_backend.tetrahedra.sleep import make_sleep_stages
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.tetrahedra.sleep import make_sleep


def test_a_slow_vertex_with_slow_neighbours_keeps_its_place() -> None:
    """A ring of twelve: 3 and 7 are fast, 10 is pinned, and so 2 to 4 and 6 to 8 go on, as what is pinned does; velocities
    of those that go on are stored, of those that sleep nothing is left."""
    count, random = 12, np.random.default_rng(2)
    before, position, velocity = (random.normal(size=(count, SIZE)) for _ in range(3))
    position[:, 3], velocity[:, 3] = 1.0, 0.0
    position[10, 3] = 0.0
    slow = np.ones(count, np.int32)
    slow[[3, 7]] = 0
    neighbours = (
        np.stack([np.roll(np.arange(count), 1), np.roll(np.arange(count), -1)], axis=1).astype(np.int32).ravel()
    )
    offsets = np.arange(0, 2 * count + 1, 2, dtype=np.int32)
    sleeps = np.isin(np.arange(count), [0, 1, 5, 9, 11])[:, None]
    places, speeds = np.where(sleeps, before, position)[:, :3], np.where(sleeps, 0.0, velocity)[:, :3]

    of_cpu = [array.copy() for array in (position, velocity, random.normal(size=(count, 3)))]
    make_sleep_stages(np.float64, "exact").restore_resting(2, before, *of_cpu, slow, offsets, neighbours)
    of_gpu = [cuda.to_device(array.ravel()) for array in (position, velocity, random.normal(size=(count, SIZE)))]
    lists = (cuda.to_device(array) for array in (slow, offsets, neighbours))
    make_sleep(np.float64, "exact").restore_resting[2, 8](cuda.to_device(before.ravel()), *of_gpu, *lists)
    for arrays in (of_cpu, [array.copy_to_host().reshape(count, SIZE) for array in of_gpu]):
        assert np.array_equal(arrays[0][:, :3], places)
        assert np.array_equal(arrays[1][:, :3], speeds) and np.array_equal(arrays[2][:, :3], speeds)
        assert np.array_equal(arrays[0][:, 3], position[:, 3])
