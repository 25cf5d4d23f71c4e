"""Neighbour search among particles on CUDA, for all interactions of nearby particles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_find import MIN_TABLE, make_find
from softlab.gpu_backend.core.device import DeviceArray, Stream
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.scan import Scan
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import table_size

THREADS = 128


def _table(particles: int) -> int:
    return max(MIN_TABLE, table_size(particles))


def neighbour_bytes(particles: int, has_self_contact: bool, item: int) -> int:
    """Return the device memory [bytes] for the neighbours of so many particles; `item`: bytes per scalar;
    `has_self_contact`: also within bodies."""
    return particles * (SIZE * item * (1 + has_self_contact) + 4 * (MAX_NEIGHBOURS + 6)) + 8 * (_table(particles) + 1)


class Neighbours:
    """The neighbours of particles. `found` (particles,) int32: number of neighbours of each particle.

    `table` (MAX_NEIGHBOURS * particles,): neighbour s of particle i at index s * particles + i, in the order of cells,
    then of numbers. `pairs`: (the body of each particle, the kind of each body, number of kinds); the rows of pairs in
    a record define which kinds are neighbours, and up to which distance (model/contact/particle_parameters.py). `rest`
    (particles, 3) [m], if particles of a body may be neighbours (`has_self_contact`): those that are neighbours at rest are
    excluded. Only launches, so that they can be captured in a graph.
    """

    launches = 7  # of `find`, each of `flat`: one thread per particle

    def __init__(self, real: Real, particles: int, pairs: tuple[Any, ...], rest: np.ndarray | None, stream: Stream):
        self._stream, self._pairs, has_self_contact = stream, pairs, rest is not None
        quads: np.ndarray = np.zeros((particles if has_self_contact else 1, SIZE), real)
        quads[:, :3] = 0 if rest is None else rest
        self._rest = self._new(quads.reshape(-1))
        table = _table(particles) + 1  # the last number of its starts is the total
        self._counts, self._starts = self._integers(table), self._integers(table)
        self._buckets, self._filled, self._sorted_particles, self._sorted_bodies, self.neighbour_counts = (
            self._integers(particles) for _ in range(5)
        )
        self._sorted = self._new(np.zeros(SIZE * particles, real))
        self.table = cuda.device_array(MAX_NEIGHBOURS * particles, np.int32, stream=stream)
        self._lost = self._new(np.zeros(1, np.int64))
        self._scan, self.flat = Scan(table, stream), ((particles + THREADS - 1) // THREADS, THREADS, stream)
        self._find = make_find(real, has_self_contact, int(pairs[2]) > 1)

    def _new(self, array: np.ndarray) -> DeviceArray:
        return cuda.to_device(array, stream=self._stream)

    def _integers(self, count: int) -> DeviceArray:
        return self._new(np.zeros(count, np.int32))

    def find(self, position: DeviceArray, record: DeviceArray) -> None:
        """Search from quads of positions, whose fourth number is the weight: a particle of weight 0 has no neighbours.
        `record`: rows of pairs, and the largest distance between neighbours."""
        kernels, flat, ordered = self._find, self.flat, (self._sorted, self._sorted_particles, self._sorted_bodies)
        kernels.hash_particles[flat](position, record, self._buckets, self._counts)
        self._scan.run(self._counts, self._starts, self._starts)
        kernels.fill_buckets[flat](self._buckets, self._starts, self._counts, self._filled)
        kernels.arrange[flat](position, self._buckets, self._starts, self._filled, self._pairs[0], *ordered)
        kernels.find_neighbours[flat](
            position, record, self._buckets, self._starts, *ordered, *self._pairs, self._rest, self.table,
            self.neighbour_counts, self._lost,
        )  # fmt: skip

    @property
    def lost(self) -> int:
        """Number of neighbours beyond the MAX_NEIGHBOURS of a particle, over all searches so far."""
        host = self._lost.copy_to_host(stream=self._stream)
        cuda.synchronize()
        return int(host[0])

    def forget(self) -> None:
        """Set the counter to 0."""
        self._lost.copy_to_device(np.zeros(1, np.int64), stream=self._stream)
