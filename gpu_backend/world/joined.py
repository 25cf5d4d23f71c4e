"""Particles of several members in one array, on CUDA: copies of those in contact, and transfers to and from members."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import Stream
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.substeps import SubstepSimulation
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.descent import carried

THREADS = 128


@routine
def take(quads, particles, first, rows):
    """Read quad first + k of `rows` from that of particles[k]."""
    k = np.int64(cuda.grid(1))
    if k < particles.size:
        p = load_quad(quads, particles[k])
        store_quad(rows, first + k, p[0], p[1], p[2], p[3])


@routine
def give(rows, weights, particles, first, quads):
    """Write rows back, as `take` reads them, for particles with a weight; a quad keeps its fourth number."""
    k = np.int64(cuda.grid(1))
    if k < particles.size and weights[first + k] > 0.0:
        p = load_quad(rows, first + k)
        store_quad(quads, particles[k], p[0], p[1], p[2], load_quad(quads, particles[k])[3])


@routine
def carry(rows, weights, particles, first, quads, inertial):
    """Add displacements to `inertial`, before `give`."""
    k = np.int64(cuda.grid(1))
    if k < particles.size and weights[first + k] > 0.0:
        at = particles[k]
        p, q, y = load_quad(rows, first + k), load_quad(quads, at), load_quad(inertial, at)
        store_quad(inertial, at, carried(y[0], p[0], q[0]), carried(y[1], p[1], q[1]), carried(y[2], p[2], q[2]), y[3])


@cache
def make_transfers(real: Real) -> SimpleNamespace:
    """Compile `take`, `give` and `carry`."""
    return kernels_of(device_variant(real, "exact"), "exact", (take, give, carry), f"joined_{variant_name(real)}")


class Joined:
    """The `particles` of a world, as in cpu_backend/world/joined.py. `before`, `position`: quads, on the device."""

    def __init__(
        self, particles: np.ndarray, members: Mapping[str, SubstepSimulation], slices: Mapping[str, slice],
        weights: np.ndarray, stream: Stream,
    ):  # fmt: skip
        real = next(iter(members.values())).real
        self.weights = np.ascontiguousarray(weights[particles], real)
        self.before, self.position = (
            cuda.to_device(np.zeros(SIZE * len(particles), real), stream=stream) for _ in range(2)
        )
        self._weights, self._transfers = cuda.to_device(self.weights, stream=stream), make_transfers(real)
        self._members: list[tuple[SubstepSimulation, Any, np.int64, tuple[Any, ...]]] = []
        for name, member in members.items():
            place = slices[name]
            first, stop = map(int, np.searchsorted(particles, [place.start, place.stop]))
            if stop > first:
                indices = cuda.to_device((particles[first:stop] - place.start).astype(np.int32), stream=stream)
                launch = (-(-(stop - first) // THREADS), THREADS, stream)
                self._members.append((member, indices, np.int64(first), launch))

    @property
    def taking(self) -> int:
        """Number of launches of `take` of positions only; there are twice as many if `fresh`."""
        return len(self._members)

    @property
    def giving(self) -> int:
        """Number of launches of `give`."""
        return len(self._members) + sum(member.inertial is not None for member, *_ in self._members)

    def take(self, fresh: bool) -> None:
        """Read the members' positions; with `fresh` also those at the start of the substep."""
        for member, indices, first, launch in self._members:
            self._transfers.take[launch](member.position[member._current], indices, first, self.position)
            if fresh:
                self._transfers.take[launch](member.substep_start, indices, first, self.before)

    def give(self) -> None:
        """Write the positions back to the members."""
        for member, indices, first, launch in self._members:
            there = self.position, self._weights, indices, first, member.position[member._current]
            if member.inertial is not None:
                self._transfers.carry[launch](*there, member.inertial)
            self._transfers.give[launch](*there)
