"""The fields of fluids: pressures, states of emitters, numbers of lost neighbours and limited speeds."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.types import Real
from softlab.model.core.family import STRAIN, Field, counter, fault, on_host
from softlab.model.fluid.measure import pressures
from softlab.model.fluid.simulation import FluidSimulation
from softlab.model.scene.scene import Scene
from softlab.model.tables.flow import initial_emitter_state


def _check_taps(scene: Scene, taps: object, real: Real) -> np.ndarray:
    """Return emitter states, (emitters, 2) float64."""
    array, shape = np.array(taps, np.float64), (len(scene.emitters), 2)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"taps has shape {array.shape}, this scene needs {shape}, of finite numbers")
    return array


def _upload_taps(simulation: FluidSimulation, taps: np.ndarray | None) -> None:
    """Set the emitter states. None: those at the start of the scene."""
    taps = initial_emitter_state(simulation.scene) if taps is None else taps
    if not np.array_equal(taps, simulation._emitter_state):
        simulation._emitter_state = taps
        simulation._parameters_changed()


PRESSURE = Field(
    "pressure", "particles", (), "Pa", "pressure from the pairs of particles",
    on_host(lambda simulation: pressures(simulation.scene, simulation._download()[0], simulation._multipliers())),
)  # fmt: skip
TAPS = Field(
    "taps", "emitters", (2,), "s; 1", "time since which an emitter has its speed, and layers that had left it by then",
    check=_check_taps,
    download=lambda simulation: simulation._emitter_state.copy(),
    upload=_upload_taps,
)  # fmt: skip
NEIGHBOURS_LOST = fault(
    "neighbours_lost", "neighbours of particles that did not fit into their lists",
    lambda simulation: int(simulation.contacts_lost),
)  # fmt: skip
SPEED_LIMITED = counter(
    "speed_limited", "times that the speed limit slowed a particle in a substep",
    lambda simulation: simulation.speed_limited,
)  # fmt: skip
NOT_EMITTED = counter(
    "not_emitted", "particles that an emitter could not emit, as none was inactive",
    lambda simulation: simulation.not_emitted,
)  # fmt: skip


def of_fluids(scene: Scene) -> tuple[Field, ...]:
    """Return the fields of a scene of fluids."""
    return (STRAIN, PRESSURE, NEIGHBOURS_LOST, SPEED_LIMITED, *((TAPS, NOT_EMITTED) if scene.emitters else ()))
