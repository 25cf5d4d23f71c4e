"""Common parts of all solvers on CPU threads: threads, snapshots of the state, checks for divergence, and transfers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import Layout
from softlab.cpu_backend.core.processor import processor_name
from softlab.cpu_backend.core.threads import thread_count
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.contact.cloth_parameters import pin_velocity
from softlab.model.core.options import unknown_kernel
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options, Simulation
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import COLLIDER_KINDS
from softlab.model.tetrahedra.targets import Targeted

WIDTH = 4  # numbers of a particle in space: x, y, z and, for positions, its weight


@routine
def first_diverged(state, bound, centre, bad):
    """Write, per row, the first bad column, not finite or farther than `bound` from `centre` (axes,) along an axis, or -1.

    `state` (2 axes, rows, columns). No fast math: NaN must be detected.
    """
    zero = bound - bound
    for i in prange(state.shape[1]):
        bad[i] = -1
        for j in range(state.shape[2]):
            good = True
            for axis in range(FEATURE.axes):
                inside = abs(state[axis, i, j] - centre[axis]) <= bound  # false for NaN
                still = state[FEATURE.axes + axis, i, j] - state[FEATURE.axes + axis, i, j] == zero
                good = good and inside and still
            if not good:
                bad[i] = j
                break


@routine
def first_diverged_particle(position, velocity, slots, stride, bound, centre, bands, bad):
    """Write, per band, the first bad particle, in the sense of `first_diverged`, or -1.

    Coordinate `axis` of particle k is at slots[k] + axis * stride of both flat arrays.
    """
    zero, particles = bound - bound, slots.size
    for band in prange(bands):
        bad[band] = -1
        for k in range(particles * band // bands, particles * (band + 1) // bands):
            good = True
            for axis in range(FEATURE.axes):
                place = slots[k] + axis * stride
                good = good and abs(position[place] - centre[axis]) <= bound  # false for NaN
                good = good and velocity[place] - velocity[place] == zero
            if not good:
                bad[band] = k
                break


@cache
def make_first_diverged(real: Real, axes: int) -> Callable:
    """Compile `first_diverged`."""
    compiler = Compiler(f"{axes}d_{np.dtype(real).name}", "exact")
    return compiler.kernel(compiler.variant_of(real, {"axes": axes}).copied(first_diverged))


@cache
def make_first_diverged_of(real: Real, axes: int) -> Callable:
    """Compile `first_diverged_particle`."""
    compiler = Compiler(f"particles_{axes}d_{np.dtype(real).name}", "exact")
    return compiler.kernel(compiler.variant_of(real, {"axes": axes}).copied(first_diverged_particle))


def chosen_kernel(wanted: str | None, what: str, known: Sequence[str] = ("fused", "stages")) -> str:
    """Return the kernel `wanted`, or the first one known. Raises SceneError for others; `what`: the solver."""
    if wanted is not None and wanted not in known:
        raise unknown_kernel(wanted, known, f"for {what} on the cpu")
    return wanted or known[0]


class CpuSimulation(Simulation):
    """The part of the contract (model/core/simulation.py) that does not depend on the layout of the state.

    `threads`: `1x`, `2x`, `4x` or a number. A solver sets `plan`, `kernel`, `integers` (1 + poked particle at [1]),
    `_bands` (parts that the work is divided into) and `_executor`; `bodies`, `kinds` are the rows of colliders and
    their kinds.
    """

    backend = "cpu"
    integers: np.ndarray
    _bands: int
    _executor: Executor
    _bad: np.ndarray

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options)
        self.threads, self.device = thread_count(threads), processor_name()

    @property
    def record(self) -> np.ndarray:
        """Constants as an array of one record: numba's parallel loops do not accept records."""
        return self._record

    @property
    def parameters(self) -> Any:
        """The constants that compiled functions read by name."""
        return self._record[0]

    def _seeds(self, count: int = 3) -> np.ndarray:
        """Return (count,) uint64: the seed of external forces; 1 + the poked particle or 0; the seed of gusts; ..."""
        seeds = np.zeros(count, np.uint64)
        seeds[0] = self.scene.external.seed if self.scene.external else 0
        if count > 2:
            seeds[2] = self.scene.wind.seed if self.scene.wind else 0
        return seeds

    def _set_colliders(self, rows: np.ndarray) -> None:
        self.bodies = rows
        self.kinds = np.array([COLLIDER_KINDS.index(kind) for kind, _ in self.scene.colliders], np.int64)

    def _run(self, steps: int) -> None:
        numba.set_num_threads(self._bands)  # one thread for each band
        self._executor.run(self.step, steps)

    def _parameters_changed(self) -> None:
        self.integers[1] = self._poke_particle + 1

    def synchronize(self) -> None:
        """Do nothing: a call returns when its steps are done."""

    def close(self) -> None:
        """Delete the executor: its reference to the simulation would keep arrays alive until a garbage collection."""
        super().close()
        self.__dict__.pop("_executor", None)


class ParticlesSimulation(CpuSimulation):
    """A simulation of particles in any order; a solver defines their layout by `_places`."""

    @abstractmethod
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Return (positions, velocities, offset of each first coordinate, stride of coordinates), flat arrays."""

    @property
    def substep_start(self) -> np.ndarray:
        """Positions at the start of the substep, laid out as the first of `_places`; for the kernel `stages`."""
        raise NotImplementedError

    @property
    def inertial(self) -> np.ndarray | None:
        """Inertial positions, in the same layout, of solvers that use them in every iteration. Displacements by other
        solvers must be applied to them, too."""
        return None

    def _first_diverged(self) -> int:
        return self._first_diverged_of(*self._places())

    def _first_diverged_of(self, *places: np.ndarray | int) -> int:
        """Return the index of the first diverged particle among `places`, see `_places`, or -1."""
        numba.set_num_threads(self._bands)
        check = make_first_diverged_of(self.real, self.scene.dimensions)
        check(*places, self.real(self._bound), self._centre.astype(self.real), self._bands, self._bad)
        bad = self._bad[self._bad >= 0]
        return int(bad[0]) if len(bad) else -1


class QuadsSimulation(Targeted, ParticlesSimulation):
    """A simulation of particles in rows of WIDTH numbers; `_allocate` makes the arrays, `_before` starts a substep."""

    def _allocate(self, max_bands: int) -> None:
        """Allocate the arrays, for threads that process at least one of `max_bands` blocks each."""
        count, real = len(self.body.position), self.real
        self._position, self._velocity, self._before = (np.zeros((count, WIDTH), real) for _ in range(3))
        self._position[:, 3] = self.body.inverse_mass * self.scene.grid.mass
        self._snapshot = np.zeros((2, count, WIDTH), real)
        self._bands = max(1, min(self.threads, max_bands))
        self._bad, self._slots = np.zeros(self._bands, np.int64), WIDTH * np.arange(count)

    def _set_driven(self) -> None:
        """Set the colliders, and the pinned particles that move: `driven` (pins,) int32, all of them if any moves."""
        rows, self._first_pin = self._driven_rows()
        self._set_colliders(rows)
        self.driven = self.body.pinned[: len(self.body.pinned) if self._first_pin else 0].astype(np.int32)

    def _send_rows(self, rows: np.ndarray) -> None:
        self.bodies[...] = rows

    def _pin_velocity(self, step: int) -> np.ndarray | float:
        if not self._first_pin:
            return 0
        number = step * self.scene.method.substeps
        return pin_velocity(self.bodies, self._first_pin, len(self.driven), number, self._record)

    def _store_snapshot(self) -> None:
        self._snapshot[0], self._snapshot[1] = self._position, self._velocity

    def _restore(self) -> None:
        self._position[...], self._velocity[...] = self._snapshot

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        return self._position.reshape(-1), self._velocity.reshape(-1), self._slots, 1

    @property
    def substep_start(self) -> np.ndarray:
        """Positions at the start of the substep (ParticlesSimulation)."""
        return self._before.reshape(-1)

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return np.ascontiguousarray(self._position[:, :3]), np.ascontiguousarray(self._velocity[:, :3])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._position[:, :3], self._velocity[:, :3] = position, velocity

    def some_particles(self, places: np.ndarray) -> np.ndarray:
        """Return (2, n, 3): positions and velocities of the particles at `places` (n,) now."""
        return np.stack([self._position[places, :3], self._velocity[places, :3]])

    def take_particles(self, places: np.ndarray, state: np.ndarray) -> None:
        """Replace positions and velocities of the particles at `places` by `state` (2, n, 3)."""
        self._position[places, :3], self._velocity[places, :3] = state


class RowsSimulation(CpuSimulation):
    """A simulation of a sheet: a state is planes of rows, positions first, then velocities, one flat array
    (core/layout.py); steps go from one of several such arrays to the next. A solver sets `_layout`, `_states` (flat,
    several), `_current` (index of the state) and `_snapshot`, and calls `_set_pins`."""

    _layout: Layout
    _states: np.ndarray
    _current: int
    _snapshot: np.ndarray

    def _set_pins(self) -> None:
        """Set the pinned masses, row by row, and the arrays of the check for divergence."""
        rows = self.body.rows
        self._pin_row, column = np.divmod(self.body.pinned, self.body.columns)
        self._pin_start = np.searchsorted(self._pin_row, np.arange(rows + 1)).astype(np.int64)
        self._pin_column = column.astype(np.int64)
        self._bad = np.full(rows, -1, np.int64)
        self._first_diverged_kernel = make_first_diverged(self.real, self.scene.dimensions)

    @property
    def _is_rk4(self) -> bool:
        return self.scene.method.integrator == "rk4"

    @property
    def current(self) -> np.ndarray:
        """Return (2 x dimensions, rows, columns): positions, then velocities now, axis by axis; a view of the
        storage."""
        return self._layout.view(self._flat)

    @property
    def _flat(self) -> np.ndarray:
        size = self._layout.size
        return self._states[self._current * size : (self._current + 1) * size]

    @property
    def pinned_position(self) -> np.ndarray:
        """Return (dimensions, pins): positions of the pinned masses. They never move, so any state has them."""
        return self._layout.view(self._snapshot)[: self.scene.dimensions, self._pin_row, self._pin_column]

    def _store_snapshot(self) -> None:
        self._snapshot[...] = self._flat

    def _restore(self) -> None:
        self._flat[...] = self._snapshot

    def _first_diverged(self) -> int:
        numba.set_num_threads(self.threads)
        self._first_diverged_kernel(self.current, self.real(self._bound), self._centre.astype(self.real), self._bad)
        rows = np.flatnonzero(self._bad >= 0)
        return int(rows[0] * self.body.columns + self._bad[rows[0]]) if len(rows) else -1

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        axes = self.scene.dimensions
        flat = self.current.reshape(2 * axes, -1)  # a copy, if rows are padded
        return np.ascontiguousarray(flat[:axes].T), np.ascontiguousarray(flat[axes:].T)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        current, axes = self.current, self.scene.dimensions
        current[:axes] = position.T.reshape(current[:axes].shape)
        current[axes:] = velocity.T.reshape(current[axes:].shape)

    def rows(self, first: int, count: int) -> np.ndarray:
        """Return (2 x dimensions, count, columns): positions, then velocities of some rows now, read-only."""
        return self._layout.rows_of(self._flat, slice(first, first + count))

    def take_rows(self, first: int, rows: np.ndarray) -> None:
        """Replace the rows from `first` on by `rows`."""
        span = slice(first, first + rows.shape[1])
        self._layout.put_rows(self._flat, span, rows)
        self._place_ghosts(span)

    def _place_ghosts(self, rows: slice) -> None:
        """Update the padding of rows that were written."""

    def _read_position(self, into: Any) -> Any:
        if into is None:
            return self._download()[0]
        axes = self.scene.dimensions
        into[...] = self.current[:axes].reshape(axes, -1).T
        return into
