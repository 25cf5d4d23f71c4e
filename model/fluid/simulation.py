"""Fluids on any backend: emitters and sinks, which activate and deactivate particles."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from softlab.model.core.simulation import Simulation
from softlab.model.tables.flow import initial_emitter_state, rebased


class FluidSimulation(Simulation):
    """A simulation of fluids; see model/core/simulation.py for its methods."""

    @cached_property
    def _emitter_state(self) -> np.ndarray:
        """Array `taps` of the state, (emitters, 2)."""
        return initial_emitter_state(self.scene)

    @property
    def _flows(self) -> bool:
        """True if emitters or sinks add and remove particles."""
        return self.scene.flows

    def _note_active(self, position: np.ndarray) -> None:
        """Set the inverse masses of `body` from the positions, which mark inactive particles."""
        if self._flows:
            fluids = self.scene.fluid_set
            self.body = replace(self.body, inverse_mass=np.where(fluids.there(position), 1 / fluids.masses, 0.0))

    def _take_masses(self, position: np.ndarray, inverse_mass: np.ndarray, time: float) -> None:
        self._note_active(position)
        if not self._flows:
            super()._take_masses(position, inverse_mass, time)

    def _before_change(self) -> None:
        if self._flows:
            self._emitter_state = rebased(self.scene, self._emitter_state, self.time)
