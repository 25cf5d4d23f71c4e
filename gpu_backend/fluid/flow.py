"""Emitters and sinks of a fluid on CUDA: their arrays, and launches of gpu_backend/fluid/flow_kernels.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.fluid.flow_kernels import DUE_FIELDS, THREADS, make_flow_kernels
from softlab.model.fluid.flow import emitter_rows, fluid_starts, sink_rows
from softlab.model.tables.flow import nozzle_points


class Flow:
    """Emitters and sinks of a gpu_backend.fluid.solver.Fluid. `there` (particles,) int32: 1 if active, by number."""

    emitting = 5  # launches of `emit`

    def __init__(self, simulation: Any):
        scene, real, count = simulation.scene, simulation.real, simulation.particle_count
        self._simulation, self._stream, new = simulation, simulation.stream, simulation.on_device
        variant = real, simulation.options.math, simulation.plan.parts
        self.kernels, self._emits = make_flow_kernels(*variant), "emitter" in simulation.plan.parts
        self.there, self.stored_there = new(np.zeros(count, np.int32)), new(np.zeros(count, np.int32))
        emitters = max(1, len(scene.emitters))
        self._emitters = new(np.zeros(1, real))
        if self._emits:
            self._emitters = new(self._rows())
        self._points = new(np.append(nozzle_points(scene, real).reshape(-1), real(0)))
        self.sinks, self._starts = new(self._sink_rows()), new(fluid_starts(scene).astype(np.int32))
        self._due, self._layers = new(np.zeros(DUE_FIELDS * (emitters + 1), np.int32)), new(np.zeros(emitters, real))
        self._blocks = (count + THREADS) // THREADS  # one more than there are particles
        self._ranks, self._sums = new(np.zeros(count + 1, np.int32)), new(np.zeros(self._blocks, np.int32))
        self._missed = new(np.zeros(1, np.int64))

    def _rows(self) -> np.ndarray:
        simulation = self._simulation
        return emitter_rows(simulation.scene, simulation._emitter_state, simulation.real).reshape(-1)

    def _sink_rows(self) -> np.ndarray:
        """Return the rows of sinks; if there are none, a row of zeros (a half space without particles), because an
        array needs a number."""
        rows = sink_rows(self._simulation.scene, self._simulation.real)
        return rows.reshape(-1) if len(rows) else np.zeros(1, self._simulation.real)

    def changed(self) -> None:
        """Update the emitters' speeds."""
        if self._emits:
            self._emitters.copy_to_device(self._rows(), stream=self._stream)

    def emit(self, position: DeviceArray, velocity: DeviceArray, particle: DeviceArray, time: Arguments) -> None:
        """Emit the particles of a substep into the state; `time`: counter, place, substeps, substep."""
        kernels, flat = self.kernels, (self._blocks, THREADS, self._stream)
        kernels.due[1, 1, self._stream](*time, self._simulation.record, self._emitters, self._due, self._layers)
        kernels.rank[flat](self.there, self._due, self._ranks, self._sums)
        kernels.totals[1, THREADS, self._stream](self._due, self._sums)
        who = self.there, self._starts, self._emitters
        what = self._due, self._layers, self._ranks, self._sums
        kernels.emit[flat](position, velocity, particle, *who, self._points, *what)
        kernels.arrive[1, 1, self._stream](particle, *who, *what, self._missed)

    def upload(self, there: np.ndarray) -> None:
        """Upload which particles are active, (particles,) bool."""
        self.there.copy_to_device(there.astype(np.int32), stream=self._stream)

    def store(self) -> None:
        """Save which particles are active."""
        self.stored_there.copy_to_device(self.there, stream=self._stream)

    def restore(self) -> None:
        """Restore which particles are active."""
        self.there.copy_to_device(self.stored_there, stream=self._stream)

    @property
    def missed(self) -> int:
        """Number of particles that a nozzle could not emit as none was inactive."""
        host = self._missed.copy_to_host(stream=self._stream)
        cuda.synchronize()
        return int(host[0])

    def forget(self) -> None:
        """Set the counter to 0."""
        self._missed.copy_to_device(np.zeros(1, np.int64), stream=self._stream)
