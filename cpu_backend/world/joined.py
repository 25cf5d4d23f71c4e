"""Particles of several members in one array, on CPU threads: copies of those in contact, and transfers to and from
members."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.simulation import ParticlesSimulation
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.descent import carried

AXES = 3


@routine
def take(band, bands, flat, slots, stride, first, rows):
    """Read coordinate `axis` of row first + k from flat[slots[k] + axis * stride]."""
    count = slots.size
    for k in range(count * band // bands, count * (band + 1) // bands):
        for axis in range(AXES):
            rows[first + k, axis] = flat[slots[k] + axis * stride]


@routine
def give(band, bands, rows, weights, slots, stride, first, flat):
    """Write rows back, in the form that `take` reads, for particles with a weight."""
    count = slots.size
    for k in range(count * band // bands, count * (band + 1) // bands):
        if weights[first + k] > 0.0:
            for axis in range(AXES):
                flat[slots[k] + axis * stride] = rows[first + k, axis]


@routine
def carry(band, bands, rows, weights, slots, stride, first, flat, inertial):
    """Add displacements to `inertial`, before `give`."""
    count = slots.size
    for k in range(count * band // bands, count * (band + 1) // bands):
        if weights[first + k] > 0.0:
            for axis in range(AXES):
                at = slots[k] + axis * stride
                inertial[at] = carried(inertial[at], rows[first + k, axis], flat[at])


@cache
def make_transfers(real: Real) -> SimpleNamespace:
    """Compile `take`, `give` and `carry`."""
    compiler = Compiler(f"joined_{np.dtype(real).name}", "exact")
    copied = compiler.variant_of(real).copied
    return SimpleNamespace(**{one.__name__: compiler.banded(copied(one)) for one in (take, give, carry)})


class Joined:
    """The `particles` (n,) of a world, ascending, whose members' particles are in `slices`.

    `before`, `position` (n, 3) [m]: at the start of a substep, and now; `weights` (n,): inverse masses of one unit for
    all.
    """

    def __init__(
        self, particles: np.ndarray, members: Mapping[str, ParticlesSimulation], slices: Mapping[str, slice],
        weights: np.ndarray, bands: int,
    ):  # fmt: skip
        real = next(iter(members.values())).real
        self.before, self.position = (np.zeros((len(particles), AXES), real) for _ in range(2))
        self.weights = np.ascontiguousarray(weights[particles], real)
        self._bands, self._transfers = bands, make_transfers(real)
        self._members: list[tuple[np.ndarray, np.ndarray, np.ndarray, int, int]] = []
        self._inertial: list[np.ndarray | None] = []
        for name, member in members.items():
            place = slices[name]
            first, stop = np.searchsorted(particles, [place.start, place.stop])
            if stop > first:
                position, _, slots, stride = member._places()
                indices = np.ascontiguousarray(slots[particles[first:stop] - place.start])
                self._members.append((position, member.substep_start, indices, stride, int(first)))
                self._inertial.append(member.inertial)

    def take(self, fresh: bool) -> None:
        """Read the members' positions; with `fresh` also those at the start of the substep."""
        for position, before, slots, stride, first in self._members:
            self._transfers.take(self._bands, position, slots, stride, first, self.position)
            if fresh:
                self._transfers.take(self._bands, before, slots, stride, first, self.before)

    def give(self) -> None:
        """Write the positions back to the members."""
        for (position, _, slots, stride, first), inertial in zip(self._members, self._inertial, strict=True):
            there = self._bands, self.position, self.weights, slots, stride, first, position
            if inertial is not None:
                self._transfers.carry(*there, inertial)
            self._transfers.give(*there)
